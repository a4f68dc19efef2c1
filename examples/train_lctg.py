#!/usr/bin/env python
"""Trains LCTG, the encoder and diffusion decoder of textures (paper sections 2.2 and 2.3).

The paper's two phases are two runs: first on the full set, then, from its result, on the segments inside the limits.

    accelerate launch examples/train_lctg.py --train_data_dir prepared.h5 --subset full --output_dir runs/lctg_full
    accelerate launch examples/train_lctg.py --train_data_dir prepared.h5 --subset filtered \
        --pretrained_model_name_or_path runs/lctg_full --output_dir runs/lctg

The output folder is a pipeline that reconstructs: TactileTexturePipeline.from_pretrained("runs/lctg").
"""

import argparse
import math
from pathlib import Path

import numpy as np
import torch
from torch import nn

from tactile_diffusers import LCTGModel, TactileFeatureExtractor, TactileTexturePipeline, VDDIMScheduler
from tactile_diffusers.data import PreparedDataset
from tactile_diffusers.features import fit_preemphasis
from tactile_diffusers.schedulers import RECOMMENDED
from tactile_diffusers.signal import nine_band_error_db, resample
from tactile_diffusers.training.arguments import (
    add_hub_arguments,
    add_training_arguments,
    check_model_folder,
    check_not_negative,
    parse_training_arguments,
    read_model_config,
)
from tactile_diffusers.training.batches import make_collate
from tactile_diffusers.training.checkpoints import writing
from tactile_diffusers.training.draws import Draws
from tactile_diffusers.training.ending import finish
from tactile_diffusers.training.figures import plot_reconstructions
from tactile_diffusers.training.loop import Trainer, make_accelerator
from tactile_diffusers.training.losses import multi_resolution_spectral_loss, octave_weights, velocity_loss
from tactile_diffusers.training.refusals import run, starting

#: What the bundled checkpoint was trained with (the rows of examples/configs/ablation led to it).
CONFIG = Path(__file__).parent / "configs" / "lctg.json"


def parse_args(argv=None):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_training_arguments(parser)
    add_hub_arguments(parser)
    parser.add_argument("--subset", choices=["full", "filtered"], default="filtered", help="segments to train on")
    parser.add_argument("--pretrained_model_name_or_path", help="pipeline folder to go on from (second phase)")
    parser.add_argument(
        "--model_config_name_or_path",
        default=str(CONFIG),
        help="JSON with feature_extractor, lctg and scheduler arguments; default: examples/configs/lctg.json",
    )
    parser.add_argument(
        "--octave_exponent", type=float, default=1.0, help="velocity loss weighted by frequency ** -exponent; 0 = flat"
    )
    parser.add_argument(
        "--freeze_encoder", action="store_true", help="train the decoder only: latents stay as they are"
    )
    parser.add_argument("--spectral_loss_weight", type=float, default=0.0, help="of the frequency-aware loss; 0 = off")
    parser.add_argument(
        "--spectral_loss_scale",
        choices=["flat", "threshold"],
        default="flat",
        help="weights of its frequencies: equal, or by the fingertip's sensitivity",
    )
    parser.add_argument(
        "--phi_exponent", type=float, default=0.0, help="velocity loss weighted by cos(phi) ** exponent; 0 = flat"
    )
    parser.add_argument(
        "--latent_penalty", type=float, default=0.0, help="of the mean square of the learned latents; 0 = off"
    )
    parser.add_argument("--detail_dropout", type=float, default=0.5, help="share of textures without detail layer")
    parser.add_argument("--preemphasis_clip_db", type=float, default=30.0, help="largest whitening gain; 0 = none")
    args = parse_training_arguments(parser, argv)
    weights = ("spectral_loss_weight", "preemphasis_clip_db", "octave_exponent", "phi_exponent", "latent_penalty")
    check_not_negative(args, *weights)
    if not 0 <= args.detail_dropout <= 1:
        raise ValueError(f"--detail_dropout must lie in [0, 1], got {args.detail_dropout}.")
    return args


class LCTGTrainingStep(nn.Module):
    """The v-objective on a batch, with noise on the latents; the frequency-aware loss where asked for.

    `share`: index of this process and number of processes, for `Draws`.
    """

    def __init__(self, model, scheduler, extractor, args, share=(0, 1)):
        super().__init__()
        self.model, self.scheduler, self.args, self.share = model, scheduler, args, share
        signed = extractor.hop_length * extractor.use_waveform + extractor.detail_samples
        self.without_sign = extractor.feature_size - signed
        self.rate_and_band = (extractor.sampling_rate, extractor.band)

    def forward(self, batch, generator):
        clean, features = batch["waveform"][:, None], batch["input_features"]
        draws = Draws(generator, clean.device, self.share)
        # a texture has no polarity: the waveform and its copy in the features change sign together
        sign = draws.normal(len(clean), 1, 1).sign()
        clean = clean * sign
        features = torch.cat([features[:, : self.without_sign], features[:, self.without_sign :] * sign], dim=1)
        latents = self.model.encode(features)
        learned = latents[:, self.model.level_channels : self.model.base_channels]
        latents = self.noisy_latents(latents, generator)
        noise = draws.normal(*clean.shape)
        # phi is uniform and stratified over the batch: the loss is less noisy from step to step
        timesteps = draws.strata(len(clean)) * self.scheduler.config.num_train_timesteps - 1
        noisy = self.scheduler.add_noise(clean, noise, timesteps)
        velocity = self.model(noisy, timesteps, latents, return_dict=False)[0]
        target = self.scheduler.get_velocity(clean, noise, timesteps)
        weights = None
        if self.args.octave_exponent:
            weights = octave_weights(clean.shape[-1], *self.rate_and_band, self.args.octave_exponent).to(clean.device)
        loss = velocity_loss(velocity, target, weights)
        scalars = {"velocity": loss.detach().mean()}
        cosine = self.scheduler.angle(timesteps).cos().clamp_min(0).to(clean.device)  # rounding: -4e-8 at pi/2
        if self.args.phi_exponent:
            # over a uniform phi the weights have a mean of one
            p = self.args.phi_exponent
            mean = math.gamma((p + 1) / 2) / (math.sqrt(math.pi) * math.gamma(p / 2 + 1))
            loss = loss * cosine**p / mean
        loss = loss.mean()
        if self.args.spectral_loss_weight:
            predicted = self.scheduler.get_original_sample(velocity.float(), noisy, timesteps)
            spectral = multi_resolution_spectral_loss(
                predicted[:, 0],
                clean[:, 0],
                sensitivity_rate=self.rate_and_band[0] if self.args.spectral_loss_scale == "threshold" else None,
            )
            # far from the data the prediction is an average, which has no texture's spectrum: weight cos^2 phi
            spectral = (spectral * cosine.square()).mean()
            loss = loss + self.args.spectral_loss_weight * spectral
            scalars["spectral"] = spectral.detach()
        if self.args.latent_penalty:
            # against the noise a bounded channel saturates; where power costs, it comes near to a Gaussian
            scalars["latent_power"] = learned.detach().square().mean()
            loss = loss + self.args.latent_penalty * learned.square().mean()
        return loss, scalars

    def noisy_latents(self, latents, generator):
        """Latents with noise, and in some rows without their detail layer."""
        draws = Draws(generator, latents.device, self.share)
        latents = latents + self.model.config.latent_noise * draws.normal(*latents.shape)
        if self.model.config.detail_channels:
            kept = draws.uniform(len(latents), 1, 1) >= self.args.detail_dropout
            base = self.model.base_channels
            latents = torch.cat([latents[:, :base], latents[:, base:] * kept], dim=1)
        return latents


def build_components(args):
    """Feature extractor, model and scheduler: from a pipeline folder, or new from a config and the data's spectrum."""
    if args.pretrained_model_name_or_path:
        pipe = TactileTexturePipeline.from_pretrained(args.pretrained_model_name_or_path, cache_dir=args.cache_dir)
        return pipe.feature_extractor, pipe.lctg, pipe.scheduler
    config = read_model_config(args.model_config_name_or_path, {"feature_extractor", "lctg", "scheduler"})
    native = PreparedDataset(args.train_data_dir, "train", "filtered")  # the spectrum of what will be generated
    settings = {"band": tuple(native.band), **config.get("feature_extractor", {})}
    if args.preemphasis_clip_db:
        sample = np.random.default_rng(args.seed).permutation(len(native))[:500]
        frequencies, gains = fit_preemphasis(
            native.textures(np.sort(sample)), native.sampling_rate, settings["band"], clip_db=args.preemphasis_clip_db
        )
        settings |= {"preemphasis_frequencies": frequencies, "preemphasis_db": gains}
    extractor = TactileFeatureExtractor(**settings)
    latent_hop = extractor.hop_length * extractor.frame_multiple
    seconds = native.segment_samples / native.sampling_rate
    model_settings = {
        "feature_channels": extractor.feature_size,
        "level_bands": extractor.level_bands,
        "detail_channels": extractor.detail_samples,
        "feature_hop": extractor.hop_length,
        "latent_hop": latent_hop,
        "segment_samples": math.ceil(seconds * extractor.sampling_rate / latent_hop) * latent_hop,
        **config.get("lctg", {}),
    }
    return extractor, LCTGModel(**model_settings), VDDIMScheduler(**{**RECOMMENDED, **config.get("scheduler", {})})


def make_validation(args, extractor, scheduler, dataset):
    """Nine-band error and SNR (of silence: 0 dB) of reconstructions of held-out segments."""
    count = min(args.validation_samples, len(dataset))
    chosen = np.sort(np.random.default_rng(0).permutation(len(dataset))[:count])
    real, rate = dataset.textures(chosen), extractor.delivery_rate
    reference = resample(real, dataset.sampling_rate, rate)

    def decode(pipe, base_only):
        made = []
        for start in range(0, count, args.eval_batch_size):
            heard = pipe.encode(real[start : start + args.eval_batch_size], dataset.sampling_rate)
            if base_only:
                heard.latents = pipe.lctg.pad_detail(heard.latents[:, : pipe.lctg.base_channels])
            generator = torch.Generator("cpu").manual_seed(start)
            out = pipe.decode(heard.latents, heard.level, num_inference_steps=10, generator=generator)
            made.append(out.textures[:, : reference.shape[-1]])
        return np.concatenate(made)

    def validate(model, step):
        pipe = TactileTexturePipeline(
            lctg=model, scheduler=VDDIMScheduler.from_config(scheduler.config), feature_extractor=extractor
        )
        pipe.set_progress_bar_config(disable=True)
        made = decode(pipe, base_only=False)
        with writing("validation.png", args.output_dir):
            plot_reconstructions(reference[:4], made[:4], rate, Path(args.output_dir) / "validation.png")
        error = np.square(made - reference).mean(-1)
        found = {
            "nine_band_db": nine_band_error_db(made, reference, rate).mean(),
            "snr_db": (10 * np.log10(np.square(reference).mean(-1) / error)).mean(),
        }
        if model.config.detail_channels:  # what DALE's textures are made from
            found["base_nine_band_db"] = nine_band_error_db(decode(pipe, base_only=True), reference, rate).mean()
        return found

    return validate


def main(argv=None):
    with starting():
        args = parse_args(argv)
        check_model_folder(args.pretrained_model_name_or_path)
        accelerator = make_accelerator(args)
        extractor, model, scheduler = build_components(args)
        model.encoder.requires_grad_(not args.freeze_encoder)
        dataset = PreparedDataset(
            args.train_data_dir, "train", args.subset, extractor.sampling_rate, max_samples=args.max_train_samples
        )
        validate = None
        if args.validation_samples:
            held_out = PreparedDataset(args.train_data_dir, "validation", "filtered")
            validate = make_validation(args, extractor, scheduler, held_out)
    trainer = Trainer(
        accelerator,
        args,
        LCTGTrainingStep(model, scheduler, extractor, args, (accelerator.process_index, accelerator.num_processes)),
        "lctg",
        dataset,
        make_collate(extractor, extractor.sampling_rate),
        validate,
    )
    model = trainer.run()
    if accelerator.is_main_process:
        pipe = TactileTexturePipeline(lctg=model, scheduler=scheduler, feature_extractor=extractor)
        finish(args, pipe.save_pretrained, pipe, dataset)


if __name__ == "__main__":
    run(main)

#!/usr/bin/env python
"""Trains LCTG, the encoder and diffusion decoder of textures (paper sections 2.2 and 2.3).

The paper's two phases are two runs: first on the full set, then, from its result, on the segments inside the limits.

    accelerate launch examples/train_lctg.py --train_data_dir prepared.h5 --subset full --output_dir runs/lctg_full
    accelerate launch examples/train_lctg.py --train_data_dir prepared.h5 --subset filtered \
        --pretrained_model_name_or_path runs/lctg_full --output_dir runs/lctg

The output folder is a pipeline that reconstructs: TactileTexturePipeline.from_pretrained("runs/lctg").
"""

import math
from pathlib import Path

import numpy as np

from tactile_diffusers import LCTGModel, TactileFeatureExtractor, TactileTexturePipeline, VDDIMScheduler
from tactile_diffusers.data.dataset import PreparedDataset
from tactile_diffusers.io.argument_types import not_negative, share
from tactile_diffusers.schedulers import RECOMMENDED
from tactile_diffusers.training.batches import EndlessBatches, make_collate
from tactile_diffusers.training.card import finish
from tactile_diffusers.training.checkpoints import writing
from tactile_diffusers.training.fitting import fit_preemphasis
from tactile_diffusers.training.launch import (
    make_accelerator,
    parse_training_arguments,
    pipeline_source,
    read_model_config,
    run,
    starting,
    training_parser,
)
from tactile_diffusers.training.loop import Trainer
from tactile_diffusers.training.record import surfaces_of
from tactile_diffusers.training.steps import LCTGTrainingStep
from tactile_diffusers.training.validation import Reconstructions, plot_reconstructions

#: What the bundled checkpoint was trained with.
CONFIG = Path(__file__).parent / "configs" / "lctg.json"


def parse_args(argv=None):
    parser = training_parser(__doc__)
    add = parser.add_argument
    add("--detail_dropout", type=share, default=0.5, help="share of textures without detail layer")
    weighted = "velocity loss weighted by frequency ** -exponent; 0 = flat"
    add("--octave_exponent", type=not_negative, default=1.0, help=weighted)
    add("--spectral_loss_weight", type=not_negative, default=0.0, help="of the frequency-aware loss; 0 = off")
    add("--subset", choices=["full", "filtered"], default="filtered", help="segments to train on")
    add(
        "--pretrained_model_name_or_path",
        type=pipeline_source,
        help="to continue from (second phase)",
    )
    add(
        "--model_config_name_or_path",
        default=str(CONFIG),
        help="JSON with feature_extractor, lctg and scheduler arguments; default: examples/configs/lctg.json",
    )
    add("--latent_penalty", type=not_negative, default=0.0, help="of the mean square of the learned latents; 0 = off")
    add("--preemphasis_clip_db", type=not_negative, default=30.0, help="largest whitening gain; 0 = none")
    return parse_training_arguments(parser, argv)


def build_components(args):
    """A new pipeline: its feature extractor whitens by the spectrum of the data, the rest is as in the config."""
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
    latent_hop = extractor.lctg_geometry["latent_hop"]
    seconds = native.segment_samples / native.sampling_rate
    model_settings = {
        **extractor.lctg_geometry,
        "segment_samples": math.ceil(seconds * extractor.sampling_rate / latent_hop) * latent_hop,
        **config.get("lctg", {}),
    }
    scheduler = VDDIMScheduler(**RECOMMENDED | config.get("scheduler", {}))
    return TactileTexturePipeline(lctg=LCTGModel(**model_settings), scheduler=scheduler, feature_extractor=extractor)


def make_validation(args, pipe):
    """Nine-band error and SNR of reconstructions, of which a few are drawn into `validation.png`."""
    held_out = Reconstructions(args.train_data_dir, pipe, args.validation_samples, args.eval_batch_size)

    def validate(model):
        decoded = held_out.decode(model, steps=10)
        with writing("validation.png", args.output_dir):
            path = Path(args.output_dir) / "validation.png"
            plot_reconstructions(held_out.references[:4], decoded[:4], held_out.rate, path)
        found = {"nine_band_db": held_out.nine_band_db(decoded), "snr_db": held_out.snr_db(decoded)}
        if model.config.detail_channels:  # what DALE's textures are decoded from
            found["base_nine_band_db"] = held_out.nine_band_db(held_out.decode(model, steps=10, base_only=True))
        return found

    return validate


def main(argv=None):
    with starting():
        args, pipe = parse_args(argv), None
        if args.pretrained_model_name_or_path:
            pipe = TactileTexturePipeline.from_pretrained(args.pretrained_model_name_or_path)
        accelerator = make_accelerator(args)
        pipe = pipe or build_components(args)
        extractor = pipe.feature_extractor
        dataset = PreparedDataset(
            args.train_data_dir, "train", args.subset, extractor.sampling_rate, max_samples=args.max_train_samples
        )
        EndlessBatches(len(dataset), args.train_batch_size, args.seed, 0, accelerator.num_processes)  # or refuses now
        validate = make_validation(args, pipe) if args.validation_samples else None
    step = LCTGTrainingStep(
        pipe.lctg,
        pipe.scheduler,
        extractor,
        octave_exponent=args.octave_exponent,
        spectral_loss_weight=args.spectral_loss_weight,
        latent_penalty=args.latent_penalty,
        detail_dropout=args.detail_dropout,
    )
    collate = make_collate(extractor, extractor.sampling_rate)
    trainer = Trainer(accelerator, args, step, "lctg", dataset, collate, validate, surfaces_of(dataset))
    model = trainer.run()
    if accelerator.is_main_process:
        pipe = TactileTexturePipeline(lctg=model, scheduler=pipe.scheduler, feature_extractor=extractor)
        finish(args, pipe.save_pretrained, pipe, dataset)


if __name__ == "__main__":
    run(main)

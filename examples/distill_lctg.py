#!/usr/bin/env python
"""Distils LCTG's decoder into one that needs one or two steps.

    accelerate launch examples/distill_lctg.py --train_data_dir prepared.h5 \
        --pretrained_model_name_or_path runs/dale --max_train_steps 4000 --output_dir runs/distilled

The decoder learns where its teacher arrives in many steps. The encoder stays, so DALE's latents fit both. The result,
`runs/distilled/lctg_distilled`, takes the teacher's place:

    lctg = LCTGModel.from_pretrained("runs/distilled", subfolder="lctg_distilled")
    pipe = TactileTexturePipeline.from_pretrained("runs/dale", lctg=lctg)

Three ways (`--method`), which the README compares:

- trajectory: the student walks its one and its two steps, with the pipeline's own sampler, and its ends are compared
  with the teacher's end from the same noise (Luhman and Luhman 2021, arXiv 2101.02388, with more steps than one);
- progressive: each of its steps is compared with several of the teacher's (Salimans and Ho 2022, arXiv 2202.00512);
- consistency: what it predicts from two neighbouring points of the teacher's path must be the same (Song et al. 2023,
  arXiv 2303.01469).

What the last two learn is sampled in first order: load `runs/distilled/scheduler` beside `lctg=`.
"""

import argparse
import copy
import math
from pathlib import Path

import numpy as np
import torch
from torch import nn

from tactile_diffusers import TactileTexturePipeline, VDDIMScheduler
from tactile_diffusers.checkpoints import DISTILLED
from tactile_diffusers.data import PreparedDataset
from tactile_diffusers.signal import nine_band_error_db, resample
from tactile_diffusers.training.arguments import (
    add_training_arguments,
    check_model_folder,
    check_not_negative,
    parse_training_arguments,
)
from tactile_diffusers.training.batches import make_collate
from tactile_diffusers.training.draws import Draws
from tactile_diffusers.training.ending import finish
from tactile_diffusers.training.loop import Trainer, make_accelerator
from tactile_diffusers.training.losses import multi_resolution_spectral_loss, octave_weights, velocity_loss
from tactile_diffusers.training.modulation import MODULATION_TEXTURES, fit_modulation_gains
from tactile_diffusers.training.refusals import run, starting


def parse_args(argv=None):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_training_arguments(parser)
    parser.set_defaults(learning_rate=5e-4, lr_warmup_steps=50)
    parser.add_argument("--pretrained_model_name_or_path", required=True, help="pipeline folder with the teacher")
    parser.add_argument("--method", choices=list(METHODS), default="trajectory")
    parser.add_argument(
        "--student_steps", type=int, nargs="+", default=[1, 2], help="of trajectory; the others learn the last one"
    )
    parser.add_argument("--teacher_steps", type=int, default=8, help="in all, of the teacher")
    parser.add_argument("--detail_dropout", type=float, default=0.5, help="share of textures without detail layer")
    parser.add_argument("--octave_exponent", type=float, default=1.0, help="weights frequency ** -exponent; 0 = flat")
    parser.add_argument("--spectral_loss_weight", type=float, default=0.0, help="of the spectra of both ends; 0 = off")
    args = parse_training_arguments(parser, argv)
    check_not_negative(args, "octave_exponent", "spectral_loss_weight")
    if not 0 <= args.detail_dropout <= 1:
        raise ValueError(f"--detail_dropout must lie in [0, 1], got {args.detail_dropout}.")
    if not 1 <= min(args.student_steps) <= max(args.student_steps) < args.teacher_steps:
        raise ValueError(
            f"--student_steps must be at least 1 and below --teacher_steps ({args.teacher_steps}), got "
            f"{args.student_steps}."
        )
    return args


def walk(model, scheduler, noise, latents, steps, first=None):
    """The end of a path of `steps`; `first`: the velocity at its start, if it is known."""
    scheduler.set_timesteps(steps, device=noise.device)
    state = noise
    for index, t in enumerate(scheduler.timesteps):
        known = index == 0 and first is not None
        velocity = first if known else model(state, t, latents, return_dict=False)[0]
        state = scheduler.step(velocity, t, state, return_dict=False)[0]
    return state


class DistillationStep(nn.Module):
    """The chosen loss on a batch: `{"waveform", "input_features"}` -> (loss, scalars)."""

    def __init__(self, model, teacher, scheduler, extractor, args, share=(0, 1)):
        super().__init__()
        self.model, self.teacher, self.args, self.share = model, teacher.requires_grad_(False), args, share
        self.schedulers = [VDDIMScheduler.from_config(scheduler.config) for _ in range(2)]  # a scheduler has state
        self.rate_and_band = (extractor.sampling_rate, extractor.band)

    def forward(self, batch, generator):
        clean = batch["waveform"][:, None]
        draws = Draws(generator, clean.device, self.share)
        with torch.no_grad():
            latents = self.model.encode(batch["input_features"])
            # from exact to as noisy as the teacher knows: generated latents lie between
            share = draws.uniform(len(latents), 1, 1)
            latents = latents + share * self.model.config.latent_noise * draws.normal(*latents.shape)
            base = self.model.base_channels
            kept = draws.uniform(len(latents), 1, 1) >= self.args.detail_dropout
            latents = torch.cat([latents[:, :base], latents[:, base:] * kept], dim=1)
        loss, scalars = METHODS[self.args.method](self, clean, latents, draws)
        return loss, {"distance": loss.detach(), **scalars}

    def distance(self, made, wanted):
        """Of two waveforms or velocities: octaves count alike, and the spectra over time where asked for."""
        weights = octave_weights(made.shape[-1], *self.rate_and_band, self.args.octave_exponent).to(made.device)
        loss = velocity_loss(made, wanted, weights).mean()
        if self.args.spectral_loss_weight:
            spectra = multi_resolution_spectral_loss(made[:, 0], wanted[:, 0]).mean()
            loss = loss + self.args.spectral_loss_weight * spectra
        return loss

    def trajectory(self, clean, latents, draws):
        noise = draws.normal(*clean.shape)
        with torch.no_grad():
            end = walk(self.teacher, self.schedulers[0], noise, latents, self.args.teacher_steps)
        start = self.model(noise, self.schedulers[1].config.num_train_timesteps - 1, latents, return_dict=False)[0]
        losses = {
            f"steps_{steps}": self.distance(walk(self.model, self.schedulers[1], noise, latents, steps, start), end)
            for steps in self.args.student_steps
        }
        return sum(losses.values()), {name: loss.detach() for name, loss in losses.items()}

    def progressive(self, clean, latents, draws):
        parts = self.args.student_steps[-1]
        turn, finer = math.pi / 2 / parts, max(2, self.args.teacher_steps // parts)
        place = (draws.uniform(len(clean)) * parts).floor() + 1  # where a step of the student begins
        state = begin = self._noisy(clean, place * turn, draws)
        with torch.no_grad():
            for index in range(finer):
                state = self._turned(state, place * turn - index * turn / finer, turn / finer, latents)
            wanted = (math.cos(turn) * begin - state) / math.sin(turn)
        return self.distance(self._velocity(self.model, begin, place * turn, latents), wanted), {}

    def consistency(self, clean, latents, draws):
        turn = math.pi / 2 / self.args.teacher_steps
        place = (draws.uniform(len(clean)) * self.args.teacher_steps).floor() + 1
        angle = place * turn
        begin = self._noisy(clean, angle, draws)
        with torch.no_grad():
            following = self._turned(begin, angle, turn, latents)
            wanted = self._end(following, angle - turn, latents)
        return self.distance(self._end(begin, angle, latents), wanted), {}

    def _time(self, angle):
        return angle / (math.pi / 2) * self.schedulers[0].config.num_train_timesteps - 1

    def _noisy(self, clean, angle, draws):
        return self.schedulers[0].add_noise(clean, draws.normal(*clean.shape), self._time(angle))

    def _velocity(self, model, state, angle, latents):
        return model(state, self._time(angle), latents, return_dict=False)[0]

    def _turned(self, state, angle, turn, latents):
        return math.cos(turn) * state - math.sin(turn) * self._velocity(self.teacher, state, angle, latents)

    def _end(self, state, angle, latents):
        velocity = self._velocity(self.model, state, angle, latents)
        return angle.cos()[:, None, None] * state - angle.sin()[:, None, None] * velocity


METHODS = {name: getattr(DistillationStep, name) for name in ("trajectory", "progressive", "consistency")}


def make_validation(args, pipe, dataset):
    """Nine-band error, from the base layer alone, at each number of steps."""
    count = min(args.validation_samples, len(dataset))
    chosen = np.sort(np.random.default_rng(0).permutation(len(dataset))[:count])
    real, rate = dataset.textures(chosen), pipe.feature_extractor.delivery_rate
    reference = resample(real, dataset.sampling_rate, rate)
    given = pipe.encode(real, dataset.sampling_rate)
    base = pipe.lctg.pad_detail(given.latents[:, : pipe.lctg.base_channels])

    def validate(model, step):
        whole = TactileTexturePipeline(
            lctg=model,
            scheduler=VDDIMScheduler.from_config(pipe.scheduler.config),
            feature_extractor=pipe.feature_extractor,
        )
        whole.set_progress_bar_config(disable=True)
        found = {}
        for steps in args.student_steps:
            generator = torch.Generator("cpu").manual_seed(0)
            made = whole.decode(base, given.level, None, steps, generator).textures
            found[f"nine_band_db_{steps}"] = nine_band_error_db(made, reference, rate).mean()
        return found

    return validate


def main(argv=None):
    with starting():
        args = parse_args(argv)
        check_model_folder(args.pretrained_model_name_or_path)
        pipe = TactileTexturePipeline.from_pretrained(args.pretrained_model_name_or_path, cache_dir=args.cache_dir)
        if pipe.lctg.config.distilled_steps is not None:
            raise ValueError(
                f"--pretrained_model_name_or_path {args.pretrained_model_name_or_path} is distilled already. Give its "
                "teacher."
            )
        accelerator = make_accelerator(args)
        rate = pipe.feature_extractor.sampling_rate
        dataset = PreparedDataset(args.train_data_dir, "train", "filtered", rate, max_samples=args.max_train_samples)
        held_out = PreparedDataset(args.train_data_dir, "validation", "filtered")
    teacher = copy.deepcopy(pipe.lctg)
    teachers = pipe.scheduler
    if args.method != "trajectory":
        pipe.register_modules(scheduler=VDDIMScheduler())
    pipe.lctg.register_to_config(distilled_steps=max(args.student_steps))
    pipe.lctg.encoder.requires_grad_(False)
    share = (accelerator.process_index, accelerator.num_processes)
    trainer = Trainer(
        accelerator,
        args,
        DistillationStep(pipe.lctg, teacher, teachers, pipe.feature_extractor, args, share),
        "lctg",
        dataset,
        make_collate(pipe.feature_extractor, rate),
        make_validation(args, pipe, held_out) if args.validation_samples else None,
    )
    model = trainer.run()
    if accelerator.is_main_process:
        pipe.register_modules(lctg=model)
        if pipe.dale is not None:  # told no details, this decoder has another modulation than its teacher's
            rows = dataset.non_overlapping(1)[:MODULATION_TEXTURES]
            fit_modulation_gains(pipe, pipe.dale, dataset.textures(rows), dataset.sampling_rate, args.seed, args.quiet)

        def save(folder):
            model.save_pretrained(str(Path(folder) / DISTILLED))
            pipe.scheduler.save_pretrained(str(Path(folder) / "scheduler"))

        finish(args, save, pipe, dataset, teacher=args.pretrained_model_name_or_path)


if __name__ == "__main__":
    run(main)

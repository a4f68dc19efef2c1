#!/usr/bin/env python
"""Distils LCTG's decoder into one that needs one or two steps.

    accelerate launch examples/distill_lctg.py --train_data_dir prepared.h5 \
        --pretrained_model_name_or_path runs/dale --max_train_steps 4000 --output_dir runs/distilled

The student walks its one and its two steps with the pipeline's own sampler, and its ends are compared with its
teacher's end from the same noise (Luhman and Luhman 2021, arXiv 2101.02388, with more steps than one). The encoder
stays, so DALE's latents fit both decoders. The result takes the teacher's place:

    lctg = LCTGModel.from_pretrained("runs/distilled", subfolder="lctg_distilled")
    pipe = TactileTexturePipeline.from_pretrained("runs/dale", lctg=lctg)
"""

import copy
from pathlib import Path

import torch
from torch import nn

from tactile_diffusers import TactileTexturePipeline, VDDIMScheduler
from tactile_diffusers.checkpoints import DISTILLED
from tactile_diffusers.data.dataset import PreparedDataset
from tactile_diffusers.training.batches import make_collate
from tactile_diffusers.training.card import finish
from tactile_diffusers.training.fitting import MODULATION_TEXTURES, fit_modulation_gains
from tactile_diffusers.training.launch import (
    add_decoder_arguments,
    make_accelerator,
    parse_training_arguments,
    run,
    starting,
    training_parser,
)
from tactile_diffusers.training.loop import Trainer
from tactile_diffusers.training.record import surfaces_of
from tactile_diffusers.training.steps import drop_detail, frequency_aware_loss, octave_weights, velocity_loss
from tactile_diffusers.training.validation import Reconstructions


def parse_args(argv=None):
    parser = training_parser(__doc__, hub=False, learning_rate=5e-4, lr_warmup_steps=50)
    add_decoder_arguments(parser)
    add = parser.add_argument
    add("--pretrained_model_name_or_path", required=True, help="pipeline folder with the teacher")
    add("--student_steps", type=int, nargs="+", default=[1, 2], help="numbers of steps that the student learns")
    add("--teacher_steps", type=int, default=8)
    args = parse_training_arguments(parser, argv)
    if not 1 <= min(args.student_steps) <= max(args.student_steps) < args.teacher_steps:
        parser.error(
            f"argument --student_steps: must be at least 1 and below --teacher_steps ({args.teacher_steps}), got "
            f"{args.student_steps}"
        )
    return args


def sample(model, scheduler, noise, latents, steps, first=None):
    """The end of a path of `steps` from `noise`; `first`: the velocity at its start, if it is known."""
    scheduler.set_timesteps(steps, device=noise.device)
    state = noise
    for index, t in enumerate(scheduler.timesteps):
        known = index == 0 and first is not None
        velocity = first if known else model(state, t, latents, return_dict=False)[0]
        state = scheduler.step(velocity, t, state, return_dict=False)[0]
    return state


class DistillationStep(nn.Module):
    """Distance of the student's ends from the teacher's: `{"waveform", "input_features"}` -> (loss, scalars)."""

    def __init__(self, model, teacher, scheduler, extractor, args):
        super().__init__()
        self.model, self.teacher, self.args = model, teacher.requires_grad_(False), args
        self.schedulers = [VDDIMScheduler.from_config(scheduler.config) for _ in range(2)]  # a scheduler has state
        self.rate_and_band = (extractor.sampling_rate, extractor.band)

    def forward(self, batch, random):
        with torch.no_grad():
            latents = self.model.encode(batch["input_features"])
            # from exact to as noisy as the teacher knows: generated latents lie between
            amount = random.uniform(len(latents), 1, 1)
            latents = latents + amount * self.model.config.latent_noise * random.normal(*latents.shape)
            latents = drop_detail(latents, self.model.base_channels, self.args.detail_dropout, random)
            noise = random.normal(*batch["waveform"][:, None].shape)
            end = sample(self.teacher, self.schedulers[0], noise, latents, self.args.teacher_steps)
        last = self.schedulers[1].config.num_train_timesteps - 1
        first = self.model(noise, last, latents, return_dict=False)[0]
        losses = {
            f"steps_{steps}": self.distance(sample(self.model, self.schedulers[1], noise, latents, steps, first), end)
            for steps in self.args.student_steps
        }
        loss = sum(losses.values())
        return loss, {"distance": loss.detach(), **{name: value.detach() for name, value in losses.items()}}

    def distance(self, student, teacher):
        """Of two waveforms: octaves count alike, and the spectra over time if asked for."""
        weights = octave_weights(student.shape[-1], *self.rate_and_band, self.args.octave_exponent).to(student.device)
        loss = velocity_loss(student, teacher, weights).mean()
        if self.args.spectral_loss_weight:
            spectra = frequency_aware_loss(student[:, 0], teacher[:, 0]).mean()
            loss = loss + self.args.spectral_loss_weight * spectra
        return loss


def make_validation(args, pipe):
    """Nine-band error, from the base layer alone, at each number of steps."""
    held_out = Reconstructions(args.train_data_dir, pipe, args.validation_samples, args.eval_batch_size)

    def validate(model):
        return {
            f"nine_band_db_{steps}": held_out.nine_band_db(held_out.decode(model, steps, base_only=True))
            for steps in args.student_steps
        }

    return validate


def main(argv=None):
    with starting():
        args = parse_args(argv)
        pipe = TactileTexturePipeline.from_pretrained(args.pretrained_model_name_or_path, cache_dir=args.cache_dir)
        if pipe.lctg.config.distilled_steps is not None:
            raise ValueError(
                f"--pretrained_model_name_or_path {args.pretrained_model_name_or_path} is distilled already. Give its "
                "teacher."
            )
        accelerator = make_accelerator(args)
        extractor = pipe.feature_extractor
        rate = extractor.sampling_rate
        dataset = PreparedDataset(args.train_data_dir, "train", "filtered", rate, max_samples=args.max_train_samples)
        validate = make_validation(args, pipe) if args.validation_samples else None
    teacher = copy.deepcopy(pipe.lctg)
    pipe.lctg.register_to_config(distilled_steps=max(args.student_steps))
    pipe.lctg.encoder.requires_grad_(False)
    step = DistillationStep(pipe.lctg, teacher, pipe.scheduler, extractor, args)
    collate = make_collate(extractor, rate)
    trainer = Trainer(accelerator, args, step, "lctg", dataset, collate, validate, surfaces_of(dataset))
    model = trainer.run()
    if accelerator.is_main_process:
        pipe.register_modules(lctg=model)
        if pipe.dale is not None:  # from the base layer alone, it has another modulation than its teacher
            rows = dataset.non_overlapping(1)[:MODULATION_TEXTURES]
            fit_modulation_gains(pipe, pipe.dale, dataset.textures(rows), dataset.sampling_rate, args.seed, args.quiet)

        def save(folder):
            model.save_pretrained(str(Path(folder) / DISTILLED))
            pipe.scheduler.save_pretrained(str(Path(folder) / "scheduler"))

        finish(args, save, pipe, dataset, teacher=args.pretrained_model_name_or_path)


if __name__ == "__main__":
    run(main)

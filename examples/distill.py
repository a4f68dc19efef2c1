#!/usr/bin/env python
"""Distils a model into one that needs one step: LCTG's decoder, or DALE.

    accelerate launch examples/distill.py --model lctg --train_data_dir prepared.h5 --train_batch_size 8 \
        --pretrained_model_name_or_path runs/lctg --max_train_steps 4000 --output_dir runs/lctg_distilled

The student begins as its teacher, takes its one step with the pipeline's own sampler, and learns from recordings that
its results are distributed as they are (energy scores, `tactile_diffusers.training.energy`). The output folder is the
whole pipeline. LCTG's student stands beside its teacher as `lctg_distilled` and decodes in one step; its encoder is the
teacher's, so the same latents fit both. DALE's student takes its teacher's place: a small network learns the numbers of
a whole texture from ratings, the U-Net the rest from these.
"""

import copy

import torch
from distilling.scalars import fit_scalar_network

from tactile_diffusers import DALEModel, TactileTexturePipeline
from tactile_diffusers.data.dataset import PreparedDataset
from tactile_diffusers.io.argument_types import count, share
from tactile_diffusers.training.batches import EndlessBatches, make_collate
from tactile_diffusers.training.card import finish
from tactile_diffusers.training.dale_data import encode_dataset, training_states
from tactile_diffusers.training.launch import (
    make_accelerator,
    parse_training_arguments,
    pipeline_source,
    run,
    starting,
    training_parser,
)
from tactile_diffusers.training.loop import Trainer
from tactile_diffusers.training.one_step import DecoderStep, LatentStep
from tactile_diffusers.training.record import surfaces_of
from tactile_diffusers.training.steps import BatchNoise
from tactile_diffusers.training.validation import Reconstructions

#: Textures at most from which the scales of DALE's views are taken, and held-out ones by which it is validated.
SCALED, HELD_OUT = 8000, 1000
#: Width of DALE's network of scalars.
SCALAR_WIDTH = 256


def parse_args(argv=None):
    parser = training_parser(__doc__, learning_rate=3e-4, lr_warmup_steps=50)
    add = parser.add_argument
    add("--model", choices=["lctg", "dale"], default="lctg", help="that is distilled")
    add("--pretrained_model_name_or_path", type=pipeline_source, required=True, help="pipeline with the teacher")
    add("--detail_dropout", type=share, default=0.7, help="lctg: share of textures without detail layer")
    add("--scalar_steps", type=count, default=8000, help="dale: updates of the network of scalars, before")
    return parse_training_arguments(parser, argv)


def train_decoder(args, pipe, accelerator, dataset):
    """Distils LCTG's decoder: the pipeline's `lctg_distilled`."""
    extractor, rate = pipe.feature_extractor, dataset.sampling_rate
    held_out = None
    if args.validation_samples:
        held_out = Reconstructions(args.train_data_dir, pipe, args.validation_samples, args.eval_batch_size)

    def validate(model):
        decoded = held_out.decode(model, 1, base_only=True)
        return {"nine_band_db": held_out.nine_band_db(decoded)}

    # the student's modulation is that of recordings: nothing has to be deepened
    student = copy.deepcopy(pipe.lctg)
    student.register_to_config(distilled_steps=1, modulation_gains=None)
    step = DecoderStep(student, pipe.scheduler, extractor, args.detail_dropout)
    collate = make_collate(extractor, rate)
    trainer = Trainer(accelerator, args, step, "lctg", dataset, collate, held_out and validate, surfaces_of(dataset))
    student = trainer.run()
    if accelerator.is_main_process:
        pipe.register_modules(lctg_distilled=student)
        finish(args, pipe.save_pretrained, pipe, dataset)


def train_dale(args, pipe, accelerator, dataset):
    """Distils DALE; the result is a whole pipeline."""
    states = training_states(pipe.dale, dataset, encode_dataset(pipe, dataset, args.quiet))
    dale = DALEModel.from_config(pipe.dale.config, distilled_steps=1, scalar_width=SCALAR_WIDTH)
    dale.load_state_dict(pipe.dale.state_dict(), strict=False)
    known = {name: values for name, values in states.items() if name != "state"}
    scalars = dale.split_scalars(states["state"])[1]
    dale.scalar_network = fit_scalar_network(dale.scalar_network, scalars, known, args, args.quiet)
    dale.to(accelerator.device).scalar_network.requires_grad_(False)
    step = LatentStep(dale, pipe.dale_scheduler, states["state"][:SCALED].to(accelerator.device))
    validate = _latent_validation(args, pipe, dale, step) if args.validation_samples else None
    rows = torch.utils.data.StackDataset(**states)
    dale = Trainer(accelerator, args, step, "dale", rows, validate=validate, surfaces=surfaces_of(dataset)).run()
    if accelerator.is_main_process:
        pipe.register_modules(dale=dale)
        finish(args, pipe.save_pretrained, pipe, dataset)


def _latent_validation(args, pipe, dale, step):
    """The score on surfaces that training does not see, with the same noise each time."""
    rate = pipe.feature_extractor.sampling_rate
    held_out = PreparedDataset(args.train_data_dir, "validation", "filtered", rate, max_samples=HELD_OUT)
    held_out.set_axes(dale.config.rating_axes)
    states = training_states(dale, held_out, encode_dataset(pipe, held_out, args.quiet))
    parts = [
        dict(zip(states, part, strict=True)) for part in zip(*(v.split(128) for v in states.values()), strict=True)
    ]

    def validate(model):
        device = next(model.parameters()).device
        random = BatchNoise(torch.Generator(device).manual_seed(0), device)
        scores = [step({name: v.to(device) for name, v in part.items()}, random)[0] for part in parts]
        return {"energy": sum(scores) / len(scores)}

    return validate


def main(argv=None):
    with starting():
        args = parse_args(argv)
        pipe = TactileTexturePipeline.from_pretrained(args.pretrained_model_name_or_path)
        teacher = getattr(pipe, args.model)
        if teacher is None or teacher.config.distilled_steps is not None:
            raise ValueError(
                f"--pretrained_model_name_or_path {args.pretrained_model_name_or_path} must hold the teacher of "
                f"--model {args.model}: it has none, or one that is distilled already."
            )
        accelerator = make_accelerator(args)
        pipe.to(accelerator.device)
        if args.model == "dale":
            pipe.lctg.requires_grad_(False)
        rate = pipe.feature_extractor.sampling_rate
        dataset = PreparedDataset(args.train_data_dir, "train", "filtered", rate, max_samples=args.max_train_samples)
        EndlessBatches(len(dataset), args.train_batch_size, args.seed, 0, accelerator.num_processes)  # or refuses now
        if args.model == "dale":
            dataset.set_axes(teacher.config.rating_axes)
    {"lctg": train_decoder, "dale": train_dale}[args.model](args, pipe, accelerator, dataset)


if __name__ == "__main__":
    run(main)

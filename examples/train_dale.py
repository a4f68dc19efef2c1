#!/usr/bin/env python
"""Trains DALE, ratings to latents, level and friction coefficient, on latents of a frozen LCTG (paper section 2.3).

    accelerate launch examples/train_dale.py --train_data_dir prepared.h5 \
        --pretrained_model_name_or_path runs/lctg --output_dir runs/pipeline

The output folder is the whole pipeline: TactileTexturePipeline.from_pretrained("runs/pipeline").
"""

from pathlib import Path

import numpy as np
import torch

from tactile_diffusers import TactileTexturePipeline, VDDIMScheduler
from tactile_diffusers.data.dataset import PreparedDataset
from tactile_diffusers.io.argument_types import count, not_negative, share
from tactile_diffusers.schedulers import RECOMMENDED
from tactile_diffusers.training.batches import EndlessBatches
from tactile_diffusers.training.card import finish
from tactile_diffusers.training.checkpoints import writing
from tactile_diffusers.training.dale_data import (
    build_dale,
    describe_scores,
    encode_dataset,
    fit_rating_estimator,
    training_states,
)
from tactile_diffusers.training.fitting import MODULATION_TEXTURES, fit_modulation_gains
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
from tactile_diffusers.training.steps import DALETrainingStep, state_losses
from tactile_diffusers.training.validation import plot_axis_sweep


def parse_args(argv=None):
    parser = training_parser(__doc__, train_batch_size=64)
    add = parser.add_argument
    add("--pretrained_model_name_or_path", type=pipeline_source, required=True, help="pipeline with LCTG, or bundled")
    add(
        "--model_config_name_or_path",
        help="JSON: dale and dale_scheduler arguments (null: as the data say), kept_at_zero",
    )
    add("--max_train_surfaces", type=count, help="use only this many training surfaces, evenly spread")
    add(
        "--ratings",
        choices=["pooled", "single"],
        default="pooled",
        help="each surface's mean over raters, or another single rater's each time (as in the paper)",
    )
    add("--condition_dropout", type=share, default=0.4, help="probability of dropping each axis")
    add("--unconditional", type=share, default=0.1, help="probability of dropping all axes")
    add("--rating_jitter", type=not_negative, default=0.3, help="noise on pooled ratings, in their standard errors")
    add("--scalar_weight", type=not_negative, default=3.0, help="loss weight of level, friction and other scalars")
    add("--conditioning_weight", type=not_negative, default=0.1, help="of the auxiliary rating loss; 0 = off")
    add("--rating_head_steps", type=count, default=600, help="updates of the rating estimator")
    return parse_training_arguments(parser, argv)


def read_datasets(args, sampling_rate):
    """The training view, and up to 2,000 segments of surfaces that training does not see."""
    limits = {"max_samples": args.max_train_samples, "max_surfaces": args.max_train_surfaces}
    dataset = PreparedDataset(args.train_data_dir, "train", "filtered", sampling_rate, **limits)
    if args.ratings == "single" and dataset.ratings.single is None:
        raise ValueError("--ratings single: the file holds no single raters' ratings; prepare the data again.")
    held_out = PreparedDataset(args.train_data_dir, "validation", "filtered", sampling_rate, max_samples=2000)
    return dataset.set_axes(), held_out.set_axes()


def fit_estimator(args, accelerator, dale, dataset, states, held_out, held_out_states):
    """The rating estimator of the auxiliary loss, frozen; `None` if no surface is rated."""
    if torch.isnan(states["ratings"]).all():
        accelerator.print("No surface is rated: DALE learns how textures are distributed, without control by ratings.")
        args.conditioning_weight = 0.0
        return None
    pooled, held_out_pooled = (
        torch.cat([dale.pool_state(part) for part in part_of["state"].split(512)])
        for part_of in (states, held_out_states)
    )
    estimator, scores = fit_rating_estimator(
        dale.channel_groups,
        pooled,
        torch.from_numpy(dataset.ratings.mean[dataset.surface_ids]).float(),
        held_out_pooled,
        held_out_states["ratings"],
        dale.config.rating_axes,
        steps=args.rating_head_steps,
        seed=args.seed,
    )
    rated = np.isfinite(held_out.ratings.mean[np.unique(held_out.surface_ids)]).any(axis=1).sum()
    accelerator.print("rating estimator, R² on unseen surfaces:", describe_scores(scores, rated))
    return estimator.to(accelerator.device)


def make_validation(args, pipe, dale_scheduler, held_out):
    """Velocity error on unseen surfaces with and without their ratings, and one axis swept (picture)."""
    count = min(args.validation_samples * 4, len(held_out["state"]))
    rows = torch.randperm(len(held_out["state"]), generator=torch.Generator().manual_seed(0))[:count]
    clean, ratings, *counted = (held_out[name][rows] for name in ("state", "ratings", "knows_friction", "weight"))
    noise = torch.randn(clean.shape, generator=torch.Generator().manual_seed(1))
    scheduler = VDDIMScheduler.from_config(dale_scheduler.config)
    timesteps = torch.linspace(0, scheduler.config.num_train_timesteps - 1, count)
    noisy, target = scheduler.add_noise(clean, noise, timesteps), scheduler.get_velocity(clean, noise, timesteps)

    def validate(model):
        device = next(model.parameters()).device
        losses = {}
        for name, condition in (("rated", ratings), ("unrated", torch.full_like(ratings, torch.nan))):
            parts = zip(noisy.split(64), timesteps.split(64), condition.split(64), strict=True)
            velocity = torch.cat([model(*(p.to(device) for p in part), return_dict=False)[0].cpu() for part in parts])
            field, scalars = state_losses(model, velocity - target, *counted)
            losses |= {f"velocity_{name}": field, f"scalars_{name}": scalars}
        whole = TactileTexturePipeline(
            **pipe.components | {"dale": model, "dale_scheduler": scheduler, "rating_estimator": None}
        )
        whole.set_progress_bar_config(disable=True)
        with writing("validation.png", args.output_dir):
            plot_axis_sweep(whole, Path(args.output_dir) / "validation.png", takes=8)
        return losses

    return validate


def main(argv=None):
    with starting():
        args = parse_args(argv)
        config = read_model_config(args.model_config_name_or_path, {"dale", "dale_scheduler", "kept_at_zero"})
        pipe = TactileTexturePipeline.from_pretrained(args.pretrained_model_name_or_path)
        accelerator = make_accelerator(args)
        if pipe.dale is not None:
            known = "this training begins anew. To keep what it knows: tactile-diffusers adapt"
            accelerator.print(f"The DALE of {args.pretrained_model_name_or_path} is left out: {known}")
        pipe.to(accelerator.device)
        pipe.lctg.requires_grad_(False)
        dataset, held_out = read_datasets(args, pipe.feature_extractor.sampling_rate)
        EndlessBatches(len(dataset), args.train_batch_size, args.seed, 0, accelerator.num_processes)  # or refuses now
    latents = encode_dataset(pipe, dataset, args.quiet)
    settings = {name: value for name, value in config.get("dale", {}).items() if value is not None}
    if pipe.feature_extractor.fixed_scale:
        settings["level_std"] = 0.0  # the level is in the latents
    dale = build_dale(pipe.lctg, dataset, latents, **settings)
    for name in config.get("kept_at_zero", ()):  # parts that a configuration of the paper does without
        for parameter in dale.get_submodule(name).requires_grad_(False).parameters():
            torch.nn.init.zeros_(parameter)
    dale_scheduler = VDDIMScheduler(**RECOMMENDED | config.get("dale_scheduler", {}))
    states = training_states(dale, dataset, latents, single_raters=args.ratings == "single")
    held_out_states = training_states(dale, held_out, encode_dataset(pipe, held_out, args.quiet))
    estimator = fit_estimator(args, accelerator, dale, dataset, states, held_out, held_out_states)
    step = DALETrainingStep(
        dale,
        dale_scheduler,
        estimator,
        condition_dropout=args.condition_dropout,
        unconditional=args.unconditional,
        rating_jitter=args.rating_jitter,
        scalar_weight=args.scalar_weight,
        conditioning_weight=args.conditioning_weight,
    )
    validate = make_validation(args, pipe, dale_scheduler, held_out_states) if args.validation_samples else None
    rows = torch.utils.data.StackDataset(**states)
    trainer = Trainer(accelerator, args, step, "dale", rows, validate=validate, surfaces=surfaces_of(dataset))
    dale = trainer.run()
    if accelerator.is_main_process:
        rows = dataset.non_overlapping(1)[:MODULATION_TEXTURES]
        fit_modulation_gains(pipe, dale, dataset.textures(rows), dataset.sampling_rate, args.seed, args.quiet)
        estimator = estimator and estimator.cpu()
        pipe = TactileTexturePipeline(
            **pipe.components | {"dale": dale, "dale_scheduler": dale_scheduler, "rating_estimator": estimator}
        )
        finish(args, pipe.save_pretrained, pipe, dataset)


if __name__ == "__main__":
    run(main)

#!/usr/bin/env python
"""Trains DALE, ratings to latents, level and friction coefficient, on latents of a frozen LCTG (paper section 2.3).

    accelerate launch examples/train_dale.py --train_data_dir prepared.h5 \
        --pretrained_model_name_or_path runs/lctg --output_dir runs/pipeline

The output folder is the whole pipeline: TactileTexturePipeline.from_pretrained("runs/pipeline").
"""

import argparse
from pathlib import Path

import numpy as np
import torch
from torch import nn
from tqdm.auto import tqdm

from tactile_diffusers import DALEModel, TactileTexturePipeline, VDDIMScheduler
from tactile_diffusers.data import PreparedDataset
from tactile_diffusers.data.ratings import rating_coverage, rating_quantiles
from tactile_diffusers.models.dale import NUM_SCALARS, latent_statistics
from tactile_diffusers.schedulers import RECOMMENDED
from tactile_diffusers.training.arguments import (
    add_hub_arguments,
    add_training_arguments,
    check_model_folder,
    check_not_negative,
    parse_training_arguments,
    read_model_config,
)
from tactile_diffusers.training.checkpoints import writing
from tactile_diffusers.training.draws import Draws
from tactile_diffusers.training.ending import finish
from tactile_diffusers.training.figures import plot_axis_sweep
from tactile_diffusers.training.loop import Trainer, make_accelerator
from tactile_diffusers.training.losses import rating_loss
from tactile_diffusers.training.modulation import MODULATION_TEXTURES, fit_modulation_gains
from tactile_diffusers.training.rating_head import fit_rating_estimator, scores_in_words
from tactile_diffusers.training.refusals import run, starting
from tactile_diffusers.training.surfaces import surfaces_of


def parse_args(argv=None):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_training_arguments(parser)
    add_hub_arguments(parser)
    parser.set_defaults(train_batch_size=64)
    parser.add_argument("--pretrained_model_name_or_path", required=True, help="pipeline folder with the trained LCTG")
    parser.add_argument("--model_config_name_or_path", help="JSON with dale and dale_scheduler arguments")
    parser.add_argument("--condition_dropout", type=float, default=0.4, help="probability of dropping each axis")
    parser.add_argument("--unconditional", type=float, default=0.1, help="probability of dropping all axes")
    parser.add_argument("--max_train_surfaces", type=int, help="use only this many training surfaces, evenly spread")
    parser.add_argument(
        "--ratings",
        choices=["pooled", "single"],
        default="pooled",
        help="each surface's mean over raters, or another single rater's each time (as in the paper)",
    )
    parser.add_argument(
        "--rating_jitter", type=float, default=0.3, help="spread of the ratings in units of their mean's standard error"
    )
    parser.add_argument(
        "--scalar_weight", type=float, default=3.0, help="loss weight of what a whole texture has one of"
    )
    parser.add_argument("--conditioning_weight", type=float, default=0.1, help="of the auxiliary loss; 0 = off")
    parser.add_argument(
        "--rating_head_steps", type=int, default=600, help="updates of the rating estimator, saved and auxiliary loss"
    )
    args = parse_training_arguments(parser, argv)
    for name in ("rating_head_steps", "validation_samples", "max_train_surfaces"):
        if getattr(args, name) is not None and getattr(args, name) < 1:
            raise ValueError(f"--{name} must be at least 1, got {getattr(args, name)}.")
    for name in ("condition_dropout", "unconditional"):
        if not 0 <= getattr(args, name) <= 1:
            raise ValueError(f"--{name} must lie in [0, 1], got {getattr(args, name)}.")
    check_not_negative(args, "rating_jitter", "scalar_weight", "conditioning_weight")
    return args


def state_losses(dale, difference, knows_friction, weight):
    """Mean squared error of the velocity: of what varies over the texture, and of the numbers of the whole.

    Args:
        dale (`DALEModel`): says what is read of a state.
        difference (`torch.Tensor`): (batch, in_channels, frames), velocity minus its target.
        knows_friction (`torch.Tensor`): (batch,) bool; an unknown friction coefficient counts nothing.
        weight (`torch.Tensor`): (batch,) how much each texture counts.
    """
    squares = dale.pool_state(difference.float()).square() * weight[:, None, None]
    learned, departures, scalars = squares.split(dale.channel_groups, dim=1)
    known = torch.ones_like(scalars[..., 0])
    known[:, -1] = knows_friction
    return sum(part.mean() for part in (learned, departures) if part.numel()), (scalars.mean(-1) * known).mean()


class DALETrainingStep(nn.Module):
    """The v-objective in latent space, with dropped ratings and the auxiliary conditioning loss.

    `share`: index of this process and number of processes, for `Draws`.
    """

    def __init__(self, model, scheduler, head, args, share=(0, 1)):
        super().__init__()
        self.model, self.scheduler, self.args, self.share = model, scheduler, args, share
        self.head = [head]  # in a list: frozen, so no part of what is trained, averaged or saved

    def forward(self, batch, generator):
        args, clean, device = self.args, batch["state"], batch["state"].device
        draws = Draws(generator, device, self.share)
        ratings = batch["ratings"]
        if args.ratings == "single":  # of another rater for each texture
            rater = (draws.uniform(len(clean)) * ratings.shape[1]).long()
            ratings = ratings[torch.arange(len(clean), device=device), rater]
        else:
            ratings = ratings + args.rating_jitter * batch["ratings_error"] * draws.normal(*ratings.shape)
        dropped = draws.uniform(*ratings.shape) < args.condition_dropout
        dropped = dropped | (draws.uniform(len(ratings), 1) < args.unconditional)
        ratings = ratings.masked_fill(dropped, torch.nan)

        noise = draws.normal(*clean.shape)
        timesteps = draws.strata(len(clean)) * self.scheduler.config.num_train_timesteps - 1
        noisy = self.scheduler.add_noise(clean, noise, timesteps)
        velocity = self.model(noisy, timesteps, ratings, return_dict=False)[0].float()
        target = self.scheduler.get_velocity(clean, noise, timesteps)

        latent_loss, scalar_loss = state_losses(self.model, velocity - target, batch["knows_friction"], batch["weight"])
        loss = latent_loss + args.scalar_weight * scalar_loss
        scalars = {"velocity": latent_loss.detach(), "scalars": scalar_loss.detach()}
        if args.conditioning_weight:
            predicted = self.model.pool_state(self.scheduler.get_original_sample(velocity, noisy, timesteps))
            # far from the data x0 is hardly known: weight cos^2 phi
            weight = self.scheduler.angle(timesteps).cos().square()
            heard = self.head[0](predicted, batch["knows_friction"])
            conditioning = (weight * batch["weight"] * rating_loss(heard, ratings)).mean()
            loss = loss + args.conditioning_weight * conditioning
            scalars["conditioning"] = conditioning.detach()
        return loss, scalars


def encode_dataset(pipe, dataset, quiet, batch_size=64):
    """Base layers of all segments: (n, base_channels, frames) float32. The encoder is frozen, so once is enough."""
    latents = []
    for start in tqdm(range(0, len(dataset), batch_size), disable=quiet, desc="latents"):
        rows = dataset.textures(np.arange(start, min(start + batch_size, len(dataset))))
        made = pipe.encode(rows, dataset.sampling_rate).latents[:, : pipe.lctg.base_channels]
        latents.append(made.float().cpu())
    return torch.cat(latents)


def statistics(values):
    """Mean and standard deviation as floats; (`None`, `None`) where nothing is known."""
    values = np.asarray(values, dtype=np.float64)
    values = values[np.isfinite(values)]
    return (float(values.mean()), float(max(values.std(), 1e-3))) if len(values) else (None, None)


def rating_statistics(dataset):
    """What DALE's config keeps of the training surfaces' ratings, for `rating_scale`; nothing if an axis has none."""
    ratings = dataset.surface_ratings[np.unique(dataset.surface_ids)]
    quantiles = rating_quantiles(ratings)
    if np.isnan(quantiles).any():
        return {}
    coverage = rating_coverage(ratings)
    found = {}
    if coverage is not None:
        centre, covariance, reach = coverage
        found = {"centre": centre.tolist(), "covariance": covariance.tolist(), "reach": reach}
    return found | {
        "mean": dataset.ratings_mean.tolist(),
        "std": dataset.ratings_scale.tolist(),
        "range": quantiles[:, [0, -1]].tolist(),
        "quantiles": quantiles.tolist(),
    }


def build_dale(config, pipe, dataset, latents):
    """A new DALE whose config holds the statistics of the training set."""
    level_mean, level_std = statistics(dataset.levels)
    levels = pipe.lctg.level_channels
    patch_size = config.get("dale", {}).get("patch_size", 4 if levels else 1)
    friction_mean, friction_std = statistics(np.log(np.maximum(dataset.friction_coefficients, 1e-3)))
    settings = {
        "in_channels": pipe.lctg.base_channels + levels + NUM_SCALARS,
        "latent_frames": latents.shape[-1],
        "level_channels": levels,
        "patch_size": patch_size,
        **latent_statistics(latents, levels, patch_size),
        "level_mean": level_mean,
        "level_std": level_std,
        "log_friction_mean": friction_mean,
        "log_friction_std": friction_std,
        "rating_statistics": rating_statistics(dataset),
        "reference_speed": statistics(dataset.speeds)[0],
        **config.get("dale", {}),
    }
    return DALEModel(**settings), VDDIMScheduler(**{**RECOMMENDED, **config.get("dale_scheduler", {})})


def make_states(dale, dataset, latents, single=False):
    """Per segment: the clean state, its ratings with their standard error, and how much it counts.

    Surfaces count alike, however many segments they have: within limits of force and speed that is a matter of how they
    are explored, which depends on what they feel like. Weights end at four times the mean. `single`: ratings are
    (n, raters, axes), of single raters.
    """
    friction = torch.from_numpy(np.asarray(dataset.friction_coefficients, dtype=np.float32))
    level = torch.from_numpy(np.asarray(dataset.levels, dtype=np.float32))
    surfaces = dataset.surface_ids
    ratings = np.moveaxis(dataset.single_ratings, 0, 1) if single else dataset.surface_ratings
    counts = np.bincount(surfaces)
    weight = np.minimum(1 / counts[surfaces], 4 * np.mean(1 / counts[surfaces]))
    error = dataset.surface_ratings_std / np.sqrt(np.maximum(dataset.surface_ratings_count, 1))
    return {
        "state": torch.cat(
            [dale.pack(*parts) for parts in zip(latents.split(512), level.split(512), friction.split(512), strict=True)]
        ),
        "ratings": torch.from_numpy(ratings[surfaces].astype(np.float32)),
        "ratings_error": torch.nan_to_num(torch.from_numpy(error[surfaces].astype(np.float32))),
        "knows_friction": torch.isfinite(friction),
        "weight": torch.from_numpy((weight / weight.mean()).astype(np.float32)),
    }


class Rows(torch.utils.data.Dataset):
    """Rows of equally long tensors, as dicts; `trained_on` says of which surfaces, for `training.json`."""

    def __init__(self, tensors, trained_on=None):
        self.tensors, self.trained_on = tensors, trained_on

    def __len__(self):
        return len(next(iter(self.tensors.values())))

    def __getitem__(self, index):
        return {name: values[index] for name, values in self.tensors.items()}


def make_validation(args, pipe, dale_scheduler, held_out):
    """Velocity error on unseen surfaces with and without their ratings, and one axis swept (picture)."""
    count = min(args.validation_samples * 4, len(held_out["state"]))
    rows = torch.randperm(len(held_out["state"]), generator=torch.Generator().manual_seed(0))[:count]
    clean, ratings, *counted = (held_out[name][rows] for name in ("state", "ratings", "knows_friction", "weight"))
    noise = torch.randn(clean.shape, generator=torch.Generator().manual_seed(1))
    scheduler = VDDIMScheduler.from_config(dale_scheduler.config)
    timesteps = torch.linspace(0, scheduler.config.num_train_timesteps - 1, count)
    noisy, target = scheduler.add_noise(clean, noise, timesteps), scheduler.get_velocity(clean, noise, timesteps)

    def validate(model, step):
        device = next(model.parameters()).device
        losses = {}
        for name, condition in (("rated", ratings), ("unrated", torch.full_like(ratings, torch.nan))):
            parts = zip(noisy.split(64), timesteps.split(64), condition.split(64), strict=True)
            velocity = torch.cat([model(*(p.to(device) for p in part), return_dict=False)[0].cpu() for part in parts])
            losses[f"velocity_{name}"], losses[f"scalars_{name}"] = state_losses(model, velocity - target, *counted)
        whole = TactileTexturePipeline(
            lctg=pipe.lctg,
            feature_extractor=pipe.feature_extractor,
            scheduler=pipe.scheduler,
            dale=model,
            dale_scheduler=scheduler,
        )
        whole.set_progress_bar_config(disable=True)
        with writing("validation.png", args.output_dir):
            plot_axis_sweep(whole, Path(args.output_dir) / "validation.png", takes=8)
        return losses

    return validate


def main(argv=None):
    with starting():
        args = parse_args(argv)
        check_model_folder(args.pretrained_model_name_or_path)
        config = read_model_config(args.model_config_name_or_path, {"dale", "dale_scheduler"})
        pipe = TactileTexturePipeline.from_pretrained(args.pretrained_model_name_or_path, cache_dir=args.cache_dir)
        accelerator = make_accelerator(args)
        pipe.to(accelerator.device)
        pipe.lctg.requires_grad_(False)
        rate = pipe.feature_extractor.sampling_rate
        limits = {"max_samples": args.max_train_samples, "max_surfaces": args.max_train_surfaces}
        dataset = PreparedDataset(args.train_data_dir, "train", "filtered", rate, **limits)
        if args.ratings == "single" and dataset.single_ratings is None:
            raise ValueError("--ratings single: the file holds no single raters' ratings; prepare the data again.")
        held_out = PreparedDataset(args.train_data_dir, "validation", "filtered", rate, max_samples=2000)
    latents = encode_dataset(pipe, dataset, args.quiet)
    dale, dale_scheduler = build_dale(config, pipe, dataset, latents)
    states = make_states(dale, dataset, latents, single=args.ratings == "single")
    held_out_states = make_states(dale, held_out, encode_dataset(pipe, held_out, args.quiet))
    del latents
    head = None
    if torch.isnan(states["ratings"]).all():
        accelerator.print("No surface is rated: DALE learns how textures are distributed, and no ratings steer it.")
        args.conditioning_weight = 0.0
    else:
        head, scores = fit_rating_estimator(
            dale.channel_groups,
            torch.cat([dale.pool_state(part) for part in states["state"].split(512)]),
            torch.from_numpy(dataset.surface_ratings[dataset.surface_ids]).float(),
            torch.cat([dale.pool_state(part) for part in held_out_states["state"].split(512)]),
            held_out_states["ratings"],
            dale.config.rating_axes,
            steps=args.rating_head_steps,
            seed=args.seed,
        )
        rated = np.isfinite(held_out.surface_ratings[np.unique(held_out.surface_ids)]).any(axis=1).sum()
        accelerator.print("rating estimator, R² on unseen surfaces:", scores_in_words(scores, rated))
        head.to(accelerator.device)
    trainer = Trainer(
        accelerator,
        args,
        DALETrainingStep(dale, dale_scheduler, head, args, (accelerator.process_index, accelerator.num_processes)),
        "dale",
        Rows(states, surfaces_of(dataset)),
        None,
        make_validation(args, pipe, dale_scheduler, held_out_states),
    )
    dale = trainer.run()
    if accelerator.is_main_process:
        rows = dataset.non_overlapping(1)[:MODULATION_TEXTURES]
        fit_modulation_gains(pipe, dale, dataset.textures(rows), dataset.sampling_rate, args.seed, args.quiet)
        whole = TactileTexturePipeline(
            lctg=pipe.lctg,
            feature_extractor=pipe.feature_extractor,
            scheduler=pipe.scheduler,
            dale=dale,
            dale_scheduler=dale_scheduler,
            rating_estimator=None if head is None else head.cpu(),
        )
        finish(args, whole.save_pretrained, whole, dataset)


if __name__ == "__main__":
    run(main)

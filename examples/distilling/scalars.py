"""Trains the network that generates the numbers of a whole texture, `DALEModel.scalar_network`."""

import copy

import torch
from diffusers.optimization import get_scheduler
from tqdm.auto import tqdm

from tactile_diffusers.training.energy import energy_score
from tactile_diffusers.training.steps import BatchNoise, drawn_ratings

BATCH, LEARNING_RATE, WARMUP, AVERAGED = 256, 1e-3, 100, 0.998


def scalar_views(scalars):
    """Views of scalars (batch, n): each alone, because among all of them one hardly moves a distance; all together."""
    return [scalars[..., None], scalars[:, None]]


def fit_scalar_network(network, scalars, states, args, quiet=False):
    """Trains a network by energy scores of two results for each texture's ratings, and returns the averaged one.

    Args:
        network (`ScalarNetwork`): is trained.
        scalars (`torch.Tensor`): (n, scalars) of the textures, at unit variance.
        states (`dict[str, torch.Tensor]`): their ratings, weights and so on, of `training_states`.
        args (`argparse.Namespace`): `scalar_steps`, updates, and `seed`.
        quiet (`bool`): no progress bar.
    """
    generator, averaged = torch.Generator().manual_seed(args.seed), copy.deepcopy(network)
    random = BatchNoise(generator, torch.device("cpu"))
    optimizer = torch.optim.AdamW(network.parameters(), lr=LEARNING_RATE)
    schedule = get_scheduler("cosine", optimizer, num_warmup_steps=WARMUP, num_training_steps=args.scalar_steps)
    for step in tqdm(range(args.scalar_steps), disable=quiet, desc="scalars"):
        rows = torch.randint(len(scalars), (BATCH,), generator=generator)
        batch, real = {name: values[rows] for name, values in states.items()}, scalars[rows]
        ratings = drawn_ratings(batch, random)
        made = [_known(network(random.normal(*real.shape), ratings), real, batch) for _ in range(2)]
        loss = energy_score(*map(scalar_views, (*made, real)), batch["weight"])
        optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimizer.step()
        schedule.step()
        with torch.no_grad():
            for mean, value in zip(averaged.parameters(), network.parameters(), strict=True):
                mean.lerp_(value, 1 - min(AVERAGED, 1 - (2 + step) ** -0.75))
    return averaged


def _known(made, real, batch):
    """Results (batch, scalars) whose friction is the real one where that is not known: nothing is learned of it."""
    friction = torch.where(batch["knows_friction"], made[:, -1], real[:, -1])
    return torch.cat([made[:, :-1], friction[:, None]], dim=1)

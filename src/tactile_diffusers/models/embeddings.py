"""Embeddings of the diffusion time and of perceptual ratings."""

import math

import torch
from torch import nn

from ..schedulers.angles import to_fraction


def sinusoidal_embedding(values, dim, min_frequency, max_frequency):
    """Sines and cosines of `values` at `dim // 2` logarithmically spaced frequencies.

    Args:
        values (`torch.Tensor`): any shape; computed in float32 whatever the dtype.
        dim (`int`): even number of features.
        min_frequency, max_frequency (`float`): radians per unit of `values`.

    Returns:
        `torch.Tensor`: (*values.shape, dim), float32.
    """
    exponents = torch.linspace(0.0, 1.0, dim // 2, dtype=torch.float32, device=values.device)
    frequencies = min_frequency * torch.exp(exponents * math.log(max_frequency / min_frequency))
    angles = values.float()[..., None] * frequencies
    return torch.cat([angles.sin(), angles.cos()], dim=-1)


def expand_timestep(timestep, sample):
    """A timestep given as a number, a 0-d or a 1-d tensor, as (batch,) float32 on the device of `sample`."""
    timestep = torch.as_tensor(timestep, dtype=torch.float32, device=sample.device)
    return timestep.reshape(-1).expand(sample.shape[0])


class TimestepEmbedder(nn.Module):
    """Sinusoids of t in [-1, num_train_timesteps - 1] and a two-layer perceptron: (batch,) -> (batch, dim)."""

    def __init__(self, dim, num_train_timesteps=1000, sinusoids=64):
        super().__init__()
        self.num_train_timesteps, self.sinusoids = num_train_timesteps, sinusoids
        self.linear_1 = nn.Linear(sinusoids, dim)
        self.act = nn.SiLU()
        self.linear_2 = nn.Linear(dim, dim)

    def forward(self, timestep, dtype):
        fraction = to_fraction(timestep.float(), self.num_train_timesteps)
        embedding = sinusoidal_embedding(fraction, self.sinusoids, 1.0, 100.0)  # float32, then cast
        return self.linear_2(self.act(self.linear_1(embedding.to(dtype))))


class RatingEmbedder(nn.Module):
    """One token per perceptual axis (paper section 2.2: ratings "embedded using sinusoidal projections").

    A rating that is not specified (NaN) becomes the axis's learned null token. The rating itself stands beside its
    sinusoids. These are slow: a texture's response to a rating is smooth, and raters disagree by half a z-score.

    Args:
        axes (`int`): number of perceptual axes.
        dim (`int`): width of the tokens.
        sinusoids (`int`, defaults to 32): features per rating; periods from about 3 to 25 z-score units.
    """

    def __init__(self, axes, dim, sinusoids=32):
        super().__init__()
        self.sinusoids = sinusoids
        self.linear_1 = nn.Linear(sinusoids + 1, dim)
        self.act = nn.SiLU()
        self.linear_2 = nn.Linear(dim, dim)
        self.axis_tokens = nn.Parameter(torch.zeros(axes, dim))
        self.null_tokens = nn.Parameter(torch.randn(axes, dim) * 0.02)

    def forward(self, ratings, dtype):
        """(batch, axes) ratings in z-scores, NaN = not specified -> tokens (batch, axes, dim) in `dtype`."""
        unspecified = torch.isnan(ratings)
        ratings = torch.where(unspecified, torch.zeros_like(ratings), ratings).float()
        features = torch.cat([sinusoidal_embedding(ratings, self.sinusoids, 0.25, 2.0), ratings[..., None]], dim=-1)
        tokens = self.linear_2(self.act(self.linear_1(features.to(dtype)))) + self.axis_tokens
        return torch.where(unspecified[..., None], self.null_tokens, tokens)

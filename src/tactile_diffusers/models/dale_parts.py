"""Parts of DALE beside its U-Net: what it returns and prepares, and its network of scalars."""

from dataclasses import dataclass
from typing import NamedTuple

import torch
from diffusers.utils import BaseOutput
from torch import nn

#: Residual blocks of `ScalarNetwork`.
DEPTH = 3


@dataclass
class DALEOutput(BaseOutput):
    """Output of `DALEModel`: `sample` is the velocity v, (batch, in_channels, latent_frames)."""

    sample: torch.Tensor


class DALEConditions(NamedTuple):
    """What a velocity at one timestep does not take from the sample (`DALEModel.condition`).

    Attributes:
        blocks (`list[BlockConditions]`): of each block of the U-Net.
        ratings (`torch.Tensor`): (batch, axes) in z-scores.
        shift (`torch.Tensor` or `None`): of the scalars, (batch, num_scalars), if the model is calibrated.
    """

    blocks: list
    ratings: torch.Tensor
    shift: torch.Tensor | None


class ScalarNetwork(nn.Module):
    """Noise and ratings to the scalars of DALE's state, at unit variance.

    A U-Net sees a hundred textures in the time in which this network sees ten thousand: how ratings move the numbers of
    a texture is learned here.

    Args:
        scalars (`int`): how many there are, of noise too.
        axes (`int`): perceptual axes.
        width (`int`): of the layers.
    """

    def __init__(self, scalars, axes, width):
        super().__init__()
        self.first = nn.Linear(scalars + 2 * axes, width)
        self.blocks = nn.ModuleList(
            nn.Sequential(nn.LayerNorm(width), nn.Linear(width, width), nn.SiLU(), nn.Linear(width, width))
            for _ in range(DEPTH)
        )
        self.last = nn.Linear(width, scalars)

    def forward(self, noise, ratings):
        """Noise (batch, scalars) and ratings (batch, axes) in z-scores, NaN = not specified, to (batch, scalars)."""
        open_axes = torch.isnan(ratings)
        inputs = [noise, torch.nan_to_num(ratings).to(noise), open_axes.to(noise)]
        hidden = self.first(torch.cat(inputs, dim=1))
        for block in self.blocks:
            hidden = hidden + block(hidden)
        return self.last(hidden)

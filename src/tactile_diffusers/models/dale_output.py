"""What `DALEModel` returns."""

from dataclasses import dataclass
from typing import NamedTuple

import torch
from diffusers.utils import BaseOutput


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

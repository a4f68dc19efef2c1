"""What the pipeline returns."""

from dataclasses import dataclass

import numpy as np
import torch
from diffusers.utils import BaseOutput


@dataclass
class TactileTexturePipelineOutput(BaseOutput):
    """Textures and the numbers that belong to them; N = ratings x textures per rating, rating by rating.

    Args:
        textures (`np.ndarray` or `torch.Tensor`): (N, samples) float32, N, zero mean.
        friction_coefficient (`np.ndarray` or `torch.Tensor`): (N,) float32; NaN where nothing generated it.
        level (`np.ndarray` or `torch.Tensor`): (N,) float32, natural log of the RMS in N.
        sampling_rate (`int`): of `textures`, Hz.
        reference_speed (`float`): finger speed at which the textures are felt as recorded, mm/s; NaN if unknown.
    """

    textures: np.ndarray | torch.Tensor
    friction_coefficient: np.ndarray | torch.Tensor
    level: np.ndarray | torch.Tensor
    sampling_rate: int
    reference_speed: float


@dataclass
class TactileLatents(BaseOutput):
    """Shape and gain of textures, apart.

    Args:
        latents (`torch.Tensor`): (N, latent_channels, latent_frames); zeros in the detail layer of generated ones.
        level (`torch.Tensor`): (N,) float32, natural log of the RMS in N.
        friction_coefficient (`torch.Tensor`): (N,) float32; NaN if unknown.
    """

    latents: torch.Tensor
    level: torch.Tensor
    friction_coefficient: torch.Tensor

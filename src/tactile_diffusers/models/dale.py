"""DALE, the Diffusion Adjective-to-Latent Encoder: ratings to latents, level and friction (paper section 2.2)."""

import math
from dataclasses import dataclass
from itertools import pairwise

import torch
from diffusers.configuration_utils import ConfigMixin, register_to_config
from diffusers.models.attention import AttentionMixin
from diffusers.models.modeling_utils import ModelMixin
from diffusers.utils import BaseOutput

from ..signal import RATING_AXES
from .embeddings import RatingEmbedder, TimestepEmbedder, expand_timestep
from .unet_1d import UNet1D

#: numbers that describe a whole texture and are generated with the latents: level and log friction coefficient
NUM_SCALARS = 2


def _check_quantiles(quantiles, axes):
    lengths = {len(row) for row in quantiles}
    ascending = all(low <= high for row in quantiles for low, high in pairwise(row))
    if len(quantiles) != len(axes) or len(lengths) != 1 or min(lengths) < 2 or not ascending:
        raise ValueError(
            f"`ratings_quantiles` must hold one row of ascending numbers, at least two and equally many, for each of "
            f"the axes {list(axes)}, got {quantiles}. `tactile_diffusers.data.ratings.rating_quantiles` makes them."
        )


@dataclass
class DALEOutput(BaseOutput):
    """Output of `DALEModel`: `sample` is the velocity v, (batch, in_channels, latent_frames)."""

    sample: torch.Tensor


class DALEModel(ModelMixin, ConfigMixin, AttentionMixin):
    r"""
    Velocity network in the latent space of LCTG, steered by perceptual ratings through cross-attention at every level.

    Its state is (batch, latent_channels + 2, latent_frames). The last two channels carry level and log friction
    coefficient, one number each: the sum of the channel over time, divided by sqrt(latent_frames), so that noise and
    number both have unit variance and a few solver steps serve them as well as the latents. Only that sum is read.
    This model inherits from [`ModelMixin`].

    Args:
        in_channels (`int`, *optional*, defaults to 18): channels of LCTG's latents, and two more.
        latent_frames (`int`, *optional*, defaults to 64): frames of one segment, the length it was trained on.
        rating_axes (`list[str]`, *optional*): names of the perceptual axes, in the order of `ratings`.
        widths (`list[int]`, *optional*): channels of the levels, multiples of 32.
        embedding_dim (`int`, *optional*, defaults to 256): width of the time embedding.
        cross_attention_dim (`int`, *optional*, defaults to 128): width of the rating tokens.
        kernel_size (`int`, *optional*, defaults to 3): length of all convolutions.
        latent_mean, latent_std (`list[float]`, *optional*): statistics of each latent channel over the training set.
        level_mean, level_std (`float`, *optional*): of the level, natural log of the RMS in N.
        log_friction_mean, log_friction_std (`float`, *optional*): of the log friction coefficient; `None` = unknown in
            training, then it is NaN in what is generated.
        ratings_mean, ratings_std (`list[float]`, *optional*): mean and standard deviation of a typical rater's raw
            scores (0-8) per axis: raw = mean + std * z.
        ratings_range (`list[list[float]]`, *optional*): smallest and largest rating per axis of the training surfaces.
        ratings_quantiles (`list[list[float]]`, *optional*): for each axis the quantiles of the training surfaces'
            ratings at equally spaced shares from 0 to 1, ascending (`data.ratings.rating_quantiles`).
        reference_speed (`float`, *optional*): mean finger speed of the training segments, mm/s; `None` = unknown.
        num_train_timesteps (`int`, *optional*, defaults to 1000): length of the time axis, t in [-1, 999].
    """

    _supports_gradient_checkpointing = True
    _no_split_modules = ["ResnetBlock1D"]
    _repeated_blocks = ["ResnetBlock1D"]
    _skip_layerwise_casting_patterns = ["norm", "time", "rating", "context_scale"]

    @register_to_config
    def __init__(
        self,
        in_channels: int = 16 + NUM_SCALARS,
        latent_frames: int = 64,
        rating_axes: tuple[str, ...] = RATING_AXES,
        widths: tuple[int, ...] = (128, 160, 192),
        embedding_dim: int = 256,
        cross_attention_dim: int = 128,
        kernel_size: int = 3,
        latent_mean: list[float] | None = None,
        latent_std: list[float] | None = None,
        level_mean: float = -5.0,
        level_std: float = 0.6,
        log_friction_mean: float | None = -0.4,
        log_friction_std: float | None = 0.4,
        ratings_mean: list[float] | None = None,
        ratings_std: list[float] | None = None,
        ratings_range: list[list[float]] | None = None,
        ratings_quantiles: list[list[float]] | None = None,
        reference_speed: float | None = 80.0,
        num_train_timesteps: int = 1000,
    ):
        super().__init__()
        if in_channels <= NUM_SCALARS:
            raise ValueError(f"`in_channels` must exceed {NUM_SCALARS} (level, log friction), got {in_channels}.")
        latent_channels = in_channels - NUM_SCALARS
        for name, values in (("latent_mean", latent_mean), ("latent_std", latent_std)):
            if values is not None and len(values) != latent_channels:
                raise ValueError(
                    f"`{name}` must hold {latent_channels} numbers (in_channels - {NUM_SCALARS}), got {len(values)}."
                )
        if ratings_quantiles is not None:
            _check_quantiles(ratings_quantiles, rating_axes)
        self.gradient_checkpointing = False
        self.time_embedder = TimestepEmbedder(embedding_dim, num_train_timesteps)
        self.rating_embedder = RatingEmbedder(len(rating_axes), cross_attention_dim)
        self.rating_pool = torch.nn.Linear(len(rating_axes) * cross_attention_dim, embedding_dim)
        self.unet = UNet1D(
            in_channels,
            in_channels,
            list(widths),
            patch_size=1,
            embedding_dim=embedding_dim,
            kernel_size=kernel_size,
            cross_attention_dim=cross_attention_dim,
        )

    @property
    def latent_channels(self):
        """Channels of LCTG's latents (the state has two more)."""
        return self.config.in_channels - NUM_SCALARS

    def split(self, sample):
        """The parts of a state (or velocity): latent channels (batch, channels, frames) and scalars (batch, 2)."""
        latents, scalars = sample.split([self.latent_channels, NUM_SCALARS], dim=1)
        return latents, scalars.sum(-1) / sample.shape[-1] ** 0.5

    def join(self, latents, scalars):
        """Undoes `split`; each scalar is spread evenly over the frames."""
        frames = latents.shape[-1]
        return torch.cat([latents, scalars[..., None].expand(-1, -1, frames) / frames**0.5], dim=1)

    def _latent_statistics(self, like):
        """Mean and standard deviation of the latent channels, (channels, 1); no buffers: offloading would miss them."""
        mean, std = self.config.latent_mean, self.config.latent_std
        mean = torch.zeros(self.latent_channels) if mean is None else torch.tensor(mean)
        std = torch.ones(self.latent_channels) if std is None else torch.tensor(std)
        return mean.to(like)[:, None], std.to(like)[:, None]

    def pack(self, latents, level, friction_coefficient):
        """The state x0 of the diffusion: latents, level and friction coefficient, each at unit variance.

        Args:
            latents (`torch.Tensor`): (batch, latent_channels, frames), as `LCTGModel.encode` makes them.
            level (`torch.Tensor`): (batch,), natural log of the RMS in N.
            friction_coefficient (`torch.Tensor`): (batch,); NaN = unknown, which becomes the training mean.

        Returns:
            `torch.Tensor`: (batch, in_channels, frames).
        """
        config = self.config
        mean, std = self._log_friction_statistics()
        friction = (friction_coefficient.clamp_min(1e-3).log() - mean) / std
        scalars = torch.stack([(level - config.level_mean) / config.level_std, torch.nan_to_num(friction)], dim=1)
        mean, std = self._latent_statistics(latents)
        return self.join((latents - mean) / std, scalars.to(latents))

    def unpack(self, sample):
        """Undoes `pack`: (batch, in_channels, frames) -> latents, level (batch,), friction coefficient (batch,)."""
        config = self.config
        latents, scalars = self.split(sample)
        level, friction = scalars.float().unbind(1)
        log_friction_mean, log_friction_std = self._log_friction_statistics()
        mean, std = self._latent_statistics(latents)
        return (
            latents * std + mean,
            level * config.level_std + config.level_mean,
            torch.exp(friction * log_friction_std + log_friction_mean),
        )

    def _log_friction_statistics(self):
        """Mean and standard deviation; NaN where no friction coefficient was known in training."""
        mean, std = self.config.log_friction_mean, self.config.log_friction_std
        return (math.nan, math.nan) if mean is None or std is None else (mean, std)

    def forward(self, sample, timestep, ratings, return_dict=True):
        """Velocity of a noisy state.

        Args:
            sample (`torch.Tensor`): (batch, in_channels, frames).
            timestep (`float`, `int` or `torch.Tensor`): t = num_train_timesteps * phi / (pi/2) - 1, (batch,) or scalar.
            ratings (`torch.Tensor`): (batch, axes) in z-scores; NaN = not specified.
            return_dict (`bool`, *optional*, defaults to `True`): `DALEOutput` or a plain tuple.
        """
        if ratings.shape[-1] != len(self.config.rating_axes):
            raise ValueError(
                f"`ratings` must be (batch, {len(self.config.rating_axes)}), in the order "
                f"{list(self.config.rating_axes)}, got {tuple(ratings.shape)}."
            )
        latents, scalars = self.split(sample)
        hidden_states = torch.cat([latents, scalars[..., None].expand(-1, -1, sample.shape[-1])], dim=1)

        tokens = self.rating_embedder(ratings, sample.dtype)
        embedding = self.time_embedder(expand_timestep(timestep, sample), sample.dtype)
        embedding = embedding + self.rating_pool(tokens.flatten(1))
        checkpoint = None
        if torch.is_grad_enabled() and self.gradient_checkpointing:
            checkpoint = self._gradient_checkpointing_func
        velocity = self.unet(hidden_states, embedding, tokens=tokens, checkpoint=checkpoint)

        latents, scalars = velocity.split([self.latent_channels, NUM_SCALARS], dim=1)
        velocity = self.join(latents, scalars.mean(-1))
        return DALEOutput(sample=velocity) if return_dict else (velocity,)

"""DALE, the Diffusion Adjective-to-Latent Encoder: ratings to latents, level and friction (paper section 2.2)."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import torch
import torch.nn.functional as F
from diffusers.configuration_utils import ConfigMixin, register_to_config
from diffusers.loaders import PeftAdapterMixin
from diffusers.models.attention import AttentionMixin
from diffusers.models.modeling_utils import ModelMixin
from diffusers.utils import BaseOutput

from ..signal import RATING_AXES
from .compiling import CompileMixin
from .embeddings import RatingEmbedder, TimestepEmbedder, expand_timestep
from .rating_statistics import RatingStatistics
from .safe_loading import SafeLoadingMixin
from .unet_1d import UNet1D, from_patches, to_patches

#: scalars that are generated with the latents: level and log friction coefficient
NUM_SCALARS = 2


def _cosines(count, like):
    """Orthonormal DCT-II, (count, count): band levels (count, ...) to their cepstrum, which is hardly correlated."""
    places = torch.arange(count, device=like.device, dtype=torch.float32)
    matrix = torch.cos(math.pi / max(count, 1) * places[:, None] * (places + 0.5)) * (2 / max(count, 1)) ** 0.5
    matrix[:1] *= 0.5**0.5
    return matrix.to(like)


def _cepstra(latents, level_channels, patch_size):
    """Cepstrum of band levels over the texture (batch, bands), and how each patch of frames departs from it."""
    cepstra = _cosines(level_channels, latents) @ latents[:, :level_channels]
    means = cepstra.mean(-1)
    return means, (cepstra - means[..., None]).unflatten(-1, (-1, patch_size)).mean(-1)


def _standardized(values, mean, std):
    """Values at unit variance; 0 where the standard deviation is 0."""
    return torch.zeros_like(values) if std == 0 else (values - mean) / std


def latent_statistics(latents, level_channels=0, patch_size=1):
    """What `DALEModel`'s config keeps of the training set's latents: its `latent_mean`, `latent_std`, `departure_std`.

    Args:
        latents (`torch.Tensor`): (n, latent_channels, frames), base layers of `LCTGModel.encode`.
        level_channels, patch_size (`int`): of the model.

    Returns:
        `dict[str, list[float]]`
    """
    means, departures = _cepstra(latents, level_channels, patch_size)
    learned = latents[:, level_channels:]

    def deviation(values, dims):
        return values.std(dims, correction=0).clamp_min(1e-3).tolist() if values.numel() else []

    return {
        "latent_mean": [*means.mean(0).tolist(), *learned.mean((0, 2)).tolist()],
        "latent_std": deviation(means, 0) + deviation(learned, (0, 2)),
        "departure_std": deviation(departures, (0, 2)),
    }


@dataclass
class DALEOutput(BaseOutput):
    """Output of `DALEModel`: `sample` is the velocity v, (batch, in_channels, latent_frames)."""

    sample: torch.Tensor


class DALEConditions(NamedTuple):
    """What a velocity at one timestep does not take from the sample (`DALEModel.condition`).

    Attributes:
        blocks (`list[BlockConditions]`): of each block of the U-Net.
    """

    blocks: list


class DALEModel(SafeLoadingMixin, CompileMixin, ModelMixin, ConfigMixin, AttentionMixin, PeftAdapterMixin):
    r"""
    Velocity network in the latent space of LCTG, steered by perceptual ratings.

    Ratings act through cross-attention at every level of the U-Net, and through the time embedding. The state of the
    diffusion is (batch, in_channels, latent_frames). Its channels are, in this order:

    - LCTG's learned latents;
    - the cepstrum (DCT over bands) of the band levels, LCTG's first `level_channels` latents, as departures from its
      mean over the texture: one value per patch of `patch_size` frames;
    - scalars of the whole texture: the mean cepstrum, the level and the log friction coefficient.

    Every value of the state has unit variance. A value of a patch, or of the whole texture, is spread evenly over its
    n frames and read back as their sum divided by sqrt(n) (`pool_state`), so that white noise on the frames is noise of
    unit variance on the value. This model inherits from [`ModelMixin`].

    Args:
        in_channels (`int`, *optional*, defaults to 45): LCTG's base channels, `level_channels` and two more.
        latent_frames (`int`, *optional*, defaults to 64): frames of one segment, the length it was trained on.
        rating_axes (`list[str]`, *optional*): names of the perceptual axes, in the order of `ratings`.
        widths (`list[int]`, *optional*): channels of the levels, multiples of 32.
        embedding_dim (`int`, *optional*, defaults to 256): width of the time embedding.
        cross_attention_dim (`int`, *optional*, defaults to 128): width of the rating tokens.
        kernel_size (`int`, *optional*, defaults to 3): length of all convolutions.
        level_channels (`int`, *optional*, defaults to 19): how many of LCTG's first latents are band levels.
        patch_size (`int`, *optional*, defaults to 4): latent frames per position of the U-Net, a power of two.
        latent_mean, latent_std (`list[float]`, *optional*): statistics over the training set, of the mean cepstrum of
            the band levels and of each learned latent channel (`latent_statistics`).
        departure_std (`list[float]`, *optional*): likewise of the departures of the cepstrum from its mean.
        level_mean, level_std (`float`, *optional*): of the level, natural log of the RMS in N; a standard deviation of
            0 = not generated, always the mean.
        log_friction_mean, log_friction_std (`float`, *optional*): of the log friction coefficient, likewise; `None` =
            unknown in training, then the friction coefficient of generated textures is NaN.
        rating_statistics (`dict`, *optional*): of the training surfaces' ratings, see [`RatingStatistics`].
        reference_speed (`float`, *optional*): mean finger speed of the training segments, mm/s; `None` = unknown.
        num_train_timesteps (`int`, *optional*, defaults to 1000): length of the time axis, t in [-1, 999].

    Raises:
        ValueError: if sizes do not fit each other, or statistics do not fit the sizes.
    """

    _supports_gradient_checkpointing = True
    _no_split_modules = ["UNet1D", "RatingEmbedder"]  # skip connections; parameters beside layers
    _repeated_blocks = ["ResnetBlock1D"]
    _skip_layerwise_casting_patterns = ["norm", "time", "rating", "context_scale"]

    @register_to_config
    def __init__(
        self,
        in_channels: int = 45,
        latent_frames: int = 64,
        rating_axes: tuple[str, ...] = RATING_AXES,
        widths: tuple[int, ...] = (128, 160, 192),
        embedding_dim: int = 256,
        cross_attention_dim: int = 128,
        kernel_size: int = 3,
        level_channels: int = 19,
        patch_size: int = 4,
        latent_mean: list[float] | None = None,
        latent_std: list[float] | None = None,
        departure_std: list[float] | None = None,
        level_mean: float = -5.0,
        level_std: float = 0.6,
        log_friction_mean: float | None = -0.4,
        log_friction_std: float | None = 0.4,
        rating_statistics: dict | None = None,
        reference_speed: float | None = 80.0,
        num_train_timesteps: int = 1000,
    ):
        super().__init__()
        beside = NUM_SCALARS + level_channels
        if in_channels <= beside or 2 * level_channels > in_channels - NUM_SCALARS:
            raise ValueError(
                f"`in_channels` must exceed {NUM_SCALARS} (level, log friction) and twice `level_channels` "
                f"({level_channels}), got {in_channels}."
            )
        if patch_size < 1 or latent_frames % patch_size:
            raise ValueError(f"`latent_frames` ({latent_frames}) must be a multiple of `patch_size`, got {patch_size}.")
        for name, values, count in (
            ("latent_mean", latent_mean, in_channels - beside),
            ("latent_std", latent_std, in_channels - beside),
            ("departure_std", departure_std, level_channels),
        ):
            if values is not None and len(values) != count:
                raise ValueError(f"`{name}` must hold {count} numbers, got {len(values)}.")
        RatingStatistics.from_dict(rating_statistics).check(len(rating_axes))
        self.gradient_checkpointing = False
        self.time_embedder = TimestepEmbedder(embedding_dim, num_train_timesteps)
        self.rating_embedder = RatingEmbedder(len(rating_axes), cross_attention_dim)
        self.rating_pool = torch.nn.Linear(len(rating_axes) * cross_attention_dim, embedding_dim)
        #: channels of the U-Net: learned latents patch by patch, departures, scalars
        self.channel_groups = [(in_channels - beside - level_channels) * patch_size, level_channels, beside]
        self.unet = UNet1D(
            sum(self.channel_groups),
            sum(self.channel_groups),
            list(widths),
            patch_size=1,
            embedding_dim=embedding_dim,
            kernel_size=kernel_size,
            cross_attention_dim=cross_attention_dim,
        )

    @property
    def latent_channels(self):
        """Channels of LCTG's latents that it generates."""
        return self.config.in_channels - NUM_SCALARS - self.config.level_channels

    @property
    def num_scalars(self):
        """Scalars of the whole texture: mean cepstrum of the band levels, level, log friction coefficient."""
        return NUM_SCALARS + self.config.level_channels

    def split_scalars(self, sample):
        """A state (or velocity) as channels that vary over frames, and the texture's scalars (batch, num_scalars)."""
        field, scalars = sample.split([sample.shape[1] - self.num_scalars, self.num_scalars], dim=1)
        return field, scalars.sum(-1) / sample.shape[-1] ** 0.5

    def append_scalars(self, field, scalars):
        """Undoes `split_scalars`; each scalar is spread evenly over the frames."""
        frames = field.shape[-1]
        return torch.cat([field, scalars[..., None].expand(-1, -1, frames) / frames**0.5], dim=1)

    def pool_state(self, sample):
        """The values of a state (or velocity), at unit variance: (batch, sum of `channel_groups`, positions).

        A position is a patch of `patch_size` frames. Channels are the learned latents patch by patch, the departures,
        and the scalars, which are the same at every position.

        Raises:
            ValueError: if the frames are no multiple of `patch_size`.
        """
        size, levels = self.config.patch_size, self.config.level_channels
        if sample.shape[-1] % size:
            raise ValueError(f"`sample` must have a multiple of {size} frames (patch_size), got {sample.shape[-1]}.")
        field, scalars = self.split_scalars(sample)
        learned, departures = field.split([field.shape[1] - levels, levels], dim=1)
        learned = to_patches(learned, size)
        departures = departures.unflatten(-1, (-1, size)).sum(-1) / size**0.5
        return torch.cat([learned, departures, scalars[..., None].expand(-1, -1, learned.shape[-1])], dim=1)

    def unpool_state(self, pooled):
        """Undoes `pool_state`: each value is spread evenly over its frames; scalars are averaged over positions."""
        size = self.config.patch_size
        learned, departures, scalars = pooled.split(self.channel_groups, dim=1)
        departures = departures.repeat_interleave(size, dim=-1) / size**0.5
        return self.append_scalars(torch.cat([from_patches(learned, size), departures], dim=1), scalars.mean(-1))

    def _latent_statistics(self, like):
        """Means and standard deviations as (channels, 1); no buffers: offloading would miss them.

        Of mean cepstrum and learned latents, mean and standard deviation, and of departures, standard deviation.
        """
        statistics = []
        for values, default, count in (
            (self.config.latent_mean, 0.0, self.latent_channels),
            (self.config.latent_std, 1.0, self.latent_channels),
            (self.config.departure_std, 1.0, self.config.level_channels),
        ):
            statistics.append(torch.tensor([default] * count if values is None else values).to(like)[:, None])
        return statistics

    def pack(self, latents, level, friction_coefficient):
        """The state x0 of the diffusion: latents, level and friction coefficient, each at unit variance.

        Args:
            latents (`torch.Tensor`): (batch, latent_channels, frames), base layer of `LCTGModel.encode`.
            level (`torch.Tensor`): (batch,), natural log of the RMS in N.
            friction_coefficient (`torch.Tensor`): (batch,); NaN = unknown, which becomes the training mean.

        Returns:
            `torch.Tensor`: (batch, in_channels, frames).
        """
        config, levels = self.config, self.config.level_channels
        friction = _standardized(friction_coefficient.clamp_min(1e-3).log(), *self._log_friction_statistics())
        level = _standardized(level, config.level_mean, config.level_std)
        mean, std, departure_std = self._latent_statistics(latents)
        cepstra, departures = _cepstra(latents, levels, config.patch_size)
        cepstra = (cepstra - mean[:levels, 0]) / std[:levels, 0]
        scalars = torch.cat([cepstra, torch.stack([level, torch.nan_to_num(friction)], dim=1).to(latents)], dim=1)
        learned = to_patches((latents[:, levels:] - mean[levels:]) / std[levels:], config.patch_size)
        scalars = scalars[..., None].expand(-1, -1, learned.shape[-1])
        return self.unpool_state(torch.cat([learned, departures / departure_std, scalars], dim=1))

    def unpack(self, sample):
        """Undoes `pack`: (batch, in_channels, frames) -> latents, level (batch,), friction coefficient (batch,).

        Band levels come back smooth: cubic between the values of the patches.
        """
        config, levels = self.config, self.config.level_channels
        learned, departures, scalars = self.pool_state(sample).split(self.channel_groups, dim=1)
        cepstra, scalars = scalars[..., 0].split([levels, NUM_SCALARS], dim=1)
        level, friction = scalars.float().unbind(1)
        log_friction_mean, log_friction_std = self._log_friction_statistics()
        mean, std, departure_std = self._latent_statistics(sample)
        latents = from_patches(learned, config.patch_size) * std[levels:] + mean[levels:]
        if levels:
            size = (levels, sample.shape[-1])
            smooth = F.interpolate((departures * departure_std)[:, None], size=size, mode="bicubic")[:, 0]
            smooth = smooth - smooth.mean(-1, keepdim=True) + (cepstra[..., None] * std[:levels] + mean[:levels])
            latents = torch.cat([_cosines(levels, smooth).T @ smooth, latents], dim=1)
        return (
            latents,
            level * config.level_std + config.level_mean,
            torch.exp(friction * log_friction_std + log_friction_mean),
        )

    def _log_friction_statistics(self):
        """Mean and standard deviation; NaN where no friction coefficient was known in training."""
        mean, std = self.config.log_friction_mean, self.config.log_friction_std
        return (math.nan, math.nan) if mean is None or std is None else (mean, std)

    def condition(self, ratings, timesteps):
        """What of `forward` does not depend on the sample: a sampler prepares it once for all of its steps.

        It calls parts of the model directly, which hooks (offloading) do not see: check `has_hooks` before.

        Args:
            ratings (`torch.Tensor`): (batch, axes) in z-scores; NaN = not specified.
            timesteps (`torch.Tensor`): (steps,).

        Returns:
            `list[DALEConditions]`: for each step, in place of the ratings.
        """
        dtype = self.rating_embedder.axis_tokens.dtype  # `self.dtype` searches all weights
        embeddings, tokens = self._embed(ratings, timesteps[:, None], dtype)
        return [DALEConditions(blocks) for blocks in self.unet.condition(embeddings, tokens=tokens)]

    def _embed(self, ratings, timesteps, dtype):
        """Embeddings of times and ratings (batch, dim) or (steps, batch, dim), and tokens (batch, axes, dim)."""
        if ratings.shape[-1] != len(self.config.rating_axes):
            raise ValueError(
                f"`ratings` must be (batch, {len(self.config.rating_axes)}), in the order "
                f"{list(self.config.rating_axes)}, got {tuple(ratings.shape)}."
            )
        tokens = self.rating_embedder(ratings, dtype)
        embeddings = self.time_embedder(timesteps, dtype)
        # `to`: layers may lie on several devices (`device_map`)
        return embeddings + self.rating_pool(tokens.flatten(1)).to(embeddings.device), tokens

    def forward(self, sample, timestep, ratings, return_dict=True):
        """Velocity of a noisy state.

        Args:
            sample (`torch.Tensor`): (batch, in_channels, frames).
            timestep (`float`, `int` or `torch.Tensor`): t in [-1, num_train_timesteps - 1], (batch,) or scalar.
            ratings (`torch.Tensor` or `DALEConditions`): (batch, axes) in z-scores, NaN = not specified; or the
                conditions of this timestep that `condition` prepared from them.
            return_dict (`bool`, *optional*, defaults to `True`): `DALEOutput` or a plain tuple.

        Raises:
            ValueError: for another number of axes, or frames that are no multiple of `patch_size`.
        """
        embedding, tokens, blocks = None, None, None
        if isinstance(ratings, DALEConditions):
            (blocks,) = ratings
        else:
            embedding, tokens = self._embed(ratings, expand_timestep(timestep, sample), sample.dtype)
        checkpointing = torch.is_grad_enabled() and self.gradient_checkpointing
        hidden_states = self.unet(
            self.pool_state(sample),
            embedding,
            tokens=tokens,
            checkpoint=self._gradient_checkpointing_func if checkpointing else None,
            conditions=blocks,
        )
        velocity = self.unpool_state(hidden_states)
        return DALEOutput(sample=velocity) if return_dict else (velocity,)

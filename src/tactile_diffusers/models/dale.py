"""DALE, the Diffusion Adjective-to-Latent Encoder: ratings to latents, level and friction (paper section 2.2)."""

import torch
import torch.nn.functional as F
from diffusers.configuration_utils import ConfigMixin, FrozenDict, register_to_config
from diffusers.loaders import PeftAdapterMixin
from diffusers.models.attention import AttentionMixin
from diffusers.models.modeling_utils import ModelMixin

from ..schedulers.angles import to_angle
from ..signal import RATING_AXES
from ..signal.checks import check_whole_number
from .calibration import check_calibration, check_network_axes, held_ratings, network_ratings, scalar_shift
from .dale_parts import DALEConditions, DALEOutput, ScalarNetwork
from .dale_state import (
    MODULATIONS,
    QUANTILES,
    cepstra,
    coloured,
    cosines,
    log_friction_statistics,
    modulation_numbers,
    normal_scores,
    quantile_numbers,
    standardized,
    unit_shape,
    whitened,
    with_quantiles,
)
from .embeddings import RatingEmbedder, TimestepEmbedder, expand_timestep
from .mixins import CompileMixin, HookMixin, SafeLoadingMixin
from .rating_statistics import RatingStatistics
from .unet_1d import UNet1D, from_patches, to_patches

#: scalars that are generated with the latents: level and log friction coefficient
NUM_SCALARS = 2


class DALEModel(SafeLoadingMixin, CompileMixin, HookMixin, ModelMixin, ConfigMixin, AttentionMixin, PeftAdapterMixin):
    r"""
    Velocity network in the latent space of LCTG, steered by perceptual ratings.

    Ratings act through the time embedding, which scales and shifts every block of the U-Net, and as in the paper
    through cross-attention at every level if `cross_attention` asks for it. Beyond the training surfaces' range they
    are held at its ends. The state of the diffusion is (batch, in_channels, latent_frames). Its channels are, in this
    order:

    - the fast envelope, LCTG's latents after the levels, and LCTG's learned latents;
    - the cepstrum (DCT over bands) of the band levels, LCTG's first `level_channels` latents, as departures from its
      mean over the texture: one value per patch of `patch_size` frames;
    - scalars of the whole texture: the mean cepstrum; how large the departures are, which themselves are of RMS 1 over
      each texture; the quantiles of the fast envelope and the powers of its modulation, which itself is normally
      distributed over each and of equal power in all bands of modulation frequency; the level and the log friction
      coefficient.

    Every value of the state has unit variance. A value of a patch, or of the whole texture, is spread evenly over its
    n frames and read back as their sum divided by sqrt(n) (`pool_state`), so that white noise on the frames is noise of
    unit variance on the value. This model inherits from [`ModelMixin`].

    Args:
        in_channels (`int`, *optional*, defaults to 66): LCTG's base channels, and the scalars.
        latent_frames (`int`, *optional*, defaults to 64): frames of one segment, the length it was trained on.
        rating_axes (`list[str]`, *optional*): names of the perceptual axes, in the order of `ratings`.
        widths (`list[int]`, *optional*): channels of the levels.
        embedding_dim (`int`, *optional*, defaults to 256): width of the time embedding.
        rating_dim (`int`, *optional*, defaults to 128): width of the rating tokens.
        cross_attention (`bool`, *optional*, defaults to `False`): whether every block attends to the rating tokens
            (paper section 2.2); `widths` are multiples of 32 then.
        kernel_size (`int`, *optional*, defaults to 3): length of all convolutions.
        level_channels (`int`, *optional*, defaults to 19): how many of LCTG's first latents are band levels.
        envelope_channels (`int`, *optional*, defaults to 4): how many after them are the fast envelope.
        patch_size (`int`, *optional*, defaults to 2): latent frames per position of the U-Net, a power of two.
        latent_mean, latent_std (`list[float]`, *optional*): statistics over the training set, of the mean cepstrum of
            the band levels and of each learned latent channel (`latent_statistics`).
        departure_std (`list[float]`, *optional*): likewise of the departures of the cepstrum from its mean.
        size_mean, size_std (`list[float]`, *optional*): likewise of the log RMS of the departures and of the numbers
            that stand for the envelope's quantiles and modulation (`dale_state.py`).
        level_mean, level_std (`float`, *optional*): of the level, natural log of the RMS in N; a standard deviation of
            0 = not generated, always the mean.
        log_friction_mean, log_friction_std (`float`, *optional*): of the log friction coefficient, likewise; `None` =
            unknown in training, then the friction coefficient of generated textures is NaN.
        rating_statistics (`dict`, *optional*): of the training surfaces' ratings, see [`RatingStatistics`].
        reference_speed (`float`, *optional*): mean finger speed of the training segments, mm/s; `None` = unknown.
        distilled_steps (`int`, *optional*): most solver steps that a distilled model may take (examples/distill.py);
            `None` = any number.
        scalar_width (`int`, *optional*): of a network that generates the scalars first, in one step, so that the U-Net
            generates the rest of the state to fit them; `None` = all together. Needs `distilled_steps` = 1.
        calibration (`dict`, *optional*): by how much scalars are shifted, given the ratings (`calibration.py`).
        estimator_statistics (`dict`, *optional*): those that the rating estimator was trained with, where others.
        network_axes (`int`, *optional*): how many of the axes, the first ones, the networks know; the others act
            through `calibration` alone; `None` = all.
        num_train_timesteps (`int`, *optional*, defaults to 1000): length of the time axis, t in [-1, 999].

    Raises:
        ValueError: if sizes do not fit each other, or statistics do not fit the sizes.
    """

    __module__ = "tactile_diffusers"  # as checkpoints name it

    _supports_gradient_checkpointing = True
    _no_split_modules = ["UNet1D", "RatingEmbedder"]  # skip connections; parameters beside layers
    _repeated_blocks = ["ResnetBlock1D"]
    _skip_layerwise_casting_patterns = ["norm", "time", "rating", "context_scale"]

    @register_to_config
    def __init__(
        self,
        in_channels: int = 66,
        latent_frames: int = 64,
        rating_axes: tuple[str, ...] = RATING_AXES,
        widths: tuple[int, ...] = (128, 160, 192),
        embedding_dim: int = 256,
        rating_dim: int = 128,
        cross_attention: bool = False,
        kernel_size: int = 3,
        level_channels: int = 19,
        envelope_channels: int = 4,
        patch_size: int = 2,
        latent_mean: list[float] | None = None,
        latent_std: list[float] | None = None,
        departure_std: list[float] | None = None,
        size_mean: list[float] | None = None,
        size_std: list[float] | None = None,
        level_mean: float = -5.0,
        level_std: float = 0.6,
        log_friction_mean: float | None = -0.4,
        log_friction_std: float | None = 0.4,
        rating_statistics: dict | None = None,
        reference_speed: float | None = 80.0,
        num_train_timesteps: int = 1000,
        distilled_steps: int | None = None,
        scalar_width: int | None = None,
        calibration: dict | None = None,
        network_axes: int | None = None,
        estimator_statistics: dict | None = None,
    ):
        super().__init__()
        check_whole_number("distilled_steps", 1 if distilled_steps is None else distilled_steps)
        scalars = self.num_scalars
        learned = in_channels - scalars - level_channels - envelope_channels
        if in_channels <= scalars or learned < 0:
            raise ValueError(
                f"`in_channels` must hold {scalars} scalars and the {level_channels} + {envelope_channels} "
                f"`level_channels` and `envelope_channels`, got {in_channels}."
            )
        if patch_size < 1 or latent_frames % patch_size:
            raise ValueError(f"`latent_frames` ({latent_frames}) must be a multiple of `patch_size`, got {patch_size}.")
        for name, values, count in (
            ("latent_mean", latent_mean, level_channels + learned),
            ("latent_std", latent_std, level_channels + learned),
            ("departure_std", departure_std, level_channels),
            ("size_mean", size_mean, self.num_sizes),
            ("size_std", size_std, self.num_sizes),
        ):
            if values is not None and len(values) != count:
                raise ValueError(f"`{name}` must hold {count} numbers, got {len(values)}.")
        if scalar_width is not None and distilled_steps != 1:
            raise ValueError(f"`scalar_width` needs `distilled_steps` = 1, got {distilled_steps}: there is one step.")
        RatingStatistics.from_dict(rating_statistics, len(rating_axes))
        seen = check_network_axes(network_axes, rating_axes, calibration)
        check_calibration(calibration, scalars, len(rating_axes), seen)
        self.gradient_checkpointing = False
        self.time_embedder = TimestepEmbedder(embedding_dim, num_train_timesteps)
        self.rating_embedder = RatingEmbedder(seen, rating_dim)
        self.rating_pool = torch.nn.Linear(seen * rating_dim, embedding_dim)
        #: channels of the U-Net: envelope and learned latents patch by patch, departures, scalars
        self.channel_groups = [(envelope_channels + learned) * patch_size, level_channels, scalars]
        self.unet = UNet1D(
            sum(self.channel_groups),
            sum(self.channel_groups),
            list(widths),
            patch_size=1,
            embedding_dim=embedding_dim,
            kernel_size=kernel_size,
            cross_attention_dim=rating_dim if cross_attention else None,
        )
        self.scalar_network = ScalarNetwork(scalars, seen, scalar_width) if scalar_width else None

    @property
    def latent_channels(self):
        """Channels of LCTG's latents that it generates."""
        return self.config.in_channels - self.num_scalars

    @property
    def num_sizes(self):
        """Scalars that say how much a texture varies: one of the departures, and quantiles of the fast envelope."""
        return (self.config.level_channels > 0) + (QUANTILES + MODULATIONS) * (self.config.envelope_channels > 0)

    @property
    def num_scalars(self):
        """Scalars of the whole texture: mean cepstrum of the band levels, sizes, level, log friction coefficient."""
        return NUM_SCALARS + self.config.level_channels + self.num_sizes

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

    def _statistics(self, like, config=None):
        """Means and standard deviations; no buffers: offloading would miss them.

        Returns:
            `tuple`: of scalars but level and friction, (2, n); of learned latents, (2, channels, 1); standard
            deviation of departures, (bands, 1).
        """
        config, levels = config or self.config, self.config.level_channels
        count = self.latent_channels - config.envelope_channels
        latents = torch.tensor([config.latent_mean or [0.0] * count, config.latent_std or [1.0] * count]).to(like)
        sizes = [config.size_mean or [0.0] * self.num_sizes, config.size_std or [1.0] * self.num_sizes]
        departure_std = torch.tensor(config.departure_std or [1.0] * levels).to(like)
        scalars = torch.cat([latents[:, :levels], torch.tensor(sizes).to(like)], dim=1)
        return scalars, latents[:, levels:, None], departure_std[:, None]

    def read(self, sample):
        """The values of a state, in the units of latents but for what is at unit variance.

        Returns:
            `tuple`: of the fast envelope (batch, channels, frames) what becomes its normal scores; the learned latents
            at unit variance; departures of the cepstrum (batch, bands, patches); the mean cepstrum (batch, bands); the
            numbers of the envelope's quantiles; all scalars at unit variance (batch, num_scalars).
        """
        config, levels = self.config, self.config.level_channels
        field, departures, scalars = self.pool_state(sample).split(self.channel_groups, dim=1)
        scalars, (statistics, _, departure_std) = scalars[..., 0], self._statistics(sample)
        numbers = scalars[:, :-NUM_SCALARS] * statistics[1] + statistics[0]
        first = levels + (levels > 0)
        means, departure_size, quantiles, modulation = numbers.tensor_split([levels, first, first + QUANTILES], dim=1)
        envelope, learned = from_patches(field, config.patch_size).tensor_split([config.envelope_channels], dim=1)
        if levels:
            departures = unit_shape(departures)[0] * departure_size.exp()[..., None] * departure_std
        return coloured(envelope, modulation), learned, departures, means, quantiles, scalars

    def pack(self, latents, level, friction_coefficient, statistics=None):
        """The state x0 of the diffusion: latents, level and friction coefficient, each at unit variance.

        Args:
            latents (`torch.Tensor`): (batch, latent_channels, frames), base layer of `LCTGModel.encode`.
            level (`torch.Tensor`): (batch,), natural log of the RMS in N.
            friction_coefficient (`torch.Tensor`): (batch,); NaN = unknown, which becomes the training mean.
            statistics (`dict`, *optional*): in place of those of the config, as `estimator_statistics`.

        Returns:
            `torch.Tensor`: (batch, in_channels, frames).
        """
        config = self.config if statistics is None else FrozenDict({**self.config, **statistics})
        levels = config.level_channels
        friction = standardized(friction_coefficient.clamp_min(1e-3).log(), *log_friction_statistics(config))
        level = standardized(level, config.level_mean, config.level_std)
        statistics, (mean, std), departure_std = self._statistics(latents, config)
        band_levels, envelope, learned = latents.tensor_split([levels, levels + config.envelope_channels], dim=1)
        means, departures = cepstra(band_levels, config.patch_size)
        departures, departure_size = unit_shape(departures / departure_std)
        scores = normal_scores(envelope)
        sizes = [means, departure_size, quantile_numbers(envelope), modulation_numbers(scores)]
        scalars = (torch.cat(sizes, dim=1) - statistics[0]) / statistics[1]
        scalars = torch.cat([scalars, torch.stack([level, torch.nan_to_num(friction)], dim=1).to(latents)], dim=1)
        field = to_patches(torch.cat([whitened(scores), (learned - mean) / std], dim=1), config.patch_size)
        scalars = scalars[..., None].expand(-1, -1, field.shape[-1])
        return self.unpool_state(torch.cat([field, departures, scalars], dim=1))

    def unpack(self, sample):
        """Undoes `pack`: (batch, in_channels, frames) -> latents, level (batch,), friction coefficient (batch,).

        Band levels come back smooth: cubic between the values of the patches.
        """
        config, levels = self.config, self.config.level_channels
        envelope, learned, departures, means, quantiles, scalars = self.read(sample)
        mean, std = self._statistics(sample)[1]
        latents = torch.cat([with_quantiles(envelope, quantiles), learned * std + mean], dim=1)
        if levels:
            size = (levels, sample.shape[-1])
            smooth = F.interpolate(departures[:, None], size=size, mode="bicubic")[:, 0]
            smooth = smooth - smooth.mean(-1, keepdim=True) + means[..., None]
            latents = torch.cat([cosines(levels, smooth).T @ smooth, latents], dim=1)
        level, friction = scalars[:, -NUM_SCALARS:].float().unbind(1)
        log_friction_mean, log_friction_std = log_friction_statistics(self.config)
        return (
            latents,
            level * config.level_std + config.level_mean,
            torch.exp(friction * log_friction_std + log_friction_mean),
        )

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
        shift = scalar_shift(self.config, ratings)
        return [DALEConditions(blocks, ratings, shift) for blocks in self.unet.condition(embeddings, tokens=tokens)]

    def _held(self, ratings):
        """What the networks see of ratings (batch, axes): those that they know, within the training surfaces' range."""
        if ratings.shape[-1] != len(self.config.rating_axes):
            raise ValueError(
                f"`ratings` must be (batch, {len(self.config.rating_axes)}), in the order "
                f"{list(self.config.rating_axes)}, got {tuple(ratings.shape)}."
            )
        return network_ratings(self.config, held_ratings(self.config, ratings))

    def _embed(self, ratings, timesteps, dtype):
        """Embeddings of times and ratings (batch, dim) or (steps, batch, dim), and tokens (batch, axes, dim)."""
        tokens = self.rating_embedder(self._held(ratings), dtype)
        embeddings = self.time_embedder(timesteps, dtype)
        # `to`: layers may lie on several devices (`device_map`)
        return embeddings + self.rating_pool(tokens.flatten(1)).to(embeddings.device), tokens

    def forward(self, sample, timestep, ratings, return_dict=True):
        """Velocity of a noisy state.

        Args:
            sample (`torch.Tensor`): (batch, in_channels, frames); or noise (batch, num_scalars): to scalars alone.
            timestep (`float`, `int` or `torch.Tensor`): t in [-1, num_train_timesteps - 1], (batch,) or scalar.
            ratings (`torch.Tensor` or `DALEConditions`): (batch, axes) in z-scores, NaN = not specified; or the
                conditions of this timestep that `condition` prepared from them.
            return_dict (`bool`, *optional*, defaults to `True`): `DALEOutput` or a plain tuple.

        Raises:
            ValueError: for another number of axes, or frames that are no multiple of `patch_size`.
        """
        prepared = isinstance(ratings, DALEConditions)
        asked = ratings.ratings if prepared else ratings
        if sample.ndim == 2:  # here, because hooks (offloading) see no other method
            scalars = self.scalar_network(sample, self._held(asked))
            return DALEOutput(sample=scalars) if return_dict else (scalars,)
        shift = ratings.shift if prepared else scalar_shift(self.config, ratings)
        if self.scalar_network is not None:  # at the one step there is, the velocity is minus the clean state
            field, noise = self.split_scalars(sample)
            scalars = self.scalar_network(noise, self._held(asked))
            velocity = self.unet_velocity(self.append_scalars(field, scalars), timestep, ratings)
            velocity = self.shifted(self.append_scalars(self.split_scalars(velocity)[0], -scalars), shift, -1)
        elif shift is None:
            velocity = self.unet_velocity(sample, timestep, ratings)
        else:
            angle = to_angle(expand_timestep(timestep, sample), self.config.num_train_timesteps)[:, None]
            velocity = self.unet_velocity(self.shifted(sample, shift, -angle.cos()), timestep, ratings)
            velocity = self.shifted(velocity, shift, -angle.sin())
        return DALEOutput(sample=velocity) if return_dict else (velocity,)

    def shifted(self, sample, shift, share):
        """A state (or velocity) whose scalars hold `share` of a shift (batch, num_scalars) more, or `None` of it."""
        if shift is None:
            return sample
        field, scalars = self.split_scalars(sample)
        return self.append_scalars(field, scalars + (share * shift).to(scalars))

    def unet_velocity(self, sample, timestep, ratings):
        """Velocity (batch, in_channels, frames) of the U-Net alone; arguments as of `forward`."""
        embedding, tokens, blocks = None, None, None
        if isinstance(ratings, DALEConditions):
            blocks = ratings.blocks
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
        return self.unpool_state(hidden_states)

"""LCTG, the Latent-Conditioned Texture Generator: an encoder and a diffusion decoder (paper section 2.2)."""

from dataclasses import dataclass
from typing import NamedTuple

import torch
from diffusers.configuration_utils import ConfigMixin, register_to_config
from diffusers.loaders import PeftAdapterMixin
from diffusers.models.modeling_utils import ModelMixin
from diffusers.utils import BaseOutput
from diffusers.utils.accelerate_utils import apply_forward_hook
from torch import nn

from ..features.low_band import synthesize
from ..schedulers.angles import to_angle
from ..signal.checks import check_whole_number
from .embeddings import TimestepEmbedder, expand_timestep
from .mixins import CompileMixin, HookMixin, SafeLoadingMixin
from .unet_1d import ChannelRMSNorm, UNet1D


@dataclass
class LCTGOutput(BaseOutput):
    """Output of `LCTGModel`: `sample` is the velocity v, (batch, 1, samples)."""

    sample: torch.Tensor


class LCTGConditions(NamedTuple):
    """What a velocity at one timestep does not take from the sample (`LCTGModel.condition`).

    Attributes:
        blocks (`list[BlockConditions]`): of each block of the decoder.
        cos_sin (`torch.Tensor` or `None`): (2,), cosine and sine of the timestep's angle.
        detail (`torch.Tensor` or `None`): (batch, 1, samples), the waveform of the detail layer; `None` = empty.
    """

    blocks: list
    cos_sin: torch.Tensor | None
    detail: torch.Tensor | None


class _EncoderBlock(nn.Module):
    """Two convolutions with a residual connection; the first may stride."""

    def __init__(self, channels, kernel_size, stride=1):
        super().__init__()
        padding = kernel_size // 2
        self.norm1 = ChannelRMSNorm()
        self.conv1 = nn.Conv1d(channels, channels, kernel_size, stride=stride, padding=padding)
        self.norm2 = ChannelRMSNorm()
        self.conv2 = nn.Conv1d(channels, channels, kernel_size, padding=padding)
        self.act = nn.SiLU()
        self.shortcut = nn.AvgPool1d(stride) if stride > 1 else nn.Identity()

    def forward(self, hidden_states):
        residual = self.shortcut(hidden_states)
        hidden_states = self.conv1(self.act(self.norm1(hidden_states)))
        return residual + self.conv2(self.act(self.norm2(hidden_states)))


class TactileEncoder(nn.Module):
    """Ten 1-D convolution layers from feature frames to latents (paper section 2.2), bounded to (-1, 1).

    Args:
        feature_channels (`int`): channels of the features.
        latent_channels (`int`): channels of the latents.
        width (`int`): channels of the hidden layers.
        kernel_size (`int`): odd length of the convolutions.
        stride (`int`): feature frames per latent frame; a power of two, at most 16.
    """

    def __init__(self, feature_channels, latent_channels, width, kernel_size, stride):
        super().__init__()
        if stride not in (1, 2, 4, 8, 16):
            raise ValueError(f"Feature frames per latent frame must be 1, 2, 4, 8 or 16, got {stride}.")
        halvings = stride.bit_length() - 1
        self.conv_in = nn.Conv1d(feature_channels, width, kernel_size, padding=kernel_size // 2)
        self.blocks = nn.ModuleList([_EncoderBlock(width, kernel_size, 2 if i < halvings else 1) for i in range(4)])
        self.norm_out = ChannelRMSNorm()
        self.act = nn.SiLU()
        self.conv_out = nn.Conv1d(width, latent_channels, kernel_size, padding=kernel_size // 2)

    def forward(self, features):
        """(batch, feature_channels, frames) -> (batch, latent_channels, frames / stride)."""
        hidden_states = self.conv_in(features)
        for block in self.blocks:
            hidden_states = block(hidden_states)
        return torch.tanh(self.conv_out(self.act(self.norm_out(hidden_states))))


class LCTGModel(SafeLoadingMixin, CompileMixin, HookMixin, ModelMixin, ConfigMixin, PeftAdapterMixin):
    r"""
    Encoder and velocity decoder between a texture and a compact latent.

    `encode` maps features of a texture to latents. `forward` predicts the velocity v = cos(phi) noise - sin(phi) x0 of
    a noisy texture given latents. Textures enter whitened, at unit RMS and at the working rate: see
    [`TactileFeatureExtractor`], whose `lctg_geometry` gives the sizes that both must share. This model inherits from
    [`ModelMixin`].

    The latents have two layers. The base layer describes the spectrum over time; DALE generates it. Its first channels
    are the levels of bands and the fast envelope, which all bands share; the encoder passes both on unchanged, and both
    are restored after decoding. Its other channels are learned. The detail layer, the last `detail_channels`, holds the
    low end of a recording's waveform at a lower rate; the decoder models only the residual. Zeros in the detail layer
    mean that there is none: the decoder then generates the whole waveform.

    Args:
        feature_channels (`int`, *optional*, defaults to 87): channels of the features.
        feature_hop (`int`, *optional*, defaults to 32): samples at the working rate per feature frame.
        latent_channels (`int`, *optional*, defaults to 44): channels of the latents, both layers.
        latent_hop (`int`, *optional*, defaults to 64): samples at the working rate per latent frame.
        encoder_width (`int`, *optional*, defaults to 96): channels of the encoder's hidden layers.
        widths (`list[int]`, *optional*): channels of the decoder's levels, seven by default as in the paper.
        patch_size (`int`, *optional*, defaults to 8): samples per position of the decoder's first level.
        embedding_dim (`int`, *optional*, defaults to 192): width of the time embedding.
        kernel_size (`int`, *optional*, defaults to 3): length of all convolutions.
        segment_samples (`int`, *optional*, defaults to 4096): samples at the working rate of the segments it was
            trained on; longer textures are decoded in windows of this length.
        latent_noise (`float`, *optional*, defaults to 0.1): standard deviation of the noise that training adds to the
            latents, so that the decoder tolerates the errors of generated latents. Not used at inference.
        num_train_timesteps (`int`, *optional*, defaults to 1000): length of the time axis, t in [-1, 999].
        detail_channels (`int`, *optional*, defaults to 16): channels of the detail layer, the last ones of latents and
            features (`TactileFeatureExtractor.detail_samples`); 0 = none.
        level_bands (`int`, *optional*, defaults to 18): bands whose levels over time, with that of what lies above
            them, are the first `level_bands + 1` channels of latents and features; 0 = none.
        envelope_channels (`int`, *optional*, defaults to 4): values of the fast envelope in each frame
            (`TactileFeatureExtractor.envelope_samples`), the channels after the levels; 0 = none.
        modulation_gains (`list[float]`, *optional*): for each level, how much deeper its fast modulation is in
            recordings than in textures decoded from the base layer alone (`fit_modulation_gains`). It is restored
            after decoding; `None` = left as decoded.
        distilled_steps (`int`, *optional*): most solver steps that a distilled decoder may take
            (examples/distill.py); `None` = any number.

    Raises:
        ValueError: if sizes do not fit each other.
    """

    __module__ = "tactile_diffusers"  # as checkpoints name it

    _supports_gradient_checkpointing = True
    _no_split_modules = ["UNet1D", "_EncoderBlock"]  # skip connections
    _repeated_blocks = ["ResnetBlock1D"]
    _skip_layerwise_casting_patterns = ["norm", "time"]
    _group_offload_block_modules = ["encoder"]  # `encode` runs it alone

    @register_to_config
    def __init__(
        self,
        feature_channels: int = 87,
        feature_hop: int = 32,
        latent_channels: int = 44,
        latent_hop: int = 64,
        encoder_width: int = 96,
        widths: tuple[int, ...] = (64, 80, 96, 128, 128, 160, 192),
        patch_size: int = 8,
        embedding_dim: int = 192,
        kernel_size: int = 3,
        segment_samples: int = 4096,
        latent_noise: float = 0.1,
        num_train_timesteps: int = 1000,
        detail_channels: int = 16,
        level_bands: int = 18,
        envelope_channels: int = 4,
        modulation_gains: list[float] | None = None,
        distilled_steps: int | None = None,
    ):
        super().__init__()
        check_whole_number("distilled_steps", 1 if distilled_steps is None else distilled_steps)
        for name, value in (("level_bands", level_bands), ("envelope_channels", envelope_channels)):
            check_whole_number(name, value, at_least=0)
        levels, passed = self.level_channels, self.passed_channels
        if modulation_gains is not None and (len(modulation_gains) != levels or min(modulation_gains, default=0) < 0):
            raise ValueError(f"`modulation_gains` must hold {levels} numbers of at least 0, got {modulation_gains}.")
        if not (0 <= detail_channels < latent_channels - passed and feature_channels - detail_channels > passed):
            raise ValueError(
                f"`detail_channels` ({detail_channels}), the {levels} levels of bands and the {envelope_channels} "
                f"values of the envelope must leave some of the `latent_channels` ({latent_channels}) to learn, and "
                f"some of the `feature_channels` ({feature_channels}) to encode."
            )
        if detail_channels and latent_hop % (2 * detail_channels):
            raise ValueError(f"`detail_channels` ({detail_channels}) must divide half of `latent_hop` ({latent_hop}).")
        if latent_hop % feature_hop:
            raise ValueError(f"`latent_hop` ({latent_hop}) must be a multiple of `feature_hop` ({feature_hop}).")
        if segment_samples % latent_hop:
            raise ValueError(
                f"`segment_samples` ({segment_samples}) must be a multiple of `latent_hop` ({latent_hop})."
            )
        self.gradient_checkpointing = False
        self.encoder = TactileEncoder(
            feature_channels - detail_channels,
            self.base_channels - passed,
            encoder_width,
            kernel_size,
            latent_hop // feature_hop,
        )
        self.time_embedder = TimestepEmbedder(embedding_dim, num_train_timesteps)
        self.decoder = UNet1D(
            2 if detail_channels else 1,
            1,
            list(widths),
            patch_size,
            embedding_dim,
            kernel_size,
            self.base_channels,
            context_stride=latent_hop,
        )

    @property
    def base_channels(self):
        """Channels of the latents' base layer, which DALE generates."""
        return self.config.latent_channels - self.config.detail_channels

    @property
    def level_channels(self):
        """Channels of the latents, the first ones, that are levels of bands."""
        return self.config.level_bands + 1 if self.config.level_bands else 0

    @property
    def passed_channels(self):
        """Channels of the latents, the first ones, that the encoder passes on: levels of bands and fast envelope."""
        return self.level_channels + self.config.envelope_channels

    def pad_detail(self, base):
        """Latents with an empty detail layer: (batch, base_channels, frames) -> (batch, latent_channels, frames)."""
        return nn.functional.pad(base, (0, 0, 0, self.config.detail_channels))

    def restored(self, latents):
        """What a decoded waveform is given back: keyword arguments of `TactileFeatureExtractor.denormalize`.

        Args:
            latents (`torch.Tensor`): (batch, latent_channels, frames).
        """
        return {
            "envelope": self.fast_envelope(latents),
            "band_levels": self.band_levels(latents),
            "modulation_gain": self.modulation_gain(latents),
        }

    def band_levels(self, latents):
        """Band levels that the decoded texture should have.

        Args:
            latents (`torch.Tensor`): (batch, latent_channels, frames).

        Returns:
            `torch.Tensor` or `None`: (batch, level_bands + 1, frames), in the unit of
            `TactileFeatureExtractor.band_levels`; `None` if the config has no `level_bands`.
        """
        return latents[:, : self.level_channels] if self.config.level_bands else None

    def fast_envelope(self, latents):
        """The gain that all bands share, by which the decoded waveform is to be multiplied.

        Args:
            latents (`torch.Tensor`): (batch, latent_channels, frames).

        Returns:
            `torch.Tensor` or `None`: (batch, envelope_channels, frames), natural log of amplitude; `None` if the config
            has no `envelope_channels`.
        """
        return latents[:, self.level_channels : self.passed_channels] if self.config.envelope_channels else None

    def modulation_gain(self, latents):
        """Factors by which the fast modulation of each decoded band is to be deepened.

        Args:
            latents (`torch.Tensor`): (batch, latent_channels, frames).

        Returns:
            `torch.Tensor` or `None`: (batch, level_bands + 1); 1 where there is a detail layer. `None` = nowhere.
        """
        if self.config.modulation_gains is None:
            return None
        no_detail = (latents[:, self.base_channels :] == 0).flatten(1).all(dim=1)
        gains = torch.tensor(self.config.modulation_gains, device=latents.device)
        return torch.where(no_detail[:, None], gains, 1.0) if no_detail.any() else None

    @apply_forward_hook
    def encode(self, features):
        """Latents of features.

        Args:
            features (`torch.Tensor`): (batch, feature_channels, frames) of `TactileFeatureExtractor`; frames a multiple
                of `latent_hop / feature_hop`.

        Returns:
            `torch.Tensor`: (batch, latent_channels, latent_frames); the learned channels lie in (-1, 1).

        Raises:
            ValueError: if the number of channels or frames does not fit the config.
        """
        ratio = self.config.latent_hop // self.config.feature_hop
        if features.ndim != 3 or features.shape[1] != self.config.feature_channels or features.shape[2] % ratio:
            raise ValueError(
                f"`features` must be (batch, {self.config.feature_channels}, a multiple of {ratio} frames), got "
                f"{tuple(features.shape)}. Use the checkpoint's own feature extractor."
            )
        encoded, detail = features.tensor_split([features.shape[1] - self.config.detail_channels], dim=1)
        learned = self.encoder(encoded).to(features.device)  # layers may lie on several devices (`device_map`)
        # features that pass through come once for each frame of the latents, repeated for its feature frames
        passed = features[:, : self.passed_channels, ::ratio]
        return torch.cat([passed, learned, detail[..., ::ratio]], dim=1)

    def condition(self, latents, timesteps):
        """What of `forward` does not depend on the sample: a sampler prepares it once for all of its steps.

        It calls parts of the model directly, which hooks (offloading) do not see: check `has_hooks` before.

        Args:
            latents (`torch.Tensor`): (batch, latent_channels, frames), of the model's dtype.
            timesteps (`torch.Tensor`): (steps,).

        Returns:
            `list[LCTGConditions]`: for each step, in place of the latents.
        """
        base, detail = latents.tensor_split([self.base_channels], dim=1)
        context, detail = self._layers(latents if detail.any() else base)
        embeddings = self.time_embedder(timesteps, latents.dtype)[:, None]
        blocks = self.decoder.condition(embeddings, context)
        cos_sin = [None] * len(blocks) if detail is None else self._cos_sin(timesteps, latents.dtype).unbind(0)
        return [LCTGConditions(*step, detail) for step in zip(blocks, cos_sin, strict=True)]

    def _layers(self, latents):
        """The base layer, and the waveform of the detail layer if there is one."""
        base, detail = latents[:, : self.base_channels], None
        if latents.shape[1] > self.base_channels:
            stride = self.config.latent_hop // self.config.detail_channels
            detail = synthesize(latents[:, self.base_channels :].transpose(1, 2).flatten(1), stride)
        return base, detail

    def _cos_sin(self, timesteps, dtype):
        """Cosine and sine of the timesteps' angles: (n,) -> (n, 2)."""
        angles = to_angle(timesteps, self.config.num_train_timesteps)
        return torch.stack([angles.cos(), angles.sin()], dim=-1).to(dtype)

    def forward(self, sample, timestep, latents, return_dict=True):
        """Velocity of a noisy texture.

        Args:
            sample (`torch.Tensor`): (batch, 1, samples) at the working rate, whitened, unit RMS.
            timestep (`float`, `int` or `torch.Tensor`): t in [-1, num_train_timesteps - 1], (batch,) or scalar.
            latents (`torch.Tensor` or `LCTGConditions`): (batch, latent_channels, ceil(samples / latent_hop)), or the
                conditions of this timestep that `condition` prepared from them.
            return_dict (`bool`, *optional*, defaults to `True`): `LCTGOutput` or a plain tuple.

        Raises:
            ValueError: if the frames of the latents do not fit the samples.
        """
        embedding, context, blocks = None, None, None
        if isinstance(latents, LCTGConditions):
            blocks, cos_sin, detail = latents
        else:
            frames = -(-sample.shape[-1] // self.config.latent_hop)
            if latents.shape[-1] != frames:
                raise ValueError(
                    f"`latents` must have {frames} frames for {sample.shape[-1]} samples (one per "
                    f"{self.config.latent_hop}), got {latents.shape[-1]}."
                )
            timestep = expand_timestep(timestep, sample)
            embedding = self.time_embedder(timestep, sample.dtype)
            context, detail = self._layers(latents.to(sample.dtype))
            cos_sin = None if detail is None else self._cos_sin(timestep, sample.dtype)

        # x0 = residual + detail: the decoder sees the noisy residual, x - cos(phi) detail, and the detail
        states, sine = sample, None
        if detail is not None:
            detail = detail[..., : sample.shape[-1]]
            cosine, sine = cos_sin[..., None, None].unbind(-3)
            states = torch.cat([sample - cosine * detail, detail], dim=1)
        elif self.config.detail_channels:
            states = nn.functional.pad(sample, (0, 0, 0, 1))
        checkpointing = torch.is_grad_enabled() and self.gradient_checkpointing
        velocity = self.decoder(
            states,
            embedding,
            context=context,
            checkpoint=self._gradient_checkpointing_func if checkpointing else None,
            conditions=blocks,
        )
        # cos(phi) noise - sin(phi) x0 = velocity of the residual - sin(phi) detail
        if detail is not None:
            velocity = velocity.to(detail.device) - sine * detail
        return LCTGOutput(sample=velocity) if return_dict else (velocity,)

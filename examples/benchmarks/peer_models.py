"""Other packages' models that make a waveform of one segment, with random weights: their speed can be measured."""

import importlib
import math
import sys
import types
from collections.abc import Callable
from typing import NamedTuple

import torch

from tactile_diffusers.signal import SEGMENT_SAMPLES

INSTALL = "pip install audio-diffusion-pytorch==0.1.3"
#: Of "at equal size": the parameters of a model that is cut differ from ours by no more than this share.
SIZE_TOLERANCE = 0.12
# The autoencoder of audio-diffusion-pytorch's README, its first seven levels: latents enter at the last one.
_CHANNELS = (8, 32, 64, 128, 256, 512, 512)
_FACTORS = (1, 4, 4, 4, 2, 2, 2)
_ITEMS = (1, 2, 2, 2, 2, 2, 2)
_ATTENTIONS = (0, 0, 0, 0, 0, 1, 1)
_LATENT_CHANNELS, _MODULATION, _HEADS, _HEAD_WIDTH = 32, 1024, 8, 64
_HOP = math.prod(_FACTORS)
# Its text-conditional U-Net over those latents, which are so short that three of its levels fit: the fourth to sixth.
_LATENT_LEVELS, _LATENT_FACTORS = slice(3, 6), (1, 2, 2)
# The ratings stand where the text was: three tokens as wide as those of T5.
_TOKENS, _TOKEN_WIDTH = 3, 768
# diffusers' UNet1DModel has by default three levels of 32, 32 and 64 channels; here as many as the paper's network has
_UNET_CHANNELS, _UNET_ATTENTIONS, _UNET_TIME = (32, 32, 64, 128, 128, 256, 256), 3, 16


class Peer(NamedTuple):
    """A model of another package: all that generates, and (count, steps) -> (count, 1, samples) of one segment."""

    module: torch.nn.Module
    generate: Callable


def size(module):
    """Number of parameters."""
    return sum(parameter.numel() for parameter in module.parameters())


def _scaled(channels, factor, multiple):
    return [max(multiple, round(factor * width / multiple) * multiple) for width in channels]


def fit(build, parameters, halvings=14):
    """The factor of all widths at which `build(factor)` comes nearest to a number of parameters, found by bisection.

    It is built on the meta device, where weights cost nothing. A ValueError if none comes within `SIZE_TOLERANCE`.
    """
    low, high, tried = 1e-3, 4.0, {}
    with torch.device("meta"):
        for _ in range(halvings):
            factor = math.sqrt(low * high)
            tried[factor] = size(build(factor))
            low, high = (factor, high) if tried[factor] < parameters else (low, factor)
    best = min(tried, key=lambda factor: abs(tried[factor] - parameters))
    if abs(tried[best] / parameters - 1) > SIZE_TOLERANCE:
        raise ValueError(
            f"`parameters` of {parameters} cannot be met within {SIZE_TOLERANCE:.0%}: the nearest model has "
            f"{tried[best]}. Compare with a larger model of ours."
        )
    return best


def _import_audio_diffusion():
    """The package; where torchaudio's libraries do not fit this torch, an empty module stands in for it.

    It serves audio-diffusion-pytorch's vocoder alone; PyPI's builds of it need CUDA.
    """
    try:
        importlib.import_module("torchaudio")
        return importlib.import_module("audio_diffusion_pytorch")
    except (ImportError, OSError):
        stand_in = types.ModuleType("torchaudio")
        stand_in.transforms = types.ModuleType("torchaudio.transforms")
        sys.modules["torchaudio"] = stand_in
        try:
            return importlib.import_module("audio_diffusion_pytorch")
        finally:
            del sys.modules["torchaudio"]


def audio_diffusion(parameters=None):
    """audio-diffusion-pytorch: its README's autoencoder, cut to seven levels, and its conditional U-Net.

    Ratings (as tokens) to latents, and latents to a mono waveform of 10 kHz, each by its own sampler. The encoder is
    left out: generating does not run it. Widths are scaled to the number of parameters; `None` = as published.
    """
    package = _import_audio_diffusion()  # its norms have eight groups
    factor = 1.0 if parameters is None else fit(lambda f: _audio_diffusion_networks(package, f), parameters)
    networks = _audio_diffusion_networks(package, factor).eval()
    latent_network, decoder = networks

    def generate(count, steps):
        shortest = math.prod(_LATENT_FACTORS)
        frames = math.ceil(SEGMENT_SAMPLES / _HOP / shortest - 1e-6) * shortest
        tokens = torch.randn(count, _TOKENS, _TOKEN_WIDTH)
        latents = latent_network.sample(torch.randn(count, _LATENT_CHANNELS, frames), embedding=tokens, num_steps=steps)
        context = [None] * (len(_CHANNELS) - 1) + [latents]
        return decoder.sample(torch.randn(count, 1, frames * _HOP), channels=context, num_steps=steps)

    return Peer(networks, generate)


def _audio_diffusion_networks(package, factor):
    """The conditional U-Net over latents and the decoder, all widths scaled by a factor."""
    common = dict(
        net_t=package.UNetV0,
        diffusion_t=package.VDiffusion,
        sampler_t=package.VSampler,
        attention_heads=_HEADS,
        attention_features=_scaled([_HEAD_WIDTH], factor, 1)[0],
        modulation_features=_scaled([_MODULATION], factor, 1)[0],
    )
    levels = len(_CHANNELS[_LATENT_LEVELS])
    latents = package.DiffusionModel(
        in_channels=_LATENT_CHANNELS,
        channels=_scaled(_CHANNELS[_LATENT_LEVELS], factor, 8),
        factors=_LATENT_FACTORS,
        items=_ITEMS[_LATENT_LEVELS],
        attentions=_ATTENTIONS[_LATENT_LEVELS],
        cross_attentions=[1] * levels,
        embedding_features=_TOKEN_WIDTH,
        **common,
    )
    decoder = package.DiffusionModel(
        in_channels=1,
        channels=_scaled(_CHANNELS, factor, 8),
        factors=_FACTORS,
        items=_ITEMS,
        attentions=_ATTENTIONS,
        context_channels=[0] * (len(_CHANNELS) - 1) + [_LATENT_CHANNELS],
        **common,
    )
    return torch.nn.ModuleList([latents, decoder])


def unet_1d(parameters=None):
    """diffusers' `UNet1DModel` on the waveform, unconditional, with Dance Diffusion's sampler (`IPNDMScheduler`).

    Widths are scaled to the number of parameters; `None` = 18 M.
    """
    from diffusers import IPNDMScheduler

    factor = 1.0 if parameters is None else fit(_unet_1d, parameters)
    network, scheduler = _unet_1d(factor).eval(), IPNDMScheduler()

    @torch.no_grad()
    def generate(count, steps):
        scheduler.set_timesteps(steps)
        waveform = torch.randn(count, 1, SEGMENT_SAMPLES)
        for t in scheduler.timesteps:
            waveform = scheduler.step(network(waveform, t).sample, t, waveform).prev_sample
        return waveform

    return Peer(network, generate)


def _unet_1d(factor):
    from diffusers import UNet1DModel

    plain = len(_UNET_CHANNELS) - _UNET_ATTENTIONS
    # heads of attention have 32 channels
    channels = _scaled(_UNET_CHANNELS[:plain], factor, 1) + _scaled(_UNET_CHANNELS[plain:], factor, 32)
    return UNet1DModel(
        sample_size=SEGMENT_SAMPLES,
        in_channels=1,
        out_channels=1,
        extra_in_channels=_UNET_TIME,
        time_embedding_dim=_UNET_TIME,
        down_block_types=["DownBlock1DNoSkip"] + ["DownBlock1D"] * (plain - 1) + ["AttnDownBlock1D"] * _UNET_ATTENTIONS,
        up_block_types=["AttnUpBlock1D"] * _UNET_ATTENTIONS + ["UpBlock1D"] * (plain - 1) + ["UpBlock1DNoSkip"],
        block_out_channels=channels,
    )

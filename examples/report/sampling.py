"""Many textures from a pipeline, each with noise of its own, so that batches and order change nothing."""

from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import torch
from threadpoolctl import threadpool_limits
from tqdm.auto import tqdm

from tactile_diffusers.evaluation.metrics.texture_checks import in_blocks
from tactile_diffusers.signal import resample

# textures that are encoded at once
_ENCODED = 64


@contextmanager
def one_thread(device):
    """One thread on a CPU, of PyTorch and of linear algebra.

    Sums over threads are rounded otherwise, and threads that wait for each other on a busy machine cost tenfold.
    """
    threads = torch.get_num_threads()
    if device.type != "cpu":
        yield
        return
    torch.set_num_threads(1)
    try:
        with threadpool_limits(1):
            yield
    finally:
        torch.set_num_threads(threads)


@dataclass(frozen=True)
class Generated:
    """Generated textures, one a row: (n, samples) float32, N; natural log of their RMS, and friction coefficients (n,).

    `latents` are DALE's result before decoding, (n, latent_channels, frames) float32.
    """

    textures: np.ndarray
    levels: np.ndarray
    friction_coefficients: np.ndarray
    latents: np.ndarray


def noise_seeds(seed, takes):
    """(takes,) seeds: the same takes for every request, so that requests differ by their ratings alone."""
    return np.random.SeedSequence(seed).generate_state(takes)


def generate(
    pipe, ratings, seeds, sampling_rate, samples, steps=10, guidance_scale=1.0, decode=True, batch=32, quiet=True
):
    """Generates textures from ratings (n, axes), z-scores, NaN = not specified, with one of `seeds` (n,) each:
    `Generated`.

    Textures are resampled to `sampling_rate` and cut to `samples`. `steps` are of both stages; a guidance scale of 1 is
    off; without `decode` there are latents only, and `textures` is empty.
    """
    parts = []
    for start in tqdm(range(0, len(ratings), batch), disable=quiet, desc="generating", leave=False):
        rows = slice(start, start + batch)
        generators = _generators(seeds[rows])
        settings = {"guidance_scale": guidance_scale, "generator": generators, "output_type": "latent"}
        out = pipe(np.asarray(ratings)[rows], num_inference_steps=steps, **settings)
        textures, level = np.empty((len(out.level), 0), np.float32), out.level.float().cpu().numpy()
        if decode:
            decoded = pipe.decode(out.latents, out.level, out.friction_coefficient, steps, generators)
            textures = resample(decoded.textures, decoded.sampling_rate, sampling_rate)[:, :samples].astype(np.float32)
            level = decoded.level  # which DALE may have left to the waveform
        tensors = (out.friction_coefficient, out.latents)
        parts.append((textures, level, *(tensor.float().cpu().numpy() for tensor in tensors)))
    return Generated(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def reconstruct(pipe, textures, sampling_rate, num_inference_steps, seed=0, batch=32, quiet=True, change=None):
    """Reconstructions at the textures' own rate and length: (n, samples) float64.

    `change`, if given, replaces the latents of each batch (n, latent_channels, frames) before they are decoded.
    """
    parts, seeds = [], noise_seeds(seed, len(textures))
    samples = max(1, round(textures.shape[-1] * pipe.feature_extractor.delivery_rate / sampling_rate))
    for start in tqdm(range(0, len(textures), batch), disable=quiet, desc=f"{num_inference_steps} steps", leave=False):
        rows = textures[start : start + batch]
        encoded, generators = pipe.encode(rows, sampling_rate), _generators(seeds[start : start + batch])
        latents = encoded.latents if change is None else change(encoded.latents)
        out = pipe.decode(latents, encoded.level, None, num_inference_steps, generators, samples=samples)
        parts.append(resample(out.textures, out.sampling_rate, sampling_rate)[:, : rows.shape[-1]])
    return np.concatenate(parts)


def _generators(seeds):
    return [torch.Generator("cpu").manual_seed(int(seed)) for seed in seeds]


def encode(pipe, textures, sampling_rate):
    """All layers of the latents of textures (n, samples): (n, latent_channels, frames) float32."""
    parts = in_blocks(textures, _ENCODED)
    return np.concatenate([pipe.encode(part, sampling_rate).latents.float().cpu().numpy() for part in parts])

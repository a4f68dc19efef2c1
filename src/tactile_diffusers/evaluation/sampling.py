"""Many textures from a pipeline, each with noise of its own, so that batches and order change nothing."""

from dataclasses import dataclass

import numpy as np
import torch
from tqdm.auto import tqdm

from ..signal import resample


@dataclass(frozen=True)
class Generated:
    """Textures that a pipeline made, one a row.

    Attributes:
        textures (`np.ndarray`): (n, samples) float32, N.
        levels (`np.ndarray`): (n,) natural log of the RMS in N.
        friction_coefficients (`np.ndarray`): (n,).
        latents (`np.ndarray`): (n, latent_channels, frames) float32, DALE's result before decoding.
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
    """Textures from ratings.

    Args:
        pipe (`TactileTexturePipeline`): with a DALE.
        ratings (`np.ndarray`): (n, 3) z-scores, NaN = not specified.
        seeds (`np.ndarray`): (n,) of each texture's noise.
        sampling_rate (`int`): Hz, to which textures are resampled if need be.
        samples (`int`): of each texture at that rate.
        steps (`int`): of both stages.
        guidance_scale (`float`): 1.0 = off.
        decode (`bool`): `False` = latents only; `textures` is then empty.
        batch (`int`): textures at once.
        quiet (`bool`): no progress bar.

    Returns:
        `Generated`
    """
    parts = []
    for start in tqdm(range(0, len(ratings), batch), disable=quiet, desc="generating", leave=False):
        rows = slice(start, start + batch)
        generators = [torch.Generator("cpu").manual_seed(int(seed)) for seed in seeds[rows]]
        made = pipe(
            np.asarray(ratings)[rows],
            num_inference_steps=steps,
            guidance_scale=guidance_scale,
            generator=generators,
            output_type="latent",
        )
        textures = np.empty((len(made.level), 0), np.float32)
        if decode:
            out = pipe.decode(made.latents, made.level, made.friction_coefficient, steps, generators)
            textures = resample(out.textures, out.sampling_rate, sampling_rate)[:, :samples].astype(np.float32)
        tensors = (made.level, made.friction_coefficient, made.latents)
        parts.append((textures, *(tensor.float().cpu().numpy() for tensor in tensors)))
    return Generated(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def reconstruct(pipe, textures, sampling_rate, num_inference_steps, seed=0, batch=32, quiet=True):
    """Reconstructions at the textures' own rate and length: (n, samples) float64."""
    made, seeds = [], noise_seeds(seed, len(textures))
    for start in tqdm(range(0, len(textures), batch), disable=quiet, desc=f"{num_inference_steps} steps", leave=False):
        rows = textures[start : start + batch]
        generators = [torch.Generator("cpu").manual_seed(int(s)) for s in seeds[start : start + batch]]
        out = pipe.reconstruct(rows, sampling_rate, num_inference_steps, generator=generators)
        made.append(resample(out.textures, out.sampling_rate, sampling_rate)[:, : rows.shape[-1]])
    return np.concatenate(made)


def latent_summary(latents):
    """What of a latent does not depend on where in the texture one looks: (n, 2 * channels).

    Mean and logarithmic standard deviation of each channel over frames.

    Args:
        latents (`np.ndarray`): (n, channels, frames).
    """
    return np.concatenate([latents.mean(-1), np.log(latents.std(-1) + 1e-3)], axis=-1)

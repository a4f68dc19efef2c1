"""Settings that are measured on the training set: whitening before LCTG is trained, modulation gains afterwards."""

import numpy as np
import torch
from tqdm.auto import tqdm

from ..features.feature_extraction_tactile import SILENCE
from ..signal import BAND_HZ, power_spectral_density, rms

#: Training textures to measure: another set of as many gives the same factors within a hundredth or two.
MODULATION_TEXTURES = 256
#: Corrections: bands overlap, so each correction is a little too small.
ROUNDS = 3
#: Bounds of the factors.
LIMITS = (0.5, 2.0)


def fit_preemphasis(textures, sampling_rate, band=BAND_HZ, points=33, clip_db=30.0):
    """Gains that whiten the mean amplitude spectrum of textures at unit RMS: few diffusion steps then keep weak bands.

    Args:
        textures (`np.ndarray`): (n, samples), N.
        sampling_rate (`float`): Hz.
        band (`tuple[float, float]`): Hz; gains are constant outside.
        points (`int`): logarithmically spaced frequencies, at which the spectrum is smoothed by interpolation.
        clip_db (`float`): largest difference between gains.

    Returns:
        `tuple[list[float], list[float]]`: frequencies in Hz and gains in dB, with the smallest gain at 0 dB.
    """
    textures = np.asarray(textures, dtype=np.float64)
    loud = rms(textures) > SILENCE if textures.size else np.zeros(0, dtype=bool)
    if not loud.any():
        raise ValueError(f"`textures` must hold at least one texture that is not silent, got shape {textures.shape}.")
    textures = textures[loud] / rms(textures[loud])[:, None]
    frequencies, density = power_spectral_density(textures, sampling_rate)
    amplitude = np.sqrt(density).mean(0)
    grid = np.geomspace(*band, points)
    spectrum_db = np.interp(np.log(grid), np.log(frequencies[1:]), 20 * np.log10(amplitude[1:] + 1e-30))
    gains = spectrum_db.max() - spectrum_db
    return [round(float(f), 4) for f in grid], [round(float(g), 4) for g in np.minimum(gains, clip_db)]


def fit_modulation_gains(pipe, dale, textures, sampling_rate, seed=0, quiet=False, batch_size=64):
    """Sets `modulation_gains` in LCTG's config, so that decoded textures are modulated as deeply as recordings.

    From the base layer alone, a diffusion decoder modulates the upper bands too little, in all textures alike, and less
    in fewer steps: by 10 to 40 % in log power at 2-6 Hz. The gains are the ratio of recorded to decoded modulation.

    Args:
        pipe (`TactileTexturePipeline`): whose `lctg` is measured and changed.
        dale (`DALEModel`): brings the base layer into the form in which it is generated (`pack`, `unpack`).
        textures (`np.ndarray`): (n, samples), N, of training surfaces.
        sampling_rate (`int`): Hz.
        seed (`int`): of the decoder's noise.
        quiet (`bool`): no progress bar.
        batch_size (`int`): textures decoded at once.

    Returns:
        `list[float]` or `None`: (level_bands + 1,), each within `LIMITS`; `None` without `level_bands`.
    """
    extractor, lctg = pipe.feature_extractor, pipe.lctg
    pipe = type(pipe).from_pipe(pipe, lctg_distilled=None)
    if not lctg.config.level_bands:
        return None
    batches = [textures[start : start + batch_size] for start in range(0, len(textures), batch_size)]
    recorded = sum(_power(extractor, rows, sampling_rate) for rows in batches)
    gains = np.ones(lctg.level_channels)
    with tqdm(total=ROUNDS * len(batches), disable=quiet, desc="modulation") as bar:
        for _ in range(ROUNDS):
            lctg.register_to_config(modulation_gains=[round(float(value), 4) for value in gains])
            generator, decoded = torch.Generator().manual_seed(seed), 0.0
            for rows in batches:
                encoded = pipe.encode(rows, sampling_rate)
                base, friction = encoded.latents[:, : lctg.base_channels], torch.ones_like(encoded.level)
                state = dale.pack(base, encoded.level, friction)
                base = lctg.pad_detail(dale.unpack(state)[0])
                out = pipe.decode(base, encoded.level, generator=generator)
                decoded = decoded + _power(extractor, out.textures, out.sampling_rate)
                bar.update()
            known = (recorded > 0) & (decoded > 0)
            ratio = np.sqrt(np.divide(recorded, decoded, out=np.ones_like(decoded), where=known))
            gains = np.clip(gains * ratio, *LIMITS)
    lctg.register_to_config(modulation_gains=[round(float(value), 4) for value in gains])
    return lctg.config.modulation_gains


def _power(extractor, textures, sampling_rate):
    """Sum of squares of the fast modulation of each band."""
    waveform, _ = extractor.normalize(textures, sampling_rate)
    return np.square(extractor.fast_modulation(waveform)).sum(axis=(0, 2))

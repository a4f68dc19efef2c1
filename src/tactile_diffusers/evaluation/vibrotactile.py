"""Quality metrics of the vibrotactile codec literature, from the optional package `vibromaf`."""

import numpy as np

from ..signal import resample
from .metrics.texture_checks import check_pair, check_textures

#: Rate that the thresholds of `vibromaf` assume, Hz, and the samples of its blocks.
VIBROMAF_RATE = 8000
VIBROMAF_BLOCK = 512


def vibromaf_metrics(texture, reference, sampling_rate):
    """SPQI and ST-SIM of reconstructions that are aligned with their references (Noll et al. 2022).

    Only for a waveform that follows its reference sample by sample, as a codec's does. For another take of the same
    surface, which feels the same, both are as low as for white noise: they say nothing about generated textures.
    ST-SIM compares spectra with a threshold of perception at an absolute scale, which is not newtons here: compare it
    only between textures of one unit.

    Args:
        texture, reference (`np.ndarray`): (n, samples), N; at least 64 ms.
        sampling_rate (`int`): Hz; both are resampled to the 8 kHz that the metrics assume.

    Returns:
        `dict[str, np.ndarray]`: "spqi" (spectral perceptual quality index) and "st_sim" (spectral-temporal similarity),
        (n,) float64 each, 1 = identical.

    Raises:
        ImportError: if `vibromaf` is not installed.
        ValueError: if the shapes differ or are not (n, samples), a value is not finite, the sampling rate is no
            positive whole number, or the textures are shorter than a block.
    """
    try:
        from vibromaf.metrics.spqi import spqi
        from vibromaf.metrics.stsim import st_sim
    except ImportError as error:
        raise ImportError(
            f'`vibromaf_metrics` needs the package vibromaf: pip install "tactile-diffusers[vibromaf]" ({error})'
        ) from error
    check_textures("texture", texture, rank=2)
    texture, reference = (resample(rows, sampling_rate, VIBROMAF_RATE) for rows in check_pair(texture, reference))
    if texture.shape[-1] < VIBROMAF_BLOCK:
        raise ValueError(
            f"`texture` must last at least {1000 * VIBROMAF_BLOCK / VIBROMAF_RATE:g} ms, one block of the metrics, "
            f"got {1000 * texture.shape[-1] / VIBROMAF_RATE:g} ms."
        )
    pairs = list(zip(texture, reference, strict=True))
    with np.errstate(divide="ignore"):  # silence is minus infinity dB to vibromaf, and that works out
        return {
            "spqi": np.array([spqi(*pair) for pair in pairs], dtype=np.float64),
            # a fractional power of the mean correlation, which is complex where the correlation is negative, as it is
            # for half of all unrelated signals; the real part is then negative too, so "unlike" stays below zero
            "st_sim": np.array([np.real(st_sim(*pair)) for pair in pairs], dtype=np.float64),
        }

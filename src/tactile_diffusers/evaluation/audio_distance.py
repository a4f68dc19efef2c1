"""The Fréchet audio distance of the paper (section 3.3), on any embedding that can be called.

The paper does not say which embedding it used. The usual one, VGGish, does not fit textures: it hears 125 to 7500 Hz,
so it misses the lower half of the octaves that a finger feels and mostly hears what should be empty; it needs a
download, and its fixed offset in the logarithm makes the distance depend on the scaling of the input. The default here
is another embedding, and its distances cannot be compared with those of VGGish.
"""

from functools import lru_cache
from importlib import import_module

import numpy as np
import torch
from scipy import signal

from ..signal import BAND_HZ
from .metrics.distances import frechet_tactile_distance
from .metrics.texture_checks import check_textures

MEL_BANDS = 32
#: Length of the windows and their distance, s: 5 Hz resolve the lowest bands, which are 40 Hz wide.
FRAME_SECONDS = 0.2
HOP_SECONDS = 0.1
#: Frames of a row: three of them span 0.4 s.
ROW_FRAMES = 3
#: Power that is added to each band before the logarithm, N^2: that of 0.01 mN, a fifteenth of the weakest band of any
#: virtual surface.
POWER_OFFSET = 1e-10
# textures that are embedded at once
_CHUNK = 64


def log_mel_embedding(textures, sampling_rate):
    """Log-mel powers of stretches of 0.4 s: an embedding of ours that works offline. It is not VGGish.

    Hann windows of 0.2 s every 0.1 s, 32 triangular mel filters over 20-1000 Hz (HTK's scale, because Slaney's is
    linear below 1 kHz), mean power of three windows, `ln(power + 1e-10 N^2)`. A segment of 1.64 s gives five rows.

    Args:
        textures (`np.ndarray`): (n, samples), N; at least 0.4 s.
        sampling_rate (`float`): Hz, above 2000.

    Returns:
        `np.ndarray`: (n * rows, 32) float64, the rows of a texture next to each other.

    Raises:
        ValueError: if `textures` is not (n, samples), not finite or too short, or the sampling rate too low.
    """
    textures = check_textures("textures", textures, rank=2)
    if sampling_rate <= 2 * BAND_HZ[1]:
        raise ValueError(f"`sampling_rate` must be above {2 * BAND_HZ[1]:g} Hz, got {sampling_rate:g}.")
    frame, hop = (int(round(seconds * sampling_rate)) for seconds in (FRAME_SECONDS, HOP_SECONDS))
    shortest = frame + (ROW_FRAMES - 1) * hop
    if textures.shape[-1] < shortest:
        raise ValueError(
            f"`textures` must have at least {shortest} samples ({shortest / sampling_rate:g} s) for one row, "
            f"got {textures.shape[-1]}."
        )
    filters = _mel_filters(float(sampling_rate), frame) * sampling_rate / frame  # times the bins' width: N^2
    rows = []
    for start in range(0, len(textures), _CHUNK):
        chunk = textures[start : start + _CHUNK].astype(np.float64)
        _, _, density = signal.spectrogram(chunk, sampling_rate, "hann", frame, frame - hop, detrend=False)
        power = filters @ density  # (n, bands, frames)
        frames = power.shape[-1] // ROW_FRAMES * ROW_FRAMES
        power = power[..., :frames].reshape(*power.shape[:2], -1, ROW_FRAMES).mean(-1)
        rows.append(np.log(power + POWER_OFFSET).swapaxes(1, 2).reshape(-1, MEL_BANDS))
    return np.concatenate(rows)


@lru_cache(maxsize=8)
def _mel_filters(sampling_rate, frame):
    """Triangles of height 1, (bands, bins): their sum over the band is 1, so powers add up."""
    import librosa

    return librosa.filters.mel(
        sr=sampling_rate, n_fft=frame, n_mels=MEL_BANDS, fmin=BAND_HZ[0], fmax=BAND_HZ[1], htk=True, norm=None
    ).astype(np.float64)


def frechet_audio_distance(textures, reference, sampling_rate, embedding=log_mel_embedding):
    """Fréchet audio distance of two sets of textures (Kilgour et al. 2019; the paper's section 3.3).

    The Fréchet distance of Gaussians fitted to the embeddings of both sets. It is too large by an amount that falls
    with the number of textures: compare it only with the distance of two real sets of the same sizes, and only under
    one embedding.

    Args:
        textures, reference (`np.ndarray`): (n, samples), (m, samples), N.
        sampling_rate (`float`): of both, Hz.
        embedding (`Callable`): from (n, samples) and a sampling rate to (rows, features), any number of rows for each
            texture, as an array or a tensor; resampling is its own affair.

    Returns:
        `float`: in squared units of the embedding.

    Raises:
        ValueError: if a set is not (n, samples) or not finite, or if the embedding returns anything but a finite
            (rows, features) with more rows than features and the same features for both sets.
    """
    return frechet_tactile_distance(
        _embed("textures", textures, sampling_rate, embedding),
        _embed("reference", reference, sampling_rate, embedding),
    )


def _embed(name, textures, sampling_rate, embedding):
    """What the embedding makes of a set: (rows, features), checked, because anybody may have written it."""
    textures = check_textures(name, textures, rank=2)
    rows = embedding(textures, sampling_rate)
    if isinstance(rows, torch.Tensor):
        rows = rows.detach().cpu().numpy()
    rows = check_textures(f"embedding({name})", rows, rank=2)
    if len(rows) <= rows.shape[1]:
        raise ValueError(
            f"`{name}` is too small: the embedding makes {len(rows)} rows of {rows.shape[1]} features of its "
            f"{len(textures)} textures, and a covariance needs more rows than features. Use more textures, or an "
            "embedding of fewer features."
        )
    return rows


def load_embedding(name):
    """An embedding for `frechet_audio_distance` by its name, for the command line.

    Args:
        name (`str`): "module:callable", such as "tactile_diffusers.evaluation.audio_distance:log_mel_embedding". The
            module must be importable: installed, or in a folder of PYTHONPATH. It is run, so name only what you trust.

    Returns:
        `Callable`: what the module calls so; what it returns is checked when it is used.

    Raises:
        ValueError: if `name` has another form, the module cannot be imported, has no such name, or that is not
            callable.
    """
    module_name, colon, attribute = name.partition(":")
    if not (module_name and colon and attribute):
        raise ValueError(f"An embedding must be named 'module:callable', got {name!r}.")
    try:
        module = import_module(module_name)
    except ImportError as error:
        raise ValueError(
            f"The embedding's module {module_name!r} cannot be imported ({error}). Install it, or put its folder into "
            "PYTHONPATH."
        ) from error
    if not hasattr(module, attribute):
        raise ValueError(f"The module {module_name!r} has no {attribute!r} to embed with.")
    embedding = getattr(module, attribute)
    if not callable(embedding):
        raise ValueError(f"{name!r} must be callable with textures and a sampling rate, got a {type(embedding)}.")
    return embedding

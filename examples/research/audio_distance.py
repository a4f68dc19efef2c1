"""`python audio_distance.py`: the Fréchet audio distance of the paper (section 3.4), on an offline embedding.

The paper does not say which embedding it used. The usual one, VGGish, does not fit textures: it covers 125 to 7500
Hz, which misses the lower half of the octaves that a finger feels and is mostly empty; it needs a download, and its
offset in the logarithm makes the distance depend on the scaling of the input. The embedding here is another one: its
distances cannot be compared with those of VGGish.
"""

import sys
from functools import lru_cache
from pathlib import Path

import numpy as np
from scipy import signal
from study_context import open_study

from tactile_diffusers.evaluation.metrics.distances import frechet_tactile_distance
from tactile_diffusers.evaluation.metrics.texture_checks import check_textures
from tactile_diffusers.signal import BAND_HZ

sys.path.append(str(Path(__file__).parents[1]))  # examples, for `report`

from report.result_files import write_results
from report.tables import markdown_table

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
    """Fréchet audio distance of two sets of textures (Kilgour et al. 2019; the paper's section 3.4).

    It is too large by an amount that falls with the number of textures: compare it only with the distance of two real
    sets of the same sizes, and only under one embedding.

    Args:
        textures, reference (`np.ndarray`): (n, samples), (m, samples), N.
        sampling_rate (`float`): of both, Hz.
        embedding (`Callable`): from (n, samples) and a sampling rate to (rows, features).

    Returns:
        `float`: in squared units of the embedding.

    Raises:
        ValueError: if an embedding is not finite, or has no more rows than features.
    """
    sets = {"textures": textures, "reference": reference}
    rows = [check_textures(f"embedding({name})", embedding(s, sampling_rate), rank=2) for name, s in sets.items()]
    return frechet_tactile_distance(*rows)


def main(argv=None):
    """Prints the distance of generated textures to the training surfaces, beside that of held-out real ones."""
    context = open_study("audio_distance.py", "Fréchet audio distance on a log-mel embedding; not VGGish.", argv)
    data, reference = context.data, context.data.training.textures
    generated, surfaces = context.generated[context.default_guidance].textures, context.requests[1]
    one, real = (np.unique(ids, return_index=True)[1] for ids in (surfaces, data.surfaces))
    sets = {"generated": generated, "real, held out": data.real}
    # takes of one rating differ more than takes of one surface: compare sets of one texture a surface
    sets |= {"generated, one a surface": generated[one], "real, one a surface": data.real[real]}
    rows = {}
    for name, textures in sets.items():
        distance = frechet_audio_distance(textures, reference, data.rate)
        rows[name] = {"textures": len(textures), "distance": distance}
    labels = {"textures": ("textures", 0), "distance": "distance to training surfaces"}
    text = markdown_table(rows, labels=labels)
    write_results(context.output, "audio_distance", rows, text + "\n")
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""How well a decoder knows the textures of a lab: adapting leaves it as it is, and says what that costs."""

import numpy as np
import torch

from ..signal import nine_band_error_db, resample
from ..signal.waveform_shape import waveform_shape

#: Textures at most by which the decoder is judged.
DECODED = 32
#: By how much worse than its own textures it may give a lab's back: factor of the bands' error, and shift of the shapes
#: of waveforms in standard deviations over textures.
BANDS_FACTOR, SHAPE_SHIFT = 2.0, 0.5


def decoder_words(pipe, dataset, seed):
    """A sentence on how well the decoder knows the lab's textures, beside those that the pipeline generates itself."""
    rows = np.linspace(0, len(dataset) - 1, min(DECODED, len(dataset))).round().astype(int)
    bands, shift = decoder_errors(pipe, dataset.textures(rows), dataset.sampling_rate, seed)
    ratings = np.full((len(rows), len(pipe.dale.config.rating_axes)), np.nan)
    made = pipe(ratings, generator=torch.Generator().manual_seed(seed))
    own_bands, own_shift = decoder_errors(pipe, made.textures, made.sampling_rate, seed)
    text = (
        f"From their base layer the decoder (LCTG) gives nine bands back within {bands:.2f} dB and shifts the shape of "
        f"waveforms by {shift:.1f} standard deviations; of its own textures, {own_bands:.2f} dB and {own_shift:.1f}"
    )
    if bands > BANDS_FACTOR * own_bands or shift > own_shift + SHAPE_SHIFT:
        return f"{text}: it knows yours less well. It stays as it is; train_lctg.py with your recordings may help."
    return f"{text}: it stays as it is."


def decoder_errors(pipe, textures, sampling_rate, seed):
    """Textures (n, samples), encoded and decoded from their base layer: nine-band error, dB, and largest shift of a
    statistic of `waveform_shape` in its standard deviations over textures."""
    encoded = pipe.encode(textures, sampling_rate)
    latents = pipe.lctg.pad_detail(encoded.latents[:, : pipe.lctg.base_channels])
    out = pipe.decode(latents, encoded.level, generator=torch.Generator().manual_seed(seed))
    wanted = resample(textures, sampling_rate, out.sampling_rate)
    samples = min(wanted.shape[-1], out.textures.shape[-1])
    made, wanted = out.textures[:, :samples], wanted[:, :samples]
    shapes, theirs = waveform_shape(made), waveform_shape(wanted)
    shifts = [abs(shapes[k].mean() - v.mean()) / max(v.std(), 1e-6) for k, v in theirs.items()]
    return float(nine_band_error_db(made, wanted, out.sampling_rate).mean()), float(max(shifts))

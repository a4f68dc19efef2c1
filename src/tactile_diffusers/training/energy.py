"""Energy scores: losses that compare how results are distributed, not their averages.

A regression averages what its condition leaves open: envelopes flatten, catches vanish. Two results of one condition,
compared with the real one and with each other, keep it: E|a - x| + E|b - x| - E|a - b| is smallest where results are
distributed as real ones are (Gneiting and Raftery 2007, 10.1198/016214506000001437). Of spectrograms it trains vocoders
of one step without an adversary (Gritsenko et al. 2020, arXiv 2008.01160).

What is compared are *views*: tensors (batch, places, values), of which each place is compared as a whole. Those of
DALE's states are `state_views.py`.
"""

import torch

from ..signal import band_edges

#: Of spectrograms: window, hop (samples), and frames that are compared together.
SPECTROGRAMS = ((16, 8, 4), (64, 16, 1), (256, 64, 1))
#: Of the window that has bands: how many, and frames that are compared together.
BANDED_WINDOW, BANDS, BAND_FRAMES = 64, 7, 4
#: Samples of the pieces of the waveform itself: its polarity.
PIECES = (16, 64)
#: Windows over which the polarity is judged, samples, and its weight: among whole pieces it hardly moves a distance.
POLARITY_WINDOWS, POLARITY = (512, 2048), 2.0
#: Power relative to unit RMS that is added under logarithms.
FLOOR = 1e-3


def energy_score(first, second, real, weight=None):
    """Energy score of two results of each condition, lists of views alike: a scalar.

    `weight` (batch,): how much each row counts.
    """
    rows = zip(first, second, real, strict=True)
    return sum(_gap(a, x, weight) + _gap(b, x, weight) - _gap(a, b, weight) for a, b, x in rows)


def _gap(a, b, weight):
    gaps = ((a - b).square().mean(-1) + 1e-6).sqrt().mean(1)
    return (gaps if weight is None else gaps * weight).mean()


def waveform_views(waveform, sampling_rate, band):
    """Views of waveforms (batch, samples), about unit RMS, with their envelope: list of (batch, places, values).

    Log spectra over time in three resolutions; levels of bands over 45 ms; pieces of the waveform itself; the skewness
    of it and of its slope.
    """
    views = []
    for length, hop, together in SPECTROGRAMS:
        window = torch.hann_window(length, device=waveform.device)
        spectrum = torch.stft(waveform, length, hop, window=window, return_complex=True, center=False)
        power = spectrum.abs().square() / window.square().sum()
        if length == BANDED_WINDOW:
            bands = _bands(length, sampling_rate, band, waveform.device) @ power
            views.append(2 * _together((bands + FLOOR).log() / 2, BAND_FRAMES))
        views.append(_together((power + FLOOR).log() / 2, together))
    views += [waveform.unfold(-1, length, length // 2) for length in PIECES]
    return views + [_skewness(values, length) for values in (waveform, waveform.diff()) for length in POLARITY_WINDOWS]


def _skewness(values, length):
    """Third moments of values (batch, samples) over windows, of unit RMS over all: (batch, windows, 1)."""
    cubes = (values / (values.square().mean(-1, keepdim=True) + 1e-6).sqrt()) ** 3
    length = min(length, values.shape[-1])
    return POLARITY * torch.tanh(cubes.unfold(-1, length, length).mean(-1))[..., None]


def _together(values, count):
    """(batch, channels, frames) -> (batch, frames / count, channels x count)."""
    values = values[..., : values.shape[-1] // count * count].unflatten(-1, (-1, count))
    return values.permute(0, 2, 1, 3).flatten(2)


def _bands(length, sampling_rate, band, device):
    """Weights of the bins of a spectrum of `length` samples in each band: (BANDS, length // 2 + 1)."""
    step = sampling_rate / length
    edges = torch.as_tensor(band_edges(BANDS, band), dtype=torch.float32, device=device)
    low, high = edges[:-1, None], edges[1:, None]
    bins = torch.arange(length // 2 + 1, device=device) * step
    shares = (torch.minimum(bins + step / 2, high) - torch.maximum(bins - step / 2, low)).clamp_min(0)
    return shares / shares.sum(1, keepdim=True)

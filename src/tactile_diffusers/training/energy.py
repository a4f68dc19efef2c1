"""Energy scores: losses that compare how results are distributed, not their averages.

A regression averages what its condition leaves open: envelopes flatten, catches vanish. Two results of one condition,
compared with the real one and with each other, keep it: E|a - x| + E|b - x| - E|a - b| is smallest where results are
distributed as real ones are (Gneiting and Raftery 2007, 10.1198/016214506000001437). Of spectrograms it trains vocoders
of one step without an adversary (Gritsenko et al. 2020, arXiv 2008.01160).

What is compared are *views*: tensors (batch, places, values), of which each place is compared as a whole.
"""

from itertools import pairwise

import torch
import torch.nn.functional as F

from ..models.dale_state import cosines, from_scores
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
#: Windows of gain and learned latents in a state, in frames: their length and hop.
FAST_WINDOWS = ((1, 1), (2, 1), (4, 2))
#: Groups of bands in a state, and bounds of its gain and of amplitudes, natural log.
GROUPS, GAINS, AMPLITUDES = 6, (-3.0, 3.0), (-8.0, 4.0)
#: Values to which the course of a group over a whole texture is averaged.
SLOWEST = 8
#: Bands of modulation frequency, as shares of the highest.
MODULATION_SHARES = (0.0, 0.03, 0.08, 0.25, 0.75, 1.0)
#: Least deviation that counts, and how many deviations do: a steady texture has no shape.
LEAST_DEVIATION, LARGEST = 0.02, 8.0


def energy_score(first, second, real, weight=None):
    """Energy score of two results of each condition, lists of views alike: a scalar.

    `weight` (batch,): how much each row counts.
    """
    rows = zip(first, second, real, strict=True)
    return sum(_gap(a, x, weight) + _gap(b, x, weight) - _gap(a, b, weight) for a, b, x in rows)


def _gap(a, b, weight):
    gaps = ((a - b).square().mean(-1) + 1e-6).sqrt().mean(1)
    return (gaps if weight is None else gaps * weight).mean()


# --- waveforms


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


# --- states of DALE


def scalar_views(scalars):
    """Views of scalars (batch, n): each alone, because among all of them one hardly moves a distance; all together."""
    return [scalars[..., None], scalars[:, None]]


class StateViews:
    """Views of DALE's states (batch, in_channels, frames) whose scalars are given: what varies over a texture.

    Windows of what varies, short ones of few channels and longer ones of all, and statistics of the whole. What a catch
    is made of, a peak of the gain and what the learned latents do there, has places of its own: among fifty others
    a distance would not see whether they belong together.

    Args:
        dale (`DALEModel`): whose states they are.
        states (`torch.Tensor`): (n, in_channels, frames) of training textures, from which scales are taken.
    """

    def __init__(self, dale, states):
        self.dale, self._scales, self._middle = dale, (1.0, 1.0), (0.0, 1.0)
        with torch.no_grad():
            fields = [self._fields(part) for part in states.split(512)]
            gain, _, groups = (torch.cat(parts) for parts in zip(*fields, strict=True))
            gain_scale = _deviation(gain.flatten()) if gain.numel() else 1.0
            self._scales = gain_scale, _deviation(_course(groups).transpose(0, 1).flatten(1))[:, None]
            found = torch.cat([self._statistics(*part) for part in fields])
            self._middle = found.mean(0), _deviation(found.T)

    def __call__(self, states):
        """List of (batch, places, values)."""
        gain, learned, groups = fields = self._fields(states)
        (gain_scale, scales), (middle, deviation) = self._scales, self._middle
        statistics = ((self._statistics(*fields) - middle) / deviation).clamp(-LARGEST, LARGEST)
        fast, slow = torch.cat([gain / gain_scale, learned], dim=1), _course(groups) / scales
        halves = F.avg_pool1d(slow, 2)
        views = [_windows(fast, length, hop) for length, hop in FAST_WINDOWS]
        views += [torch.cat([_windows(fast, 2, 2), halves.transpose(1, 2)], dim=-1), _windows(halves, 4, 2)]
        views += [torch.cat([_windows(fast, 8, 8), _windows(halves, 4, 4)], dim=-1)]
        # each group alone: its course over the whole texture, and faster
        views += [F.adaptive_avg_pool1d(slow, SLOWEST), halves.unfold(-1, 4, 2).flatten(1, 2)]
        return [*views, statistics[:, None], statistics[..., None]]

    def _fields(self, states):
        """Gain (batch, envelope_channels, frames) and levels of groups of bands (batch, groups, frames), both natural
        log of amplitude, and the learned latents (batch, channels, frames) at unit variance."""
        scores, learned, departures, means, quantiles, _ = self.dale.read(states)
        frames, gain, groups = states.shape[-1], scores, departures.new_zeros(len(states), 1, states.shape[-1])
        if scores.numel():
            series = scores - scores.mean((1, 2), keepdim=True)
            series = series / series.square().mean((1, 2), keepdim=True).sqrt().clamp_min(LEAST_DEVIATION)
            gain = from_scores(series, quantiles).clamp(*GAINS)
        if departures.numel():
            levels = cosines(departures.shape[1], departures).T @ (departures + means[..., None])
            groups = levels.tensor_split(min(GROUPS, levels.shape[1]), dim=1)
            groups = torch.stack([0.5 * torch.logsumexp(2 * group, dim=1) for group in groups], dim=1)
            groups = groups.repeat_interleave(frames // groups.shape[-1], dim=-1)
        return gain, learned, groups

    def _statistics(self, gain, learned, groups):
        """Statistics of textures (batch, n): of amplitudes over time, and which fields vary together."""
        fields = torch.cat([learned, _course(groups)], dim=1)
        fields = fields / fields.square().mean(-1, keepdim=True).sqrt().clamp_min(LEAST_DEVIATION)
        found = [learned.square().mean(-1).add(1e-4).log(), (fields[..., 1:] * fields[..., :-1]).mean(-1)]
        found += [(fields**3).mean(-1), fields.square().square().mean(-1).add(1e-4).log(), _products(fields, fields)]
        if gain.numel():
            for within in (gain.mean(1), gain.amax(1), gain.std(1)):
                found += [(fields * within[:, None]).mean(-1), (learned.square() * within[:, None]).mean(-1)]
        return torch.cat([*found, *_of_amplitudes(_amplitudes(gain, groups))], dim=1)


def _course(groups):
    return groups - groups.mean(-1, keepdim=True)


def _deviation(values):
    return values.std(-1).clamp_min(1e-3)


def _windows(values, length, hop):
    """Values (batch, channels, frames) in windows: (batch, windows, channels x length)."""
    return values.unfold(-1, length, hop).permute(0, 2, 1, 3).flatten(2)


def _products(first, second):
    """Mean products over time of different channels (batch, channels, n): (batch, pairs)."""
    rows, columns = torch.triu_indices(first.shape[1], second.shape[1], 1, device=first.device)
    return (first @ second.transpose(1, 2) / first.shape[-1])[:, rows, columns]


def _amplitudes(gain, groups):
    """Amplitude over time of groups of bands and of all, relative to their means: (batch, groups + 1, values)."""
    if gain.numel():
        series = gain.transpose(1, 2).flatten(1)[:, None]
        groups = groups.repeat_interleave(gain.shape[1], dim=-1) + series
    loud = torch.cat([groups, 0.5 * torch.logsumexp(2 * groups, dim=1, keepdim=True)], dim=1)
    amplitudes = (loud - loud.mean(-1, keepdim=True)).clamp(*AMPLITUDES).exp()
    return amplitudes / amplitudes.mean(-1, keepdim=True)


def _of_amplitudes(amplitudes):
    """How deeply they vary, how peaked they are, which vary together, how fast, and how unlike rise and fall are."""
    departures, squares = amplitudes - 1, amplitudes.square()
    variance = departures.square().mean(-1, keepdim=True).clamp_min(LEAST_DEVIATION**2)
    peaks = squares.square().mean(-1) / squares.mean(-1).square()
    alike = departures[:, :-1] / variance[:, :-1].sqrt()
    power = torch.fft.rfft(departures, norm="ortho").abs().square()[..., 1:]
    edges = [round(share * power.shape[-1]) for share in MODULATION_SHARES]
    rates = [power[..., low:high].mean(-1).clamp_min(1e-4).log() for low, high in pairwise(edges) if high > low]
    turns = (amplitudes[:, -1:].clamp_min(1e-3).log().diff(dim=-1) ** 3).mean(-1)
    return [variance[..., 0].log(), peaks.log(), amplitudes.amax(-1).log(), _products(alike, alike), *rates, turns]

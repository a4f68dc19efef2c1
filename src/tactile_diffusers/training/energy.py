"""Energy scores: losses that compare how results are distributed, not their averages.

A regression averages what its condition leaves open: envelopes flatten, catches vanish. Two results of one condition,
compared with the real one and with each other, keep it: E|a - x| + E|b - x| - E|a - b| is smallest where results are
distributed as real ones are (Gneiting and Raftery 2007, 10.1198/016214506000001437). Of spectrograms it trains vocoders
of one step without an adversary (Gritsenko et al. 2020, arXiv 2008.01160).

What is compared are *views*: tensors (batch, places, values), of which each place is compared as a whole.
"""

import torch

from ..signal import band_edges

#: Of spectrograms: window, hop (samples), and frames that are compared together.
SPECTROGRAMS = ((16, 8, 4), (64, 16, 1), (256, 64, 1))
#: Of the window that has bands: how many, and frames that are compared together.
BANDED_WINDOW, BANDS, BAND_FRAMES = 64, 7, 4
#: Samples of the pieces of the waveform itself: its polarity.
PIECES = (16, 64)
#: Power relative to unit RMS that is added under logarithms.
FLOOR = 1e-3
#: Lags in values of the fast envelope at which its correlation is compared.
LAGS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32)
#: Windows of a state, in frames: its length and hop.
STATE_WINDOWS = ((2, 2), (8, 4))
#: By how much departures, natural log of amplitude, are scaled beside latents of unit variance.
DEPARTURES = 3.0
#: Bands of the departures in a state, and over how many frames their means are compared.
GROUPS, SLOWER = 6, (1, 4, 16)


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

    Log spectra over time in three resolutions; levels of bands over 45 ms; pieces of the waveform itself.
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
    return views


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


class StateViews:
    """Views of DALE's states (batch, in_channels, frames): texture statistics, and what happens together in a window.

    Args:
        dale (`DALEModel`): whose states they are.
        states (`torch.Tensor`): (n, in_channels, frames) of training textures, from which scales are taken.
    """

    def __init__(self, dale, states):
        self.dale = dale
        with torch.no_grad():
            found = torch.cat([self._statistics(*self.dale.parts(part)) for part in states.split(512)])
        self._mean, self._std = found.mean(0), found.std(0).clamp_min(1e-3)

    def __call__(self, states):
        """List of (batch, places, values): scalars, statistics with them, and windows."""
        envelope, learned, departures, scalars = parts = self.dale.parts(states)
        statistics = ((self._statistics(*parts) - self._mean) / self._std).clamp(-6, 6)
        views = [scalars[:, None], torch.cat([statistics, scalars], dim=1)[:, None]]
        for length, hop in STATE_WINDOWS:
            fast = torch.cat([envelope, learned], dim=1).unfold(-1, length, hop)
            slow = departures.unfold(-1, length, hop).unflatten(-1, (-1, 2)).mean(-1) * DEPARTURES
            window = torch.cat([part.permute(0, 2, 1, 3).flatten(2) for part in (fast, slow)], dim=-1)
            views.append(torch.cat([window, scalars[:, None].expand(-1, window.shape[1], -1) / 2], dim=-1))
        return views

    def _statistics(self, envelope, learned, departures, _):
        """Statistics of textures, (batch, n): how each field varies, and which vary together."""
        found, fields = [], [learned]
        if envelope.numel():
            found += _of_series(envelope.transpose(1, 2).flatten(1))
        if departures.numel():
            groups = departures.tensor_split(min(GROUPS, departures.shape[1]), dim=1)
            groups = torch.stack([group.mean(1) for group in groups], dim=1)
            groups = groups - groups.mean(-1, keepdim=True)
            found += [_log_power(groups[..., : groups.shape[-1] // size * size], size) for size in SLOWER]
            fields.append(groups / groups.square().mean(-1, keepdim=True).add(1e-4).sqrt())
        fields = torch.cat(fields, dim=1)
        if envelope.numel():
            for within in (envelope.mean(1), envelope.amax(1), envelope.std(1)):
                found += [(fields * within[:, None]).mean(-1), (learned.square() * within[:, None]).mean(-1)]
        found += [learned.square().mean(-1).add(1e-6).sqrt(), fields.square().square().mean(-1).add(1e-6) ** 0.25]
        found += [(fields**3).mean(-1).clamp(-4, 4), (fields[..., 1:] * fields[..., :-1]).mean(-1)]
        covariance = fields @ fields.transpose(1, 2) / fields.shape[-1]
        rows, columns = torch.triu_indices(fields.shape[1], fields.shape[1], 1, device=fields.device)
        return torch.cat([*found, covariance[:, rows, columns]], dim=1)


def _of_series(series):
    """Correlations of a series (batch, n) over `LAGS`, and how unlike its rise and fall are."""
    series = series - series.mean(1, keepdim=True)
    lags = [lag for lag in LAGS if lag < series.shape[1]]
    correlations = torch.stack([(series[:, lag:] * series[:, :-lag]).mean(1) for lag in lags], dim=1)
    return [correlations, (series.diff(dim=1) ** 3).mean(1, keepdim=True).clamp(-4, 4)]


def _log_power(values, size):
    """Log power of the means of values (batch, channels, frames) over `size` frames: (batch, channels)."""
    return values.unflatten(-1, (-1, size)).mean(-1).square().mean(-1).add(1e-4).log()

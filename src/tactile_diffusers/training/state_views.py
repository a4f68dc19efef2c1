"""Views of DALE's states, of which energy scores are taken (`energy.py`)."""

from itertools import pairwise

import torch
import torch.nn.functional as F

from ..models.dale_state import cosines, from_scores

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

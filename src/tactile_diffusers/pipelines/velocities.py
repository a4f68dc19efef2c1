"""Velocity functions `velocity(state, step)` of both stages, for one window and for longer textures.

Long textures: overlapping windows of the trained length share one noise field and fuse their velocities.
"""

import torch

from ..models.mixins import has_hooks

#: share of a window that overlaps the next one
OVERLAP = 0.25
#: rows that go through a network at once: bounds the memory of long textures
LARGEST_BATCH = 32


class Windows:
    """Windows of `size` positions over `total` positions, each overlapping the next by a quarter.

    Args:
        total (`int`): positions of the whole, at least `size`.
        size (`int`): positions of a window, a multiple of 4.

    Attributes:
        starts (`list[int]`): first position of each window; the last window ends at `total`.
    """

    def __init__(self, total, size):
        if total < size:
            raise ValueError(f"`total` ({total}) must be at least the window size ({size}).")
        self.total, self.size = total, size
        self.overlap = int(size * OVERLAP)
        self.starts = list(range(0, total - size, size - self.overlap)) + [total - size]

    def scaled(self, factor):
        """The same windows in units `factor` times finer."""
        finer = Windows.__new__(Windows)
        finer.total, finer.size, finer.overlap = self.total * factor, self.size * factor, self.overlap * factor
        finer.starts = [start * factor for start in self.starts]
        return finer

    def cut(self, field):
        """(batch, channels, total) -> (windows * batch, channels, size), window by window."""
        return torch.cat([field[..., start : start + self.size] for start in self.starts])

    def repeat(self, rows):
        """(batch, ...) -> (windows * batch, ...), in the order of `cut`."""
        return rows.repeat(len(self.starts), *([1] * (rows.ndim - 1)))

    def weights(self, device):
        """(windows, size) float32: one where a window is alone, crossfaded (linear) where it overlaps others."""
        ramp = (torch.arange(self.overlap, device=device) + 0.5) / self.overlap
        weights = torch.ones(len(self.starts), self.size, device=device)
        weights[1:, : self.overlap] = ramp
        weights[:-1, self.size - self.overlap :] = ramp.flip(0)
        total = self._add_up(weights)
        return weights / torch.stack([total[place] for place in self._places()])

    def _places(self):
        return [slice(start, start + self.size) for start in self.starts]

    def _add_up(self, pieces):
        """(windows, ..., size) -> (..., total): overlapping windows are summed."""
        field = pieces.new_zeros(*pieces.shape[1:-1], self.total)
        for piece, place in zip(pieces, self._places(), strict=True):
            field[..., place] += piece
        return field

    def fuse(self, pieces):
        """Velocities of all windows, in the order of `cut`, as one field (batch, channels, total).

        Where windows disagree their average would be too weak, and so would the texture. The average is divided by
        what the weights and the measured agreement rho of overlapping windows leave of its RMS,
        sqrt(sum w_i^2 + rho (1 - sum w_i^2)), so that the variance is that of a single window.
        """
        pieces = pieces.unflatten(0, (len(self.starts), -1))
        weights = self.weights(pieces.device)
        fused = self._add_up(weights[:, None, None].to(pieces.dtype) * pieces)
        squares = self._add_up(weights.square())
        left = squares + self._agreement(pieces) * (1 - squares)
        return fused / left.sqrt().to(fused.dtype)

    def _agreement(self, pieces):
        """Mean correlation of neighbouring windows where they overlap, in [0, 1]: (batch, 1, 1)."""
        product = power = torch.zeros(1, device=pieces.device)
        for row, (start, following) in enumerate(zip(self.starts[:-1], self.starts[1:], strict=True)):
            shift = following - start
            a, b = pieces[row, ..., shift:].float(), pieces[row + 1, ..., : self.size - shift].float()
            product = product + (a * b).sum((-2, -1), keepdim=True)
            power = power + 0.5 * (a.square() + b.square()).sum((-2, -1), keepdim=True)
        return (product / power.clamp_min(1e-30)).clamp(0, 1)


def in_chunks(function, *rows):
    """`function(*rows)` evaluated on at most `LARGEST_BATCH` rows at a time."""
    parts = zip(*(row.split(LARGEST_BATCH) for row in rows), strict=True)
    return torch.cat([function(*part) for part in parts])


def rating_velocity(dale, scheduler, ratings, frames, guidance):
    """DALE's velocity given ratings (batch, axes) in z-scores, NaN = not specified, at the scheduler's timesteps.

    `frames` (at least DALE's `latent_frames`, the window) are those of the whole. `guidance()` is the `Guidance` of the
    next step, which a callback may change.
    """
    windows = Windows(frames, dale.config.latent_frames)
    if len(windows.starts) == 1:
        return _segment_velocity(dale, scheduler, ratings, guidance)
    dtype, timesteps, window_ratings = dale.dtype, scheduler.timesteps, windows.repeat(ratings)

    def guided(state, t, ratings):
        weights, rows = guidance().conditions(ratings)
        return guidance().velocity(dale, scheduler, state, t, rows, weights)

    def fused(state, step):
        field, scalars = dale.split_scalars(state.to(dtype))  # every window gets the level and friction of the whole
        pieces = dale.append_scalars(windows.cut(field), windows.repeat(scalars))
        t = timesteps[step]
        velocity = in_chunks(lambda piece, rating: guided(piece, t, rating), pieces, window_ratings)
        field, scalars = dale.split_scalars(velocity)
        return dale.append_scalars(windows.fuse(field), scalars.unflatten(0, (len(windows.starts), -1)).mean(0))

    return fused


def _segment_velocity(dale, scheduler, ratings, guidance):
    """`rating_velocity` of one window: conditions of all steps are computed together, again if guidance changes."""
    dtype, timesteps = dale.dtype, scheduler.timesteps
    current = weights = conditions = None

    def velocity(state, step):
        nonlocal current, weights, conditions
        if guidance() != current:
            current = guidance()
            weights, rows = current.conditions(ratings)
            conditions = [rows] * len(timesteps) if has_hooks(dale) else dale.condition(rows, timesteps)
        # the sampler's state is wider than a half-precision model
        return current.velocity(dale, scheduler, state.to(dtype), timesteps[step], conditions[step], weights)

    return velocity


def texture_velocity(lctg, latents, timesteps):
    """LCTG's velocity given latents (batch, latent_channels, frames) of its dtype, at timesteps (steps,)."""
    size = lctg.config.segment_samples // lctg.config.latent_hop
    windows, dtype = Windows(latents.shape[-1], min(size, latents.shape[-1])), latents.dtype
    if len(windows.starts) == 1:
        conditions = [latents] * len(timesteps) if has_hooks(lctg) else lctg.condition(latents, timesteps)
        return lambda waveform, step: lctg(waveform.to(dtype), timesteps[step], conditions[step], return_dict=False)[0]
    fine, contexts = windows.scaled(lctg.config.latent_hop), windows.cut(latents)

    def fused(waveform, step):
        pieces, t = fine.cut(waveform.to(dtype)), timesteps[step]
        return fine.fuse(in_chunks(lambda x, z: lctg(x, t, z, return_dict=False)[0], pieces, contexts))

    return fused

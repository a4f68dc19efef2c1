"""Long textures: overlapping windows of the trained length share one noise field and fuse their velocities."""

import torch

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

"""Random numbers of a training batch, the same however the batch is spread over processes."""

import torch


class Draws:
    """Draws for all rows of the global batch and keeps those of this process.

    So two processes with batches of 8 train on the noise and the times that one process draws for a batch of 16, and
    their loss curves are the same but for rounding.

    Args:
        generator (`torch.Generator`): in the same state in every process.
        device (`torch.device`): where numbers are drawn, the generator's.
        share (`tuple[int, int]`, *optional*, defaults to `(0, 1)`): index of this process, and number of processes.
    """

    def __init__(self, generator, device, share=(0, 1)):
        self.generator, self.device = generator, device
        self.index, self.processes = share

    def _rows(self, kind, rows, *rest):
        whole = kind((rows * self.processes, *rest), generator=self.generator, device=self.device)
        return whole[self.index * rows : (self.index + 1) * rows]

    def normal(self, *shape):
        """Normal numbers (rows, ...) float32, where `rows` are this process's."""
        return self._rows(torch.randn, *shape)

    def uniform(self, *shape):
        """Uniform numbers in [0, 1) (rows, ...) float32, where `rows` are this process's."""
        return self._rows(torch.rand, *shape)

    def strata(self, rows):
        """Uniform numbers in [0, 1), (rows,) float32, stratified over the global batch: one in each equal part."""
        first = self.index * rows
        places = torch.arange(first, first + rows, device=self.device) + self.uniform(rows)
        return places / (rows * self.processes)

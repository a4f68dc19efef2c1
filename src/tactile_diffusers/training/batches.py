"""Which items a batch of a training holds, and how they are put together."""

import itertools

import torch


def make_collate(extractor, sampling_rate):
    """A function that turns items of a `PreparedDataset` into what the decoder learns, and its features.

    Args:
        extractor (`TactileFeatureExtractor`): the pipeline's.
        sampling_rate (`int`): of the items, Hz.

    Returns:
        `Callable`: list of `{"texture": (samples,)}` -> `{"waveform": (batch, samples), "input_features": (batch,
        channels, frames)}`, float32.
    """

    def collate(items):
        waveform, _ = extractor.normalize(torch.stack([item["texture"] for item in items]), sampling_rate)
        return {
            "waveform": torch.from_numpy(extractor.evened(waveform)),
            "input_features": torch.from_numpy(extractor.features(waveform)),
        }

    return collate


class EndlessBatches(torch.utils.data.Sampler):
    """Batches of indices for ever: a new seeded permutation each epoch, incomplete last batches dropped.

    The n-th batch depends on the seed and n alone, so a resumed training continues where it was. Processes take turns:
    their batches of one step are together the batch that a single process with as many rows would have.

    Args:
        length (`int`): size of the data set.
        batch_size (`int`): indices per batch of one process.
        seed (`int`): of the permutations.
        start (`int`): number of batches to skip.
        processes (`int`): that take turns; `processes * batch_size` is at most `length`.

    Raises:
        ValueError: if a global batch exceeds the data set.
    """

    def __init__(self, length, batch_size, seed, start=0, processes=1):
        if length < batch_size * processes:
            of_each = f" in each of {processes} processes" if processes > 1 else ""
            raise ValueError(
                f"`train_batch_size` ({batch_size}){of_each} exceeds the number of training segments ({length})."
            )
        self.length, self.batch_size, self.seed = length, batch_size, seed
        self.start, self.processes = start, processes
        self.drop_last = True  # read by accelerate when it shares batches between processes

    def __iter__(self):
        known, order = None, None
        for number in itertools.count(self.start):
            epoch, place = self._place(number)
            if epoch != known:
                known, order = epoch, self._order(epoch)
            yield self._cut(order, place)

    def batch(self, number):
        """The indices of the n-th batch, counted from the beginning of the training."""
        epoch, place = self._place(number)
        return self._cut(self._order(epoch), place)

    def _place(self, number):
        # epochs end with a whole global batch, so that they end alike for any number of processes
        return divmod(number, self.length // (self.batch_size * self.processes) * self.processes)

    def _order(self, epoch):
        return torch.randperm(self.length, generator=torch.Generator().manual_seed(self.seed * 7919 + epoch))

    def _cut(self, order, place):
        return order[place * self.batch_size : (place + 1) * self.batch_size].tolist()

"""Batches without end, noise of several processes, and the names of checkpoints."""

from itertools import islice

import pytest
import torch

from tactile_diffusers.training.batches import EndlessBatches
from tactile_diffusers.training.checkpoints import latest_checkpoint
from tactile_diffusers.training.steps import BatchNoise


def _batches(count, *arguments, **options):
    return list(islice(EndlessBatches(*arguments, **options), count))


class TestEndlessBatches:
    @pytest.mark.parametrize("start", [0, 1, 2, 3, 4, 7, 11])
    def test_it_continues_where_it_was(self, start):
        assert _batches(9, 10, 3, 5, start) == _batches(start + 9, 10, 3, 5)[start:]

    def test_an_epoch_is_a_permutation(self):
        batches = _batches(12, 12, 4, 0)
        epochs = [sum(batches[first : first + 3], []) for first in range(0, 12, 3)]
        assert all(sorted(epoch) == list(range(12)) for epoch in epochs)
        assert len({tuple(epoch) for epoch in epochs}) == 4

    def test_incomplete_last_batches_are_dropped_but_every_index_gets_its_turn(self):
        batches = _batches(60, 10, 4, 0)
        assert all(len(batch) == 4 for batch in batches)
        for first in range(0, 60, 2):
            assert len(set(batches[first] + batches[first + 1])) == 8
        assert set(sum(batches, [])) == set(range(10))

    @pytest.mark.parametrize(("processes", "where"), [(1, ""), (2, " in each of 2 processes")])
    def test_too_large_a_global_batch_is_refused(self, processes, where):
        with pytest.raises(ValueError, match=rf"`train_batch_size` \(5\){where} exceeds .* \(4\)"):
            EndlessBatches(4, 5, 0, processes=processes)

    @pytest.mark.parametrize("length", [12, 14, 23])
    def test_processes_that_take_turns_share_the_batches_of_one(self, length):
        small, large = _batches(30, length, 2, 5, processes=3), _batches(10, length, 6, 5)
        assert [sum(small[turn : turn + 3], []) for turn in range(0, 30, 3)] == large


class TestBatchNoise:
    def _numbers(self, rows, share=(0, 1)):
        random = BatchNoise(torch.Generator().manual_seed(3), torch.device("cpu"), share)
        return [random.normal(rows, 3), random.uniform(rows), random.stratified(rows), random.normal(rows, 1, 5)]

    @pytest.mark.parametrize("processes", [2, 3])
    def test_processes_draw_together_what_one_draws(self, processes):
        parts = [self._numbers(2, (index, processes)) for index in range(processes)]
        for one, several in zip(self._numbers(2 * processes), zip(*parts, strict=True), strict=True):
            assert torch.equal(one, torch.cat(several))

    def test_each_part_of_a_stratified_batch_holds_one_number(self):
        places = torch.cat([self._numbers(5, (index, 2))[2] for index in range(2)])
        assert torch.equal((places * 10).floor(), torch.arange(10.0))


@pytest.mark.parametrize(
    ("names", "latest"),
    [
        (("checkpoint-9", "checkpoint-100", "checkpoint-20"), "checkpoint-100"),
        (("unfinished-checkpoint-900", "checkpoint-best", "checkpoint-", "checkpoint-3-old"), None),
        (("unfinished-checkpoint-900", "checkpoint-2"), "checkpoint-2"),
    ],
)
def test_the_latest_checkpoint_has_the_largest_step_and_is_whole(tmp_path, names, latest):
    for name in names:
        (tmp_path / name).mkdir()
    assert latest_checkpoint(str(tmp_path)) == (latest and tmp_path / latest)
    assert latest_checkpoint(tmp_path / "nowhere") is None

"""What the loop is made of: batches, checkpoints' names, arguments."""

import argparse
from itertools import islice

import pytest

from tactile_diffusers.training.arguments import add_training_arguments, check_training_arguments
from tactile_diffusers.training.batches import EndlessBatches
from tactile_diffusers.training.loop import latest_checkpoint


def _batches(count, *arguments):
    return list(islice(EndlessBatches(*arguments), count))


class TestEndlessBatches:
    @pytest.mark.parametrize("start", [0, 1, 2, 3, 4, 7, 11])
    def test_it_goes_on_where_it_was(self, start):
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

    def test_seeds_differ(self):
        assert _batches(3, 100, 10, 0) != _batches(3, 100, 10, 1)

    def test_a_batch_as_large_as_the_data_set(self):
        assert [sorted(batch) for batch in _batches(3, 4, 4, 0)] == [[0, 1, 2, 3]] * 3

    def test_too_large_a_batch_is_refused(self):
        with pytest.raises(ValueError, match=r"`train_batch_size` \(5\) exceeds .* \(4\)"):
            EndlessBatches(4, 5, 0)


class TestLatestCheckpoint:
    def test_largest_step_wins(self, tmp_path):
        for name in ("checkpoint-9", "checkpoint-100", "checkpoint-20"):
            (tmp_path / name).mkdir()
        assert latest_checkpoint(tmp_path) == tmp_path / "checkpoint-100"

    def test_half_written_and_foreign_folders_are_ignored(self, tmp_path):
        for name in ("unfinished-checkpoint-900", "checkpoint-best", "checkpoint-", "checkpoint-3-old"):
            (tmp_path / name).mkdir()
        assert latest_checkpoint(tmp_path) is None
        (tmp_path / "checkpoint-2").mkdir()
        assert latest_checkpoint(str(tmp_path)) == tmp_path / "checkpoint-2"

    def test_no_folder_no_checkpoint(self, tmp_path):
        assert latest_checkpoint(tmp_path / "nowhere") is None


class TestArguments:
    @pytest.fixture
    def parse(self):
        parser = add_training_arguments(argparse.ArgumentParser())
        return lambda *words: parser.parse_args(["--train_data_dir", "d.h5", "--output_dir", "out", *words])

    def test_defaults_are_possible(self, parse):
        assert check_training_arguments(parse()) is None

    @pytest.mark.parametrize(
        ("name", "value"),
        [
            *((name, value) for name in ("train_batch_size", "max_train_steps") for value in ("0", "-3")),
            ("eval_batch_size", "0"),
            ("num_train_epochs", "0"),
            ("gradient_accumulation_steps", "0"),
            ("checkpointing_steps", "0"),
            ("validation_steps", "0"),
            ("validation_samples", "-1"),
            ("max_train_samples", "0"),
            ("checkpoints_total_limit", "0"),
            *(("learning_rate", value) for value in ("0", "-1e-3", "nan")),
            *(("ema_decay", value) for value in ("1", "-0.1", "nan")),
        ],
    )
    def test_impossible_values_are_refused_by_name(self, parse, name, value):
        with pytest.raises(ValueError, match=f"--{name} "):
            check_training_arguments(parse(f"--{name}={value}"))

    @pytest.mark.parametrize(
        "words", [["--mixed_precision", "int8"], ["--report_to", "fax"], ["--seed", "x"], ["--no_such_thing"]]
    )
    def test_unknown_choices_are_refused(self, parse, words, capsys):
        with pytest.raises(SystemExit):
            parse(*words)
        assert words[0] in capsys.readouterr().err

"""What a training leaves behind, and what reads it: cards, reports, ablations, pictures, the training that goes on.

All of it is optional: damage is the same as absence. A card alone needs the whole of a record, and refuses it by name.
"""

import json
from types import SimpleNamespace

import pytest
from ablate_training import training_facts as facts_of_a_row
from report.running import training_facts

from tactile_diffusers.training.card import describe_run
from tactile_diffusers.training.record import (
    count_seen,
    is_complete,
    phases,
    read_log,
    read_record,
    trained_on,
    trim_log,
)
from tactile_diffusers.training.validation import plot_losses

RECORD = {
    "script": "examples/train_lctg.py",
    "arguments": {"seed": 3, "pretrained_model_name_or_path": None},
    "changed": {"seed": 3},
    "segments": 7,
    "trained_on": {"source": "a test", "seed": None, "surfaces": ["a", "b"]},
    "steps": 9,
    "processes": 1,
    "machine": "a test",
    "versions": {"torch": "2"},
}
LOG = [
    {"step": 5, "train/loss": 0.5, "train/velocity": 0.5, "seconds": 9.0},
    {"step": 9, "train/loss": 0.4, "train/velocity": 0.4, "seconds": 18.0},
    {"step": 9, "validation/snr_db": 1.0},
]
JUDGED = {"seed": None, "surfaces": ["a", "c"]}


@pytest.fixture
def run(tmp_path):
    """The output folder of a training."""
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / "training.json").write_text(json.dumps(RECORD))
    (folder / "log.jsonl").write_text("".join(json.dumps(entry) + "\n" for entry in LOG))
    return folder


def _read_all(run):
    """Every reader in turn; returns whether a card could be written."""
    assert phases(run)[-1][0] == run
    assert set(training_facts(run)) >= {"phases", "optimiser_steps"}
    found, _ = trained_on([run])
    assert count_seen(JUDGED, found) in (0, 1)
    record = read_record(run)
    try:
        describe_run(run, run.parent, 1)
    except ValueError as error:
        assert str(run / "training.json") in str(error) and not is_complete(record)
    return is_complete(record)


def test_a_whole_record_is_told(run):
    assert _read_all(run)
    assert describe_run(run, run.parent, 1)["loss"] == "0.4000"


@pytest.mark.parametrize("key", [*RECORD, "surfaces", "pretrained_model_name_or_path"])
def test_a_key_of_a_record_is_missing_or_odd(key, run, odd_values):
    for odd in (*odd_values, [], {}, "a\0b", "x" * 5000, True, 1e300, -1, [{}], {"/": [{}]}):
        record = json.loads(json.dumps(RECORD))
        part = next((part for part in (record["trained_on"], record["arguments"]) if key in part), record)
        part.pop(key)
        part |= {} if odd == "missing" else {key: odd}
        (run / "training.json").write_text(json.dumps(record))
        _read_all(run)


def test_a_truncated_record_and_other_files(run, foreign):
    good = (run / "training.json").read_bytes()
    for content in (*(good[: len(good) * tenth // 10] for tenth in range(10)), *foreign.values()):
        (run / "training.json").write_bytes(content)
        assert not _read_all(run)


def test_the_surfaces_of_a_published_checkpoint(tmp_path, foreign):
    path, good = tmp_path / "trained_on.json", json.dumps({"complete": True, "trained_on": [RECORD["trained_on"]]})
    path.write_text(good)
    assert trained_on([tmp_path]) == ([RECORD["trained_on"]], True)
    cuts = [good[: len(good) * tenth // 10].encode() for tenth in range(10)]
    odd = [{"trained_on": 7}, {"trained_on": [{"surfaces": [["a"]]}]}, {"trained_on": [{"surfaces": 3}, None]}]
    for content in (*cuts, *foreign.values(), *(json.dumps({"complete": True} | one).encode() for one in odd)):
        path.write_bytes(content)
        assert trained_on([tmp_path]) == ([], False)


#: Lines of a log that are left out.
DAMAGED = (
    b'{"step": 7, "train/loss": "word"}',
    b'{"step": 7, "train/loss": [1]}',
    b'{"step": true, "train/loss": 1}',
    b'{"step": -1}',
    b'{"step": 7, "train/loss": 1' + b"0" * 400 + b"}",
    b'{"step": 1' + b"0" * 30 + b"}",
    b'{"step": 7, "train/lo',
    b"\xff\xfe\x00",
    b"[" * 100_000,
    b"null",
)


def test_damaged_lines_of_a_log_are_left_out(run):
    good = (run / "log.jsonl").read_bytes()
    (run / "log.jsonl").write_bytes(b"\n".join(DAMAGED) + b"\n" + good + DAMAGED[6])
    assert read_log(run) == LOG
    assert _read_all(run)
    plot_losses(run)
    assert (run / "loss.png").read_bytes()[:4] == b"\x89PNG"
    assert trim_log(run, 5) == LOG[:1]  # a training that goes on mends it
    assert (run / "log.jsonl").read_text() == json.dumps(LOG[0]) + "\n"


@pytest.mark.parametrize("size", [0, 30, 100])
def test_a_log_that_was_cut(run, size):
    (run / "log.jsonl").write_bytes((run / "log.jsonl").read_bytes()[:size])
    assert _read_all(run)
    stage = SimpleNamespace(folder=run, script="train_lctg.py")
    if read_log(run):
        assert facts_of_a_row([stage])["step_seconds"] == 1.8
    else:
        with pytest.raises(ValueError, match="log.jsonl is damaged.*to train it again"):
            facts_of_a_row([stage])

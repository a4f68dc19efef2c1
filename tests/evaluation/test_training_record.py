"""Facts of a training: phases followed back, and sums over them."""

import json

import pytest
from report.running import training_facts


def _training(folder, steps, seconds, before=None, **arguments):
    """A folder as the training scripts leave it: a loss that falls from 2 to 1."""
    folder.mkdir(parents=True)
    arguments |= {} if before is None else {"pretrained_model_name_or_path": str(before)}
    (folder / "training.json").write_text(json.dumps({"steps": steps, "arguments": arguments, "machine": "a test"}))
    log = [
        {"step": step, "train/loss": 2 - step / steps, "seconds": seconds * step / steps}
        for step in range(steps // 10, steps + 1, steps // 10)
    ]
    log.append({"step": steps, "validation/nine_band_db": 1.0})
    (folder / "log.jsonl").write_text("".join(json.dumps(entry) + "\n" for entry in log))
    return folder


def test_phases_are_followed_back_and_summed(tmp_path):
    full = _training(tmp_path / "full", 200, 60)
    last = _training(tmp_path / "filtered", 100, 40, before=full)
    dale = _training(tmp_path / "dale", 900, 500, before=last, condition_dropout=0.25)
    for folder in (last, dale):
        facts = training_facts(folder)
        assert facts["phases"] == ["full", "filtered"]
        assert (facts["optimiser_steps"], facts["seconds"]) == (300, 100)


def test_a_phase_that_was_moved_is_found_beside_and_one_that_is_lost_leaves_sums_unknown(tmp_path):
    _training(tmp_path / "full", 200, 60)
    assert training_facts(_training(tmp_path / "a", 100, 40, "/nowhere/full"))["optimiser_steps"] == 300
    facts = training_facts(_training(tmp_path / "b", 100, 40, "/nowhere/lost"))
    assert facts["optimiser_steps"] is facts["seconds"] is None


def test_a_folder_without_a_record_knows_nothing(tmp_path):
    facts = training_facts(tmp_path)
    assert facts == {"phases": [], "optimiser_steps": None, "seconds": None}


def test_a_training_that_goes_on_from_itself_ends(tmp_path):
    assert training_facts(_training(tmp_path / "a", 100, 40, tmp_path / "a"))["optimiser_steps"] == 100


def test_what_was_done_counts_not_what_was_planned_and_a_cut_line_is_left_out(tmp_path):
    folder = _training(tmp_path / "a", 100, 40)
    lines = (folder / "log.jsonl").read_text().splitlines()
    (folder / "log.jsonl").write_text("\n".join(lines[:6]) + '\n{"step": 70, "tra')
    facts = training_facts(folder)
    assert facts["optimiser_steps"] == 60 and facts["seconds"] == pytest.approx(24)
    (folder / "log.jsonl").unlink()
    facts = training_facts(folder)
    assert facts["optimiser_steps"] == 100 and facts["seconds"] is None

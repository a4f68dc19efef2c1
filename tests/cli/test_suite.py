"""What commands that measure share."""

import json

import torch

from tactile_diffusers.evaluation.result_files import machine, write_results


def test_results_are_two_files_of_one_name(tmp_path):
    report = {"b": [1.5], "a": None}
    write_results(tmp_path / "new" / "folder", "speed", report, "### Tables\n")
    folder = tmp_path / "new" / "folder"
    assert sorted(path.name for path in folder.iterdir()) == ["speed.json", "speed.md"]
    assert (folder / "speed.json").read_text() == json.dumps(report, indent=2) + "\n"
    assert (folder / "speed.md").read_text() == "### Tables\n"


def test_the_machine_is_named_with_what_computes():
    assert f", {torch.get_num_threads()} threads, torch {torch.__version__}" in machine()
    assert machine("7 cores") == machine().replace(f"{torch.get_num_threads()} threads", "7 cores")

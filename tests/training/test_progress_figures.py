"""Pictures of a training: what is logged once is seen, what differs is told apart."""

import json
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from tactile_diffusers.training.validation import plot_axis_sweep, plot_losses


@pytest.fixture
def drawn(monkeypatch):
    """The figures that would have been saved."""
    found = []

    def save(figure, path, **_):
        found.append([(axis.get_legend_handles_labels()[1], list(axis.lines)) for axis in figure.axes])
        Path(path).write_bytes(b"png")

    monkeypatch.setattr(Figure, "savefig", save)
    return found


def test_a_single_point_is_seen(drawn, tmp_path):
    log = [{"step": 30, "train/loss": 0.5}, {"step": 30, "validation/a": 1.0}, {"step": 60, "validation/a": 0.5}]
    (tmp_path / "log.jsonl").write_text("".join(json.dumps(entry) + "\n" for entry in log) + '{"step": 61, "tr')
    plot_losses(tmp_path)
    (_, [train]), (_, [validation]) = drawn[0]
    assert train.get_marker() == "o" and validation.get_marker() == ""


def test_a_bound_is_asked_for_once(drawn, evaluable_pipe, tmp_path):
    pipe = evaluable_pipe()
    pipe.set_progress_bar_config(disable=True)
    pipe.dale.register_to_config(rating_statistics={"range": [[-0.9, 0.9]] * 3})
    plot_axis_sweep(pipe, tmp_path / "sweep.png", takes=1, values=(-2.0, -1.0, 0.0, 1.0))
    for labels, lines in drawn[0]:
        assert len(lines) == 3 and [label.split(",")[0] for label in labels] == ["-0.90", "+0.00", "+0.90"]

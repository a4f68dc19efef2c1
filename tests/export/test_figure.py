"""The picture of a texture."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from tactile_diffusers.export import write_figure

COMMON = {"sampling_rate": 10000, "friction_coefficient": 0.62, "ratings": [1.5, float("nan"), -1.0]}


@pytest.fixture
def texture():
    return 0.009 * np.random.default_rng(0).normal(size=4000)


@pytest.mark.parametrize("gain", [1.0, 0.0])
def test_it_is_a_png_of_the_size_of_a_page(tmp_path, texture, gain):
    write_figure(tmp_path / "a.png", gain * texture, **COMMON)
    header = (tmp_path / "a.png").read_bytes()[:24]
    assert header.startswith(b"\x89PNG")
    assert int.from_bytes(header[16:20]) > 1000 and int.from_bytes(header[20:24]) > 600


def test_a_reconstruction_is_shown_with_the_original(tmp_path, texture, monkeypatch):
    drawn = []
    save = lambda figure, path, **_: drawn.append(figure) or Path(path).write_bytes(b"png")  # noqa: E731
    monkeypatch.setattr(Figure, "savefig", save)
    write_figure(tmp_path / "a.png", 0.5 * texture, **COMMON | {"ratings": [float("nan")] * 3}, original=texture)
    waveform, spectrum, *_ = drawn[0].axes
    for panel in (waveform, spectrum):
        assert panel.lines[0].get_label() == "original" and len(panel.lines) == 2
    np.testing.assert_allclose(waveform.lines[0].get_ydata(), 1e3 * texture)
    assert drawn[0].get_suptitle().startswith("reconstruction, RMS ") and "specified" not in drawn[0].get_suptitle()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"texture": np.zeros(100)}, "too short to draw"),
        ({"texture": np.zeros((1, 2000))}, "`texture` must have the shape"),
        ({"sampling_rate": 44100.5}, "`sampling_rate` must be a whole number of Hz"),
        ({"friction_coefficient": -0.1}, "`friction_coefficient` must be above zero"),
        ({"ratings": [1.0, 2.0]}, "`ratings` must be 3 numbers"),
    ],
)
def test_bad_arguments_are_refused(tmp_path, texture, change, message):
    with pytest.raises(ValueError, match=message):
        write_figure(tmp_path / "a.png", **{"texture": texture, **COMMON, **change})
    assert list(tmp_path.iterdir()) == []

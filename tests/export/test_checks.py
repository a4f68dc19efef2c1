"""Bad arguments are refused before anything is written, by every writer alike."""

import numpy as np
import pytest

from tactile_diffusers.export import FORMATS, write_figure, write_npz, write_wav

GOOD = {"sampling_rate": 10000, "friction_coefficient": 0.6, "ratings": [1.5, 0.0, -1.0]}


def _npz(folder, texture, **options):
    write_npz(folder / "texture.npz", texture, **{**GOOD, "seed": 0, "reference_speed": 80.0, **options})


def _wav(folder, texture, **options):
    write_wav(folder / "texture.wav", texture, **{**GOOD, "seed": 0, **options})


def _figure(folder, texture, **options):
    write_figure(folder / "texture.png", texture, **{**GOOD, **options})


def _format(name):
    def write(folder, texture, **options):
        all_given = {**GOOD, "seed": 0, "reference_speed": 80.0, **options}
        FORMATS[name].write(folder / "texture", texture, **all_given)

    return pytest.param(write, id=name)


@pytest.mark.parametrize("write", [_npz, _wav, _figure, *map(_format, FORMATS)])
@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"texture": np.zeros((1, 2000))}, r"`texture` must have the shape \(samples,\), got \(1, 2000\).*one by one"),
        ({"texture": np.zeros(0)}, "`texture` must have the shape"),
        ({"texture": np.r_[np.zeros(1999), np.nan]}, "`texture` must be finite, got nan at sample 1999"),
        ({"texture": np.r_[-np.inf, np.zeros(1999)]}, "`texture` must be finite, got -inf at sample 0"),
        ({"texture": np.array(["a"] * 2000)}, "`texture` must hold real numbers"),
        ({"sampling_rate": 0}, "`sampling_rate` must be a positive whole number of Hz, got 0"),
        ({"sampling_rate": -10000}, "`sampling_rate` must be.*got -10000"),
        ({"sampling_rate": 44100.5}, "`sampling_rate` must be.*got 44100.5"),
        ({"sampling_rate": float("nan")}, "`sampling_rate` must be.*got nan"),
        ({"friction_coefficient": -0.1}, "`friction_coefficient` must be above zero.*got -0.1"),
        ({"friction_coefficient": float("inf")}, "`friction_coefficient` must be above zero.*got inf"),
        ({"ratings": [1.0, 2.0]}, r"`ratings` must be 3 numbers, roughness, bumpiness, slipperiness, got \[1.0, 2.0\]"),
        ({"ratings": [1.0, 2.0, float("inf")]}, "`ratings` must be 3 numbers"),
    ],
)
def test_every_writer_refuses(tmp_path, write, change, message):
    with pytest.raises(ValueError, match=message):
        write(tmp_path, **{"texture": np.zeros(2000), **change})
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("write", "change", "message"),
    [
        (_npz, {"seed": 0.5}, "`seed` must be a whole number of at least 0 and below 2..64, got 0.5"),
        (_wav, {"seed": 2**64}, "`seed` must be a whole number"),
        (_npz, {"reference_speed": 0.0}, "`reference_speed` must be above zero"),
        (_wav, {"subtype": "PCM_24"}, "`subtype` must be .*got 'PCM_24'"),
    ],
)
def test_what_only_some_writers_take(tmp_path, write, change, message):
    with pytest.raises(ValueError, match=message):
        write(tmp_path, np.zeros(2000), **change)
    assert list(tmp_path.iterdir()) == []

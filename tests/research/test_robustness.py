"""`examples/research/robustness.py`: hard inputs, their figures, and the study on a tiny pipeline."""

import json
from dataclasses import replace

import numpy as np
import pytest
import robustness
from report.sections import QUICK, make_context

from tactile_diffusers.data import HoldOut, PreparedDataset, SegmentLimits, prepare_recordings
from tactile_diffusers.signal import BAND_HZ, DEVICE_RATE, band_edges, band_levels_db, band_pass, rms
from tactile_diffusers.virtual import generate_recordings


@pytest.fixture(scope="module")
def inputs():
    textures = 0.01 * band_pass(np.random.default_rng(0).standard_normal((3, 16_384)), DEVICE_RATE)
    return robustness.hard_inputs(textures, DEVICE_RATE, BAND_HZ, np.random.default_rng(0))


def _means(generated, textures):
    found = robustness.hard_metrics(generated, textures, DEVICE_RATE, band_edges())
    return {name: leaf["mean"] for name, leaf in found.items()}


def test_hard_inputs_are_as_described(inputs):
    assert all(textures.shape == (3, 16_384) and np.isfinite(textures).all() for textures in inputs.values())
    assert not inputs["silence"].any() and np.ptp(inputs["constant"]) == 0
    assert (np.count_nonzero(inputs["click"], axis=-1) == 1).all()
    np.testing.assert_allclose(rms(inputs["faint"]), 1e-6)
    for name, edge in (("low_tone", 20), ("high_tone", 1000)):
        peak = np.abs(np.fft.rfft(inputs[name])).argmax(-1) * DEVICE_RATE / 16_384
        np.testing.assert_allclose(peak, edge, atol=0.5)  # less than a bin
    white, band = (
        band_levels_db(inputs[name], DEVICE_RATE, (20, 1000, 5000)) for name in ("white_noise", "band_noise")
    )
    assert (white[:, 1] > white[:, 0] + 5).all() and (band[:, 1] < band[:, 0] - 15).all()


def test_an_exact_copy_has_no_error(inputs):
    for name, textures in inputs.items():
        found = _means(textures, textures)
        assert found["finite"] == 1
        if name in ("silence", "constant"):  # nothing inside the band: no error is defined
            assert found["level_error_db"] is None and found["nine_band_db"] is None
        else:
            assert found["level_error_db"] == pytest.approx(0, abs=1e-9) == found["nine_band_db"], name


@pytest.fixture(scope="module")
def prepared(tmp_path_factory):
    """Ten virtual surfaces, some kept apart, in segments of the tiny networks' length."""
    folder = tmp_path_factory.mktemp("robustness")
    generate_recordings(folder / "r.h5", surfaces=10, seconds=8, explorers=1, seed=2, quiet=True)
    settings = {"limits": SegmentLimits(seconds=2048 / 2500), "hold_out": HoldOut(surfaces=("0000-*", "0001-*"))}
    prepare_recordings(folder / "r.h5", folder / "p.h5", validation=2, test=4, quiet=True, **settings)
    return folder / "p.h5"


def test_stretches_are_the_recording_itself(prepared):
    dataset = PreparedDataset(prepared, "test")
    stretches, surfaces = robustness.long_stretches(dataset, 2.0, 3)
    assert stretches.shape == (3, 20_000) and len(set(surfaces)) == 3
    for stretch, surface in zip(stretches, surfaces, strict=True):
        own = dataset.textures(np.flatnonzero(dataset.surface_ids == surface))
        starts = [np.flatnonzero(stretch[: len(stretch) - len(row)] == row[0]) for row in own]
        pairs = zip(own, starts, strict=True)
        whole = [any(np.array_equal(row, stretch[i : i + len(row)]) for i in found) for row, found in pairs]
        assert sum(whole) >= 2  # segments overlap by half: 2 s hold the whole of several, sample by sample


def test_study_on_a_tiny_pipeline(evaluable_pipe, prepared, tmp_path, monkeypatch):
    for name, value in {"COUNT": 1, "STEPS": (1, 2), "LONG_SECONDS": 3.0}.items():
        monkeypatch.setattr(robustness, name, value)
    context = make_context(evaluable_pipe(False), prepared, "test", replace(QUICK, per_surface=1), 0, tmp_path)
    found = robustness.study(context)
    json.dumps(found, allow_nan=False)
    assert all(entry["finite"]["mean"] == 1 for by_steps in found["inputs"].values() for entry in by_steps.values())
    faint, loud = (found["inputs"][name]["2"]["level_db"]["mean"] for name in ("faint", "loud"))
    assert faint == pytest.approx(-120, abs=0.01) and loud == pytest.approx(20, abs=0.01)  # the level is imposed
    # bfloat16 has 8 bits: the same noise gives the same texture to a few per cent, another noise another one
    assert 0 < found["bfloat16"]["rms_difference"]["mean"] < 0.1
    long = found["any_length"]
    assert 0 < long["windows"]["rms_difference"]["mean"] < long["other_noise"]["rms_difference"]["mean"]
    apart = found["hard_split"]
    assert apart["nine_band_db"]["n"] == len(PreparedDataset(prepared, "hard").non_overlapping(1, 0))
    ratio = apart["nine_band_db"]["mean"] / apart["ordinary_nine_band_db"]["mean"]
    assert apart["times"]["mean"] == pytest.approx(ratio)
    text = robustness.markdown(found)
    assert "nan" not in text.lower() and "keep apart" in text
    assert len({line.count("|") for line in text.splitlines() if line.startswith("|")}) == 1

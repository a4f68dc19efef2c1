"""Section "robustness": hard inputs, their figures, stretches of recording, and the section on a tiny pipeline."""

import json
from dataclasses import replace

import numpy as np
import pytest

from tactile_diffusers.data import HoldOut, PreparedDataset, SegmentLimits, prepare_recordings
from tactile_diffusers.evaluation.sampling import reconstruct
from tactile_diffusers.evaluation.sections import QUICK, Context, robustness
from tactile_diffusers.evaluation.sections.robustness import (
    differences,
    hard_inputs,
    hard_metrics,
    long_stretches,
    run,
)
from tactile_diffusers.evaluation.telling import robustness_markdown
from tactile_diffusers.signal import BAND_HZ, DEVICE_RATE, band_edges, band_levels_db, nine_band_error_db, rms
from tactile_diffusers.virtual import generate_recordings

EDGES = band_edges()


@pytest.fixture
def inputs(noise_textures):
    return hard_inputs(noise_textures(3, seed=0), DEVICE_RATE, BAND_HZ, np.random.default_rng(0))


def _means(made, textures):
    return {name: leaf["mean"] for name, leaf in hard_metrics(made, textures, DEVICE_RATE, EDGES).items()}


def test_hard_inputs_are_what_they_say(inputs):
    assert all(textures.shape == (3, 16_384) and np.isfinite(textures).all() for textures in inputs.values())
    assert not inputs["silence"].any() and np.ptp(inputs["constant"]) == 0
    assert (np.count_nonzero(inputs["click"], axis=-1) == 1).all()
    np.testing.assert_allclose(rms(inputs["faint"]), 1e-6)
    np.testing.assert_allclose(rms(inputs["loud"]), 10)
    unit = inputs["loud"] / 10
    np.testing.assert_allclose(inputs["clipped"] / inputs["clipped"].max(-1, keepdims=True), np.clip(unit, -1, 1))
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
    assert _means(inputs["silence"], inputs["silence"])["out_of_band_db"] is None
    assert _means(inputs["constant"], inputs["constant"])["level_db"] == pytest.approx(20 * np.log10(0.5))


def test_gain_is_read_as_level_error(inputs):
    found = _means(2 * inputs["faint"], inputs["faint"])
    assert found["level_error_db"] == pytest.approx(20 * np.log10(2)) == found["nine_band_db"]
    # what lies above the band is no level inside it
    assert _means(inputs["band_noise"], inputs["white_noise"])["level_error_db"] == pytest.approx(6.9, abs=0.5)


def test_only_bands_with_power_count(inputs):
    tone = inputs["low_tone"]
    noisy = tone + 1e-5 * np.random.default_rng(1).standard_normal(tone.shape)  # 60 dB below, in bands that were empty
    assert _means(noisy, tone)["nine_band_db"] < 0.05


def test_outputs_that_are_not_finite_are_counted(inputs):
    broken = inputs["loud"].copy()
    broken[0, 5] = np.nan
    found = hard_metrics(broken, inputs["loud"], DEVICE_RATE, EDGES)
    assert found["finite"]["mean"] == pytest.approx(2 / 3) and found["level_error_db"]["n"] == 2
    found = hard_metrics(np.full_like(broken, np.inf), inputs["loud"], DEVICE_RATE, EDGES)
    assert found["finite"]["mean"] == 0 and found["level_error_db"]["mean"] is None
    json.dumps(found, allow_nan=False)


def test_differences(noise_textures):
    textures = noise_textures(4, seed=0)
    found = differences(1.1 * textures, textures, DEVICE_RATE, EDGES, np.arange(4))
    assert found["rms_difference"]["mean"] == pytest.approx(0.1)
    assert found["nine_band_db"]["mean"] == pytest.approx(20 * np.log10(1.1))


@pytest.fixture(scope="module")
def prepared(tmp_path_factory):
    """Ten virtual surfaces, five of them for testing, in segments of the tiny networks' length."""
    folder = tmp_path_factory.mktemp("robustness")
    generate_recordings(folder / "r.h5", surfaces=10, seconds=8, explorers=1, seed=2, quiet=True)
    limits = SegmentLimits(seconds=2048 / 2500)
    prepare_recordings(folder / "r.h5", folder / "p.h5", limits=limits, validation=2, test=5, quiet=True)
    apart = HoldOut(surfaces=("0000-*", "0001-*"))
    prepare_recordings(
        folder / "r.h5", folder / "apart.h5", limits=limits, validation=2, test=4, hold_out=apart, quiet=True
    )
    return folder / "p.h5"


def test_stretches_are_the_recording_itself(prepared):
    dataset = PreparedDataset(prepared, "test")
    stretches, surfaces = long_stretches(dataset, 2.0, 3)
    assert stretches.shape == (3, 20_000) and len(set(surfaces)) == 3
    for stretch, surface in zip(stretches, surfaces, strict=True):
        own = dataset.textures(np.flatnonzero(dataset.surface_ids == surface))
        inside = [
            row for row in own if any(np.array_equal(row[:64], stretch[i : i + 64]) for i in _places(row, stretch))
        ]
        # segments overlap by half: 2 s hold the whole of several, each found again sample by sample
        whole = [
            row for row in inside if any(np.array_equal(row, stretch[i : i + len(row)]) for i in _places(row, stretch))
        ]
        assert len(whole) >= 2
    longer, _ = long_stretches(dataset, 1000.0, 1)
    assert longer.shape[-1] >= stretches.shape[-1]


def _places(row, stretch):
    return np.flatnonzero(stretch[: len(stretch) - 64] == row[0])


def test_section(evaluable_pipe, prepared, tmp_path, monkeypatch):
    monkeypatch.setattr(robustness, "COUNT", 1)
    monkeypatch.setattr(robustness, "STEPS", (1, 2))
    monkeypatch.setattr(robustness, "LONG_SECONDS", 3.0)
    settings = replace(QUICK, per_surface=1, long_textures=2)
    contexts = [Context(evaluable_pipe(False), prepared, "test", settings, 0, tmp_path) for _ in range(2)]
    first, again = (run(context)["robustness"] for context in contexts)
    assert json.dumps(first, allow_nan=False) == json.dumps(again, allow_nan=False)
    for name, by_steps in first["inputs"].items():
        assert list(by_steps) == ["1", "2"]
        assert all(entry["finite"]["mean"] == 1 for entry in by_steps.values()), name
    faint, loud = (first["inputs"][name]["2"]["level_db"]["mean"] for name in ("faint", "loud"))
    assert faint == pytest.approx(-120, abs=0.01) and loud == pytest.approx(20, abs=0.01)  # the level is imposed
    # bfloat16 has 8 bits: the same noise gives the same texture to a few per cent, another noise another one
    assert 0 < first["bfloat16"]["rms_difference"]["mean"] < 0.1
    long = first["any_length"]
    assert 0 < long["windows"]["rms_difference"]["mean"] < long["other_noise"]["rms_difference"]["mean"]
    written = robustness_markdown(first, 3)
    assert written.startswith("### Hard inputs") and "nan" not in written.lower()
    assert len({line.count("|") for line in written.splitlines() if line.startswith("|")}) == 1
    assert first["hard_split"] is None and "keep apart" not in written


def test_surfaces_kept_apart(evaluable_pipe, prepared, tmp_path):
    data = prepared.with_name("apart.h5")
    settings = replace(QUICK, per_surface=1)
    context = Context(evaluable_pipe(False), data, "test", settings, 0, tmp_path)
    found = robustness._hard_split(context)
    hard = PreparedDataset(data, "hard")
    assert found["nine_band_db"]["n"] == len(hard.non_overlapping(1, 0)) == found["times"]["n"] > 0
    assert found["ordinary_nine_band_db"]["n"] == len(context.real)
    # the ordinary ones are reconstructed as in the section of that name
    made = reconstruct(context.pipe, context.real, context.rate, context.steps, context.seed)
    error = nine_band_error_db(made, context.real, context.rate, context.edges).mean()
    assert found["ordinary_nine_band_db"]["mean"] == pytest.approx(error)
    ratio = found["nine_band_db"]["mean"] / found["ordinary_nine_band_db"]["mean"]
    assert found["times"]["mean"] == pytest.approx(ratio)
    # judged on what is kept apart, there is nothing else to compare with
    assert robustness._hard_split(Context(evaluable_pipe(False), data, "hard", settings, 0, tmp_path)) is None

"""`examples/research/latents.py`: figures of latents whose answer is known, and the study on a tiny pipeline."""

import json
from dataclasses import replace

import latents
import numpy as np
import pytest
from latents import layer_statistics, monotony, time_shift
from report.sections import QUICK, make_context

from tactile_diffusers import TactileTexturePipeline, VDDIMScheduler
from tactile_diffusers.data import SegmentLimits, prepare_recordings
from tactile_diffusers.virtual import generate_recordings

SURFACES = np.repeat(np.arange(20), 2)


def _noise(channels=8, frames=256, seed=0):
    return np.random.default_rng(seed).standard_normal((len(SURFACES), channels, frames))


def _means(entry):
    return {name: leaf["mean"] for name, leaf in entry.items()}


def test_white_gaussian_latents():
    found = _means(layer_statistics(0.3 * _noise() + 0.1, SURFACES))
    # 10,240 numbers a channel, 8 channels: standard errors of moments are below 0.02
    assert found["channel_mean"] == pytest.approx(0.1, abs=0.01)
    assert found["channel_std"] == pytest.approx(0.3, rel=0.01)
    assert found["skew"] == pytest.approx(0, abs=0.04) and found["excess_kurtosis"] == pytest.approx(0, abs=0.08)
    assert found["neighbour_correlation"] == pytest.approx(0, abs=0.02)
    assert found["slow_share"] == pytest.approx(0.5, abs=0.02)
    assert found["effective_dimension"] == pytest.approx(8, rel=0.01)


def test_uniform_latents_are_flat_and_near_their_bound():
    uniform = np.random.default_rng(0).uniform(-1, 1, (len(SURFACES), 4, 256))
    found = _means(layer_statistics(uniform, SURFACES))
    assert found["excess_kurtosis"] == pytest.approx(-1.2, abs=0.03)
    assert found["near_bound_share"] == pytest.approx(0.05, abs=0.005)
    assert 0.99 < found["largest"] <= 1
    free = layer_statistics(uniform, SURFACES, bounded=False)
    assert free["near_bound_share"]["mean"] is None and free["largest"]["mean"] == found["largest"]


def _framed(textures, hop=16):
    """An encoder whose latent frame is the mean of a hop: it follows every delay."""
    whole = textures[:, : textures.shape[-1] // hop * hop]
    return whole.reshape(len(textures), 1, -1, hop).mean(-1)


def _placed(textures, hop=16):
    """The same, but each frame is also marked by its place: it does not follow delays."""
    return _framed(textures, hop) + np.arange(textures.shape[-1] // hop) % 2


def test_time_shift_of_an_encoder_that_follows_delays_and_of_one_that_does_not():
    slow = np.cumsum(_noise(1, 2048)[:, 0], axis=-1)  # changes little within a frame
    layers = {"base": slice(0, 1)}
    found = _means(time_shift(_framed, slow, 1000, 0.016, layers, SURFACES)["base"])
    assert found["delay_1_frames"] == pytest.approx(0, abs=1e-9) == found["delay_4_frames"]
    assert 0 < found["half_frame"] < 0.6 * found["neighbour_frames"]
    placed = _means(time_shift(_placed, np.sign(slow), 1000, 0.016, layers, SURFACES)["base"])
    assert placed["delay_1_frames"] > 0.5


def test_monotony():
    straight = np.linspace(-60, -50, 9)
    back = straight.copy()
    back[4] = back[3] - 1.0  # 1 dB back, on the way up
    alike = np.full(9, -55.0)
    alike[4] = -40.0  # ends alike: not counted
    curves = np.stack([np.stack([straight, back, alike], -1), np.stack([-straight, -back, alike], -1)])
    found = monotony(curves)
    assert found["monotone_share"]["mean"] == 0.5 and found["monotone_share"]["n"] == 4
    assert found["reversal_db"]["max"] == pytest.approx(1.0) and found["reversal_db"]["min"] == pytest.approx(0)
    assert found["departure_db"]["max"] == pytest.approx(2.25)  # one step of 1.25 dB and 1 dB back
    assert monotony(curves[..., 2:])["monotone_share"]["mean"] is None


@pytest.fixture(scope="module")
def prepared(tmp_path_factory):
    """Ten virtual surfaces, five of them for testing, in segments of the tiny networks' length."""
    folder = tmp_path_factory.mktemp("latents")
    generate_recordings(folder / "r.h5", surfaces=10, seconds=8, explorers=1, seed=2, quiet=True)
    limits = SegmentLimits(seconds=2048 / 2500)
    prepare_recordings(folder / "r.h5", folder / "p.h5", limits=limits, validation=2, test=5, quiet=True)
    return folder / "p.h5"


def test_study_on_a_tiny_pipeline(evaluable_pipe, prepared, tmp_path, monkeypatch):
    monkeypatch.setattr(latents, "PAIRS", 2)
    context = make_context(evaluable_pipe(False), prepared, "test", replace(QUICK, per_surface=1), 0, tmp_path)
    found = latents.study(context)
    json.dumps(found, allow_nan=False)
    assert set(found["layers"]) == set(found["time_shift"]) == {"base"}
    assert (tmp_path / "latents.png").stat().st_size > 5000
    # a random network is shift-equivariant too: only the RMS of the two crops differs
    assert found["time_shift"]["base"]["delay_4_frames"]["mean"] < 0.2
    assert "nan" not in latents.markdown(found).lower()


def test_each_layer_of_a_model_is_reported(make_lctg, make_extractor, prepared, tmp_path, monkeypatch):
    """Only what is learned has a bound: elsewhere the share near it is an empty cell."""
    monkeypatch.setattr(latents, "PAIRS", 1)
    pipe = TactileTexturePipeline(
        lctg=make_lctg(feature_channels=28, latent_channels=6, level_bands=1, detail_channels=2, segment_samples=2048),
        feature_extractor=make_extractor(feature_size=28, level_bands=1, detail_samples=2),
        scheduler=VDDIMScheduler(),
    )
    pipe.set_progress_bar_config(disable=True)
    context = make_context(pipe, prepared, "test", replace(QUICK, per_surface=1), 0, tmp_path)
    section = latents.study(context)
    assert list(section["layers"]) == ["levels", "base", "detail"]
    known = {name: entry["near_bound_share"]["mean"] is not None for name, entry in section["layers"].items()}
    assert known == {"levels": False, "base": True, "detail": False}

"""Studies of a checkpoint: each figure against a case whose answer is known."""

import numpy as np
import pytest

from tactile_diffusers.data import PreparedDataset, generate_recordings, prepare_recordings
from tactile_diffusers.evaluation.study import (
    largest_correlation,
    long_texture_study,
    other_segments,
    overlap_mask,
    rating_sweep,
    reconstruction_study,
)
from tactile_diffusers.evaluation.tables import markdown_table


@pytest.fixture(scope="module")
def prepared(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    generate_recordings(folder / "r.h5", surfaces=8, seconds=15, explorers=2, seed=2, quiet=True)
    prepare_recordings(folder / "r.h5", folder / "p.h5", validation=1, test=4, quiet=True)
    return folder / "p.h5"


class PerfectPipeline:
    """Returns what it is given: the study must find no error in it."""

    def reconstruct(self, rows, sampling_rate, steps, generator=None):
        return type("Out", (), {"textures": rows, "sampling_rate": sampling_rate})


def test_perfect_reconstruction_has_no_error_and_baselines_do(prepared):
    held_out, reference = PreparedDataset(prepared, "test"), PreparedDataset(prepared, "train")
    table = reconstruction_study(PerfectPipeline(), held_out, reference, steps=(3,), per_surface=3)
    perfect, silence = table["LCTG, 3 steps"], table["silence"]
    assert perfect["nine_band_db"] == 0 and perfect["signed_20_60_db"] == 0
    assert silence["snr_db"] == pytest.approx(0, abs=1e-6)
    assert perfect["ktd"] == pytest.approx(table["real (held out)"]["ktd"], abs=1e-6)
    other, different = table["another take of the surface"], table["a different surface"]
    # takes of one surface differ by their randomness only; surfaces by several dB (FIELD: 1.4 and 6.7 dB)
    assert 0.5 < other["nine_band_db"] < different["nine_band_db"]


def test_other_segments_share_a_surface_but_no_sample(prepared):
    dataset = PreparedDataset(prepared, "test")
    chosen = dataset.non_overlapping(3)
    for first, second in zip(chosen, other_segments(dataset, chosen, True), strict=True):
        if second >= 0:
            assert dataset.surface_ids[first] == dataset.surface_ids[second]
            assert not dataset.overlap(first, second)
    different = other_segments(dataset, chosen, False)
    assert (dataset.surface_ids[chosen] != dataset.surface_ids[different]).all()


def test_sweep_reports_what_moves(pipe):
    """A pipeline whose level follows roughness must give rank correlation 1, one that ignores it must not."""

    class Obedient:
        def __call__(self, ratings, num_textures_per_rating, generator, **_):
            rng = np.random.default_rng(0)
            value = next(iter(ratings.values()))
            textures = rng.standard_normal((num_textures_per_rating, 4000)) * np.exp(value)
            count = np.ones(num_textures_per_rating)
            level = count * value
            friction = count * np.exp(-value)
            fields = dict(textures=textures, sampling_rate=10000, level=level, friction_coefficient=friction)
            return type("Out", (), fields)

    sweep = rating_sweep(Obedient(), "roughness", takes=3)
    assert sweep["spearman"]["level_db"] == pytest.approx(1)
    assert sweep["spearman"]["log_friction"] == pytest.approx(-1)
    assert sweep["shape_db"] == pytest.approx(0, abs=1e-6)  # the same noise, only louder
    real = rating_sweep(pipe, "roughness", values=(-2.0, 0.0, 2.0), takes=2, steps=2)
    assert real["spectrum_db"].shape[0] == 3 and np.isfinite(real["spectrum_db"]).all()


def test_repetition_is_found():
    rng = np.random.default_rng(0)
    fresh = rng.standard_normal(60_000)
    repeated = fresh.copy()
    repeated[40_000:50_000] = fresh[10_000:20_000]
    # white noise over 10,000 samples: correlations are about 1/100, the largest of 50,000 below 0.06
    assert largest_correlation(fresh, 10_000) < 0.06
    assert largest_correlation(repeated, 10_000) == pytest.approx(1, abs=1e-9)


def test_long_texture_study_runs_and_the_mask_covers_the_overlaps(pipe):
    found = long_texture_study(pipe, [[0.0, 0.0, 0.0]], duration_s=3.0)
    assert len(found["overlap_bands_db"]) == 7 and np.isfinite(found["overlap_rms_db"])
    mask = overlap_mask(pipe, 30_000, 10_000)
    assert mask.any() and not mask.all() and not mask[:100].any()


def test_table_has_every_column_and_a_dash_for_what_is_missing():
    text = markdown_table({"a": {"x": 1.0}, "b": {"x": float("nan"), "y": 2}})
    assert text.splitlines() == ["| | x | y |", "|---|---|---|", "| a | 1.00 | – |", "| b | – | 2 |"]

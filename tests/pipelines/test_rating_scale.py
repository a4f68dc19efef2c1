"""Ratings given as z-scores, on the typical rater's scale or in percentiles: the same textures, the same refusals."""

import numpy as np
import pytest

from tactile_diffusers import DALEModel, bundled_checkpoint
from tactile_diffusers.pipelines.inputs import parse_ratings

STATISTICS = {
    "mean": [4.0, 3.0, 5.0],
    "std": [2.0, 1.5, 1.0],
    "quantiles": [[-2.0, -1.0, 0.0, 1.5, 2.0], [-1.0, -0.5, -0.5, 0.0, 3.0], [-1.6, -0.8, 0.0, 0.8, 1.6]],
}
Z = [1.5, -0.5, 0.8]
SAME = {"raw": [7.0, 2.25, 5.8], "percentile": [75.0, 50.0, 75.0]}


@pytest.fixture
def pipe(make_pipeline):
    return make_pipeline(dale_config={"rating_statistics": STATISTICS})


@pytest.fixture
def run(pipe, seeded):
    return lambda ratings, **options: pipe(ratings, num_inference_steps=2, generator=seeded(0), **options)


@pytest.mark.parametrize("scale", ["raw", "percentile"])
def test_scales_are_ways_to_say_the_same(run, scale):
    expected = run(Z)
    assert np.array_equal(run(Z, rating_scale="z").textures, expected.textures)
    made = run(SAME[scale], rating_scale=scale)
    # z-scores agree to float32 rounding; two steps of the networks enlarge it little
    np.testing.assert_allclose(made.textures, expected.textures, atol=1e-4 * np.abs(expected.textures).max())
    assert not np.allclose(run([0.0, 0.0, 0.0]).textures, expected.textures, rtol=0.1)


def test_numbers_of_each_scale(pipe):
    def z(values, scale):
        return parse_ratings(values, pipe.dale.config, scale).tolist()

    assert z([[0, 0, 0], [8, 8, 8]], "raw") == [[-2.0, -2.0, -5.0], [2.0, pytest.approx(10 / 3), 3.0]]
    assert z([[0, 0, 0], [100, 100, 100]], "percentile") == [pytest.approx([-2, -1, -1.6]), pytest.approx([2, 3, 1.6])]
    assert z([[10, 87.5, 50]], "percentile") == [pytest.approx([-1.6, 1.5, 0.0], abs=1e-6)]


@pytest.mark.parametrize(
    ("scale", "ratings", "message"),
    [
        ("z", [0, 6.5, 0], "z-scores between -6 and 6 .* got bumpiness = 6.5 in row 0"),
        ("raw", [[4, 4, 4], [4, 4, 8.01]], "answers between 0 and 8 .* got slipperiness = 8.01 in row 1"),
        ("raw", {"roughness": -0.5}, "between 0 and 8 .* got roughness = -0.5 in row 0"),
        ("raw", [float("inf"), 4, 4], "got roughness = inf in row 0"),
        ("percentile", [50, 100.5, 50], "percentiles between 0 and 100 .* got bumpiness = 100.5 in row 0"),
        ("percentile", [-1, 50, 50], "got roughness = -1.0 in row 0"),
        ("percentile", [50, "high", 50], "`ratings` must be numbers"),
        ("percent", [50, 50, 50], r"`rating_scale` must be one of \['z', 'raw', 'percentile'\], got 'percent'"),
        (None, Z, "`rating_scale` must be one of .* got None"),
        (["z"], Z, "`rating_scale` must be one of"),
    ],
)
def test_what_is_not_on_the_scale_is_refused_before_any_work(run, pipe, calls_of, scale, ratings, message):
    calls = calls_of(pipe.dale)
    with pytest.raises(ValueError, match=message):
        run(ratings, rating_scale=scale)
    assert not calls


@pytest.mark.parametrize(("scale", "missing"), [("raw", ["mean"]), ("raw", ["std"]), ("percentile", ["quantiles"])])
def test_a_checkpoint_without_the_statistics_says_so(make_pipeline, scale, missing):
    pipe = make_pipeline(dale_config={"rating_statistics": {n: v for n, v in STATISTICS.items() if n not in missing}})
    with pytest.raises(ValueError, match=rf"`rating_scale=\"{scale}\"` needs \['{missing[0]}'\] .*train_dale.py"):
        pipe(SAME[scale], rating_scale=scale)
    # statistics of unrated data were once stored as NaN: they must not pass for "not specified"
    unknown = STATISTICS | {"mean": [float("nan")] * 3, "quantiles": None}
    pipe = make_pipeline(dale_config={"rating_statistics": unknown})
    with pytest.raises(ValueError, match="which the checkpoint lacks"):
        pipe(SAME[scale], rating_scale=scale)


def test_the_bundled_checkpoint_knows_all_scales():
    statistics = DALEModel.load_config(bundled_checkpoint(), subfolder="dale")["rating_statistics"]
    table = np.array(statistics["quantiles"])
    assert table.shape == (3, 21) and (np.diff(table) >= 0).all()
    np.testing.assert_array_equal(table[:, [0, -1]], statistics["range"])


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        ({"quantiles": [[0.0, 1.0], [0.0, 1.0], [1.0, 0.0]]}, "`quantiles` must hold rows of ascending numbers"),
        ({"quantiles": [[0.0, 1.0], [0.0, 1.0], [0.0, float("nan")]]}, "`quantiles` must hold rows of ascending"),
        ({"quantiles": [[0.0, 1.0], [0.0, 1.0], [0.0, 1.0, 2.0]]}, "`quantiles` must hold rows of ascending numbers"),
        ({"quantiles": [[0.0]] * 3}, "`quantiles` must hold rows of ascending numbers"),
        ({"quantiles": [[0.0, 1.0]] * 2}, "`quantiles` must hold one entry for each of 3 axes"),
        ({"quantiles": []}, "`quantiles` must hold one entry for each of 3 axes"),
        ({"mean": [4.0, 4.0]}, "`mean` must hold one entry for each of 3 axes"),
        ({"median": [4.0] * 3}, "`rating_statistics` has unknown entries .'median'."),
    ],
    ids=str,
)
def test_statistics_that_do_not_fit_are_refused_when_the_model_is_built(make_dale, entries, message):
    with pytest.raises(ValueError, match=message):
        make_dale(rating_statistics=entries)

"""The truth of a request: against closed forms, against exploring everything, and on tiny virtual data."""

import h5py
import numpy as np
import pytest
from report import virtual_truth as virtual
from report.fresh import FIRST_FRESH, fresh_ratings, fresh_textures
from report.virtual_truth import draw_surfaces, fresh_training, truth_of, virtual_truth
from scipy import stats

from tactile_diffusers.data import HoldOut, PreparedDataset, SegmentLimits, prepare_recordings
from tactile_diffusers.evaluation import truth
from tactile_diffusers.evaluation.truth import KERNEL_WIDTH, RatedTextures, recorded_truth
from tactile_diffusers.signal import level
from tactile_diffusers.virtual import Collection, VirtualSurface, generate_recordings

FREE = np.nan
POPULATION = [FREE, FREE, FREE]
COLLECTION = Collection(8.0, seed=4, agreement=2.0)
REQUESTS = [POPULATION, *([value, FREE, FREE] for value in (-1.0, 0.0, 1.0)), [FREE, 0.5, -0.5]]
SPREAD = np.array([0.8, 0.7, 0.7])


def planted(ratings, rng, noise=0.5, per_surface=2):
    """Measures of two textures per surface: a straight line and a parabola in the ratings, plus noise."""
    surface_ids = np.repeat(np.arange(len(ratings)), per_surface)
    x = ratings[surface_ids]
    line = 2 * x[:, 0] - x[:, 1] + noise * rng.standard_normal(len(x))
    return surface_ids, {"line": line, "both": np.stack([line, x[:, 0] ** 2], axis=1)}


@pytest.fixture(scope="module")
def gaussian():
    """A Gaussian population of 20,000 rated surfaces, of which 1500 draws are explored."""
    rng = np.random.default_rng(0)
    candidates = SPREAD * rng.standard_normal((20_000, 3))
    drawn, importance = draw_surfaces(candidates, REQUESTS, 1500, seed=1)
    surface_ids, measures = planted(candidates[drawn], rng)
    return RatedTextures(measures, surface_ids, candidates[drawn], importance)


@pytest.mark.parametrize("request_", REQUESTS)
def test_truth_is_the_closed_form(gaussian, request_):
    # a Gaussian population times a Gaussian kernel is Gaussian again: per axis its mean and variance are
    specified = ~np.isnan(request_)
    mean = np.where(specified, np.nan_to_num(request_) * SPREAD**2 / (SPREAD**2 + KERNEL_WIDTH**2), 0.0)
    variance = np.where(specified, SPREAD**2 * KERNEL_WIDTH**2 / (SPREAD**2 + KERNEL_WIDTH**2), SPREAD**2)
    expected = np.array([2 * mean[0] - mean[1], mean[0] ** 2 + variance[0]])
    low, high = gaussian.interval("both", request_)
    error = (high - low) / 2 / 1.96
    assert (np.abs(gaussian.mean("both", request_) - expected) < 4 * error).all()
    assert (error < 0.2).all()  # or the line above would show nothing
    np.testing.assert_allclose(gaussian.mean("line", request_), gaussian.mean("both", request_)[0])
    # about 200 surfaces count: standard errors of a mean rating are below 0.06
    np.testing.assert_allclose(gaussian.mean_rating(request_), mean, atol=0.2)


@pytest.mark.parametrize("surface_ids", [[0, 1, 2], [0, 0, 0, 0, 1, 2, 2]])
def test_effective_size_counts_surfaces_not_textures(surface_ids):
    textures = RatedTextures({}, surface_ids, np.zeros((3, 3)), np.array([1.0, 1.0, 2.0]))
    assert textures.effective_size(POPULATION) == pytest.approx(4**2 / (1 + 1 + 4))


@pytest.mark.parametrize("rows", [1, 5])
def test_parts_that_do_not_fit_together_are_refused(rows):
    with pytest.raises(ValueError, match=f"`ratings` must have a row .* got {rows}"):
        RatedTextures({}, [0, 1], np.zeros((rows, 3)), np.ones(2))
    with pytest.raises(ValueError, match="`measures` must have one entry per texture, 4, got {'x': 3}"):
        RatedTextures({"x": np.zeros(3)}, [0, 0, 1, 1], np.zeros((2, 3)), np.ones(2))


def test_interval_equals_leaving_out_each_surface_by_hand():
    rng = np.random.default_rng(5)
    ratings, importance = SPREAD * rng.standard_normal((12, 3)), rng.uniform(1, 3, 12)
    surface_ids = np.concatenate([np.arange(12), rng.integers(0, 12, 20)])
    values = rng.standard_normal(32)
    request = [0.0, FREE, FREE]
    textures = RatedTextures({"x": values}, surface_ids, ratings, importance)
    weights = textures.weights(request)
    left_out = np.array([np.average(values, weights=weights * (surface_ids != number)) for number in range(12)])
    error = np.sqrt(11 / 12 * np.sum((left_out - left_out.mean()) ** 2))
    low, high = textures.interval("x", request)
    assert (low + high) / 2 == pytest.approx(textures.mean("x", request))
    expected = stats.t.ppf(0.975, textures.effective_size(request) - 1) * error
    assert (high - low) / 2 == pytest.approx(expected)


@pytest.mark.parametrize("axis", [0, 2])
@pytest.mark.parametrize("value", [-1.5, 0.4])
def test_drawn_ratings_are_distributed_as_those_that_count(gaussian, axis, value):
    request = [FREE] * 3
    request[axis] = value
    drawn = gaussian.draw_ratings(request, 500)
    assert drawn.shape == (500, 3) and np.isnan(np.delete(drawn, axis, axis=1)).all()
    drawn = drawn[:, axis]
    assert (np.diff(drawn) >= 0).all() and np.isin(drawn, gaussian.ratings[:, axis]).all()
    # at every rating the shares of both distributions differ by a draw's half, and by what one surface weighs
    weights = gaussian.surface_weights(request)
    shares = [weights[gaussian.ratings[:, axis] <= edge].sum() for edge in drawn]
    np.testing.assert_allclose(shares, (np.arange(500) + 0.5) / 500, atol=weights.max() + 1e-9)
    assert drawn.mean() == pytest.approx(gaussian.mean_rating(request)[axis], abs=0.01)
    spread = np.sqrt(weights @ np.square(gaussian.ratings[:, axis] - gaussian.mean_rating(request)[axis]))
    assert drawn.std() == pytest.approx(spread, rel=0.05)


@pytest.fixture(scope="module")
def prepared(tmp_path_factory):
    folder = tmp_path_factory.mktemp("truth")
    generate_recordings(folder / "r.h5", surfaces=6, seconds=8, explorers=2, seed=4, agreement=2.0, quiet=True)
    prepare_recordings(folder / "r.h5", folder / "p.h5", validation=1, test=1, quiet=True)
    return folder / "p.h5"


def describe(textures, levels, friction_coefficients):
    """Keeps the samples too: these are few."""
    assert textures.dtype == np.float32 and len(textures) == len(levels) == len(friction_coefficients)
    return {"textures": textures, "levels": levels, "friction": friction_coefficients}


def test_virtual_truth_explores_what_it_drew(prepared, monkeypatch):
    monkeypatch.setattr(virtual, "CHUNK", 6)  # three surfaces at a time
    data = PreparedDataset(prepared, "test")
    rated = virtual_truth(data, REQUESTS, describe, surfaces=8, candidates=40, seconds=8.0, seed=2)
    training = np.unique(PreparedDataset(prepared, "train", "full").surface_ids)
    ratings = fresh_ratings(40, COLLECTION, training=training)
    drawn, importance = draw_surfaces(ratings, REQUESTS, 8, seed=2)
    np.testing.assert_array_equal(rated.ratings, ratings[drawn])
    np.testing.assert_array_equal(rated.importance, importance)
    assert rated.dropped == 0 and rated.measures["textures"].shape[1] == data.segment_samples
    np.testing.assert_allclose(level(rated.measures["textures"]), rated.measures["levels"], atol=1e-4)  # float32
    for number in (0, len(drawn) - 1):
        textures, friction, *_ = fresh_textures(FIRST_FRESH + drawn[number], COLLECTION, seconds=8.0)
        np.testing.assert_array_equal(rated.measures["textures"][rated.surface_ids == number], textures)
        np.testing.assert_array_equal(rated.measures["friction"][rated.surface_ids == number], friction)
    again = virtual_truth(data, REQUESTS, describe, surfaces=8, candidates=40, seconds=8.0, seed=2, workers=2)
    np.testing.assert_array_equal(again.measures["textures"], rated.measures["textures"])
    assert np.isfinite(rated.mean("levels", POPULATION))


def test_fresh_training_surfaces_lie_beyond_those_of_the_truth(prepared):
    training = fresh_training(PreparedDataset(prepared, "all"), 3, after=40, seconds=8.0)
    units = np.unique(PreparedDataset(prepared, "train", "full").surface_ids)
    ratings = fresh_ratings(43, COLLECTION, training=units)[40:]
    np.testing.assert_array_equal(training.ratings, ratings[training.surface_ids])
    for number in range(3):
        textures, friction, *_ = fresh_textures(FIRST_FRESH + 40 + number, COLLECTION, seconds=8.0)
        np.testing.assert_array_equal(training.textures[training.surface_ids == number], textures)
        np.testing.assert_array_equal(training.friction_coefficients[training.surface_ids == number], friction)


def test_what_is_held_out_takes_no_part(tmp_path, monkeypatch):
    generate_recordings(tmp_path / "r.h5", surfaces=9, seconds=4, explorers=3, seed=4, quiet=True)
    names = PreparedDataset(_without_limits(tmp_path / "r.h5", tmp_path / "whole.h5"), "all").surfaces
    material = names[0].split("-")[1]
    hold_out = HoldOut(surfaces=(f"*-{material}",), explorers=("explorer-1",), raters=("rater-0", "rater-5"))
    prepared = _without_limits(tmp_path / "r.h5", tmp_path / "p.h5", hold_out=hold_out)
    explored, asked = [], {}

    def explore(number, **settings):
        explored.append((number, settings["explorers"]))
        return fresh_textures(number, **settings)

    def rate(*args, **settings):
        asked.update(settings)
        return fresh_ratings(*args, **settings)

    monkeypatch.setattr(virtual, "fresh_textures", explore)
    monkeypatch.setattr(virtual, "fresh_ratings", rate)
    virtual_truth(PreparedDataset(prepared, "all"), REQUESTS, describe, surfaces=20, candidates=60, seconds=4.0)
    classes = [VirtualSurface(4, FIRST_FRESH + number).parameters.material for number in range(60)]
    assert material in classes
    assert all(VirtualSurface(4, number).parameters.material != material for number, _ in explored)
    assert {tuple(explorers) for _, explorers in explored} == {(0, 2)}
    assert list(asked["raters"]) == [n for n in range(12) if n not in (0, 5)]
    # and in the hard split nothing else does
    explored.clear()
    virtual_truth(PreparedDataset(prepared, "hard"), REQUESTS, describe, surfaces=20, candidates=60, seconds=4.0)
    assert {VirtualSurface(4, number).parameters.material for number, _ in explored} == {material}
    assert {tuple(explorers) for _, explorers in explored} == {(1,)} and list(asked["raters"]) == [0, 5]


def _without_limits(recordings, prepared, **options):
    limits = SegmentLimits().without_conditions()
    prepare_recordings(recordings, prepared, limits, validation=1, test=1, quiet=True, **options)
    return prepared


def test_recorded_truth_takes_all_surfaces_as_they_are(prepared, monkeypatch):
    monkeypatch.setattr(truth, "CHUNK", 5)
    data = PreparedDataset(prepared, "all", "full")
    rated = recorded_truth(data, describe, per_surface=3)
    assert len(rated.ratings) == 6 and (rated.importance == 1).all()
    assert (np.bincount(rated.surface_ids) == 3).all()
    np.testing.assert_array_equal(rated.ratings, data.ratings.mean)
    chosen = data.non_overlapping(3)
    np.testing.assert_array_equal(rated.measures["levels"], data.levels[chosen])
    assert rated.mean("levels", POPULATION) == pytest.approx(data.levels[chosen].mean())


def test_source_and_recipe_decide(prepared, tmp_path, monkeypatch):
    fresh = truth_of(prepared, [POPULATION], describe, surfaces=2, candidates=40, seconds=8.0)
    assert len(fresh.ratings) <= 2
    copy = tmp_path / "p.h5"
    copy.write_bytes(prepared.read_bytes())
    with h5py.File(copy, "r+") as file:
        file.attrs["source"] = "a study"
    recorded = truth_of(copy, [POPULATION], describe, surfaces=2, per_surface=1)
    surfaces = len(np.unique(PreparedDataset(copy, "all").surface_ids))
    assert len(recorded.ratings) == len(recorded.surface_ids) == surfaces
    with pytest.raises(ValueError, match="must hold virtual surfaces of recipe .* got 'a study'"):
        virtual_truth(PreparedDataset(copy), [POPULATION], describe)
    monkeypatch.setattr(virtual, "RECIPE_VERSION", 0)
    assert len(truth_of(prepared, [POPULATION], describe, surfaces=2, per_surface=1).ratings) == surfaces


def test_other_recipes_rates_and_nonsense_are_refused(prepared, monkeypatch):
    data = PreparedDataset(prepared)
    with pytest.raises(ValueError, match="`requests` must not be empty"):
        virtual_truth(data, [], describe)
    for name in ("surfaces", "per_surface"):
        with pytest.raises(ValueError, match=f"`{name}`"):
            virtual_truth(data, [POPULATION], describe, **{name: 0})
    with pytest.raises(ValueError, match="native rate, 10000 Hz"):
        virtual_truth(PreparedDataset(prepared, sampling_rate=2500), [POPULATION], describe)
    made = virtual.RECIPE_VERSION
    monkeypatch.setattr(virtual, "RECIPE_VERSION", made + 1)
    with pytest.raises(ValueError, match=f"of recipe {made + 1}, got .*, recipe {made}:"):
        virtual_truth(data, [POPULATION], describe)

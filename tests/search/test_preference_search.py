"""The search: pairs, answers, what it finds, its file."""

import json

import numpy as np
import pytest

from tactile_diffusers import TactileTexturePipeline
from tactile_diffusers.models.calibration import own_calibration
from tactile_diffusers.search import PreferenceSearch

SCALARS = {"scalar_width": 16, "distilled_steps": 1}


@pytest.fixture(scope="module")
def cascade(make_pipeline):
    """A tiny pipeline of which DALE generates its scalars first."""
    return make_pipeline(dale_config=SCALARS)


def _answer(search, taste, count):
    for _ in range(count):
        first, second = np.linalg.norm(search.next_pair() - taste, axis=1)
        search.answer("first" if first < second else "second")
    return search


def test_a_taste_is_found_in_twenty_comparisons(cascade):
    taste = np.array([1.0, -0.5, 0.5])
    search = _answer(PreferenceSearch(cascade, directions=0), taste, 20)
    point, uncertainty = search.best_point()
    assert np.linalg.norm(point - taste) / np.sqrt(3) < 0.3 and (uncertainty < 0.6).all()
    assert len(search.answers) == 20


def test_contradictions_are_taken_and_leave_it_uncertain(cascade):
    searches = [_answer(PreferenceSearch(cascade, directions=0), np.array([1.0, -0.5, 0.5]), 12) for _ in range(2)]
    for entry in list(searches[0].answers):  # each pair once more: the same answer, or the other one
        searches[0].answer(**entry)
        searches[1].answer(**{**entry, "answer": {"first": "second", "second": "first"}[entry["answer"]]})
    clear, torn = (search.best_point()[1].mean() for search in searches)
    assert torn > 1.5 * clear
    undecided = PreferenceSearch(cascade, directions=0)
    pair = undecided.next_pair()
    for answer in ("first", "second", "neither"):  # of one and the same pair
        undecided.answer(answer, *pair)
    assert np.isfinite(undecided.best_point()).all()


def test_textures_are_those_of_the_points(cascade):
    search = PreferenceSearch(cascade, axes=["bumpiness"], directions=1, ratings={"roughness": 0.5}, seed=3)
    assert search.names == ["bumpiness", "direction 1"]
    pair = search.propose()
    assert pair.textures.shape[0] == 2
    again = search.space.textures(search.next_pair()[1:])
    np.testing.assert_allclose(again.textures[0], pair.textures[1], rtol=1e-4, atol=1e-7)  # another batch
    ratings = search.space.ratings(search.next_pair())
    np.testing.assert_array_equal(ratings[:, 0], 0.5)
    np.testing.assert_array_equal(ratings[:, 1], search.next_pair()[:, 0])
    assert np.isnan(ratings[:, 2]).all()
    search.answer("second")
    best = search.best()
    assert list(best.point) == list(best.uncertainty) == search.names
    np.testing.assert_array_equal(best.texture.textures, search.space.textures([list(best.point.values())]).textures)


def test_directions_change_textures_and_all_else_stays(cascade):
    space = PreferenceSearch(cascade, axes=[], directions=2, seed=1).space
    one, same, other = (space.textures([point]).textures for point in ([0.0, 0.0], [0.0, 0.0], [1.5, 0.0]))
    np.testing.assert_array_equal(one, same)
    assert not np.allclose(one, other)


def test_a_search_goes_on_after_saving(cascade, tmp_path):
    search = _answer(PreferenceSearch(cascade, ["roughness"], 1, {"bumpiness": 1.0}, seed=2), np.zeros(2), 5)
    search.save(tmp_path / "search.json")
    loaded = PreferenceSearch.load(tmp_path / "search.json", cascade)
    assert loaded.answers == search.answers and loaded.space.held == {"bumpiness": 1.0}
    np.testing.assert_array_equal(loaded.next_pair(), search.next_pair())
    np.testing.assert_array_equal(loaded.best_point(), search.best_point())


def test_another_checkpoint_is_refused(cascade, make_pipeline, tmp_path):
    PreferenceSearch(cascade).save(tmp_path / "search.json")
    before = (tmp_path / "search.json").read_bytes()
    with pytest.raises(ValueError, match="search.json belongs to another checkpoint"):
        PreferenceSearch.load(tmp_path / "search.json", make_pipeline(seed=5, dale_config=SCALARS))
    assert (tmp_path / "search.json").read_bytes() == before
    PreferenceSearch.load(tmp_path / "search.json", make_pipeline(dale_config=SCALARS))  # the same weights
    cascade.save_pretrained(tmp_path / "pipeline")
    PreferenceSearch.load(tmp_path / "search.json", TactileTexturePipeline.from_pretrained(tmp_path / "pipeline"))
    adapted = make_pipeline(dale_config=SCALARS)
    adapted.dale.register_to_config(level_std=2 * adapted.dale.config.level_std)  # all that `adapt` changes is configs
    with pytest.raises(ValueError, match="search.json belongs to another checkpoint"):
        PreferenceSearch.load(tmp_path / "search.json", adapted)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": "other"}, '"format": "tactile-preference-search"'),
        ({"version": 1}, "version 1 did not tell an adapted checkpoint from the original"),
        ({"answers": [{"first": [0, 0, 9], "second": [0, 0, 0], "answer": "first"}]}, "`first` must be a point"),
        ({"answers": [{"first": [0, 0, 0], "second": [0, 0, 0], "answer": "both"}]}, "`answer` must be one of"),
        ({"axes": ["warmth"]}, "`axes` must be a list"),
        ({"seed": None}, "`seed` must be a whole number"),
        ({"answers": 3}, "Begin another one"),
    ],
)
def test_damaged_files_are_refused_by_name(cascade, tmp_path, change, message):
    path = tmp_path / "search.json"
    PreferenceSearch(cascade, directions=0).save(path)
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(ValueError, match=r"search\.json") as refused:
        PreferenceSearch.load(path, cascade)
    assert message in str(refused.value)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"axes": ["warmth"]}, "`axes` must be a list of different names"),
        ({"axes": "roughness"}, "`axes` must be a list of different names"),
        ({"axes": [], "directions": 0}, "nothing to search"),
        ({"directions": 9}, "`directions` must be a whole number of at least 0 and at most 8"),
        ({"ratings": {"roughness": 1.0}}, "`ratings` holds axes that are not searched"),
        ({"axes": ["roughness"], "ratings": {"bumpiness": None}}, "must be a finite number"),
        ({"axes": ["roughness"], "ratings": {"bumpiness": 7.0}}, r"`ratings\['bumpiness'\]` must .* at most 6, got 7"),
        ({"seed": -1}, "`seed` must be"),
    ],
)
def test_bad_arguments_are_refused(cascade, arguments, message):
    with pytest.raises(ValueError, match=message):
        PreferenceSearch(cascade, **arguments)


def test_pipelines_that_cannot_are_refused(make_pipeline):
    with pytest.raises(ValueError, match="`directions` needs a DALE with a network of scalars"):
        PreferenceSearch(make_pipeline())
    with pytest.raises(ValueError, match="`pipe` must be a TactileTexturePipeline with `dale`"):
        PreferenceSearch(make_pipeline(dale=False))
    many_steps = PreferenceSearch(make_pipeline(), directions=0)
    assert many_steps.propose().textures.shape[0] == 2


def test_bad_answers_change_nothing(cascade):
    search = PreferenceSearch(cascade, directions=0)
    with pytest.raises(ValueError, match="Nothing was proposed"):
        search.answer("first")
    pair = search.next_pair()
    for arguments in (("both",), ("first", pair[0]), ("first", pair[0], [0, 0]), ("first", pair[0], [0, 0, np.nan])):
        with pytest.raises(ValueError, match="`answer`|`first` and `second`|`second` must be a point"):
            search.answer(*arguments)
    assert not search.answers
    np.testing.assert_array_equal(search.next_pair(), pair)


def test_held_ratings_beyond_all_surfaces_are_refused(make_pipeline, rating_statistics):
    pipe = make_pipeline(dale_config=SCALARS | {"rating_statistics": rating_statistics | {"reach": 3.0}})
    search = PreferenceSearch(pipe, ["roughness"], 0, {"bumpiness": 2.0})
    points = search.space.draw(50, np.random.default_rng(0))
    away = np.concatenate([points, np.full((50, 1), 2.0)], axis=1)
    covariance = np.array(rating_statistics["covariance"])[:2, :2]
    assert (np.einsum("ni,ij,nj->n", away, np.linalg.inv(covariance), away) <= 9).all()
    with pytest.raises(ValueError, match="`ratings` {'bumpiness': 3.0} lie beyond all training surfaces"):
        PreferenceSearch(pipe, ["roughness"], 0, {"bumpiness": 3.0})


def test_directions_of_an_adapted_checkpoint_with_a_further_axis(make_pipeline):
    pipe = make_pipeline(dale_config=SCALARS)
    wanted = PreferenceSearch(pipe).space._vectors
    further, axes = own_calibration(pipe.dale.config, pipe.dale.num_scalars), pipe.dale.config.rating_axes
    further |= {"slopes": [[0.0] * pipe.dale.num_scalars] * 4, "centre": [0.0] * 4, "covariance": np.eye(4).tolist()}
    pipe.dale.register_to_config(rating_axes=(*axes, "fineness"), network_axes=3, calibration=further)
    search = PreferenceSearch(pipe)
    assert search.names == [*axes, "fineness", "direction 1", "direction 2"]
    np.testing.assert_array_equal(search.space._vectors, wanted)
    assert np.isfinite(search.propose().textures).all()

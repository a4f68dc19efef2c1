"""Ratings of many textures: from files, and drawn from the distribution that a checkpoint stores."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from dataset.ratings import STATISTICS, draw_ratings, read_ratings_file

from tactile_diffusers import DALEModel, bundled_checkpoint
from tactile_diffusers.signal import coverage_distance

CONFIG = SimpleNamespace(rating_axes=["roughness", "bumpiness", "slipperiness"])
NAN = np.nan


def _csv(folder, text):
    (folder / "ratings.csv").write_text(text, encoding="utf-8-sig")
    return folder / "ratings.csv"


def test_all_kinds_of_file_say_the_same(tmp_path):
    rows = [[1.0, None, -1.0], [0.5, 0.25, None]]
    (tmp_path / "a.json").write_text(json.dumps(rows))
    named = [{"roughness": 1.0, "slipperiness": -1.0}, {"bumpiness": 0.25, "roughness": 0.5}]
    (tmp_path / "b.json").write_text(json.dumps(named))
    np.save(tmp_path / "c.npy", np.array(rows, dtype=float))
    table = _csv(tmp_path, "roughness,bumpiness,slipperiness\n1,,-1\n0.5,0.25,\n")
    for path in (tmp_path / "a.json", tmp_path / "b.json", tmp_path / "c.npy", table):
        np.testing.assert_array_equal(read_ratings_file(path, CONFIG, 2), np.array(rows, dtype=np.float32))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("rougness\n1\n", "'rougness'"),
        ("roughness,roughness\n1,1\n", "must name columns"),
        ("", "must name columns"),
        ("roughness\n", "at least one texture"),
        ("roughness,bumpiness\n1,2\n1\n", "row 2 has 1 cells, not 2"),
        ("roughness,bumpiness\n1,2,3\n", "row 1 has 3 cells, not 2"),
        ("roughness\n1\nrough\n", "could not convert string to float: 'rough'"),
        ("roughness\n1\n7\n", r"roughness = 7.0 in row 1"),
        ("roughness\ninf\n", r"roughness = inf in row 0"),
        ("roughness\n1\n2\n3\n", "has 3 rows, more than --num_textures 2: give --num_textures 3"),
    ],
)
def test_bad_tables_are_refused_by_name_and_line(tmp_path, text, message):
    with pytest.raises(ValueError, match=rf"(?s)--ratings_file .*ratings\.csv.*{message}"):
        read_ratings_file(_csv(tmp_path, text), CONFIG, 2)


def test_bad_files_are_refused(tmp_path):
    (tmp_path / "a.json").write_text("[[1, 2")
    np.save(tmp_path / "b.npy", np.zeros((2, 4)))
    np.save(tmp_path / "c.npy", np.array([{"roughness": 1}], dtype=object), allow_pickle=True)
    (tmp_path / "d.txt").write_text("1 2 3")
    for name, message in (("a.json", "Expecting"), ("b.npy", "3 values"), ("c.npy", "objects"), ("d.txt", "end in")):
        with pytest.raises(ValueError, match=rf"--ratings_file .*{name}.*{message}"):
            read_ratings_file(tmp_path / name, CONFIG, 2)


@pytest.fixture(scope="module")
def bundled():
    return SimpleNamespace(**DALEModel.load_config(bundled_checkpoint(), subfolder="dale"))


def test_drawn_ratings_are_distributed_as_the_training_surfaces(bundled):
    drawn, statistics = draw_ratings(bundled, 20_000, seed=0), bundled.rating_statistics
    assert drawn.shape == (20_000, 3) and drawn.dtype == np.float32
    shares = np.linspace(0, 1, 21)
    quantiles = np.quantile(drawn, shares, axis=0).T
    # the standard error of a quantile of 20,000 is below 0.02 inside; the ends are single draws; leaving out what is
    # far from the centre takes some of the outermost
    np.testing.assert_allclose(quantiles[:, 1:-1], np.array(statistics["quantiles"])[:, 1:-1], atol=0.08)
    covariance = np.array(statistics["covariance"])
    spread = np.sqrt(np.diag(covariance))
    # of normal numbers behind skewed ratings, and sampling: 0.007
    np.testing.assert_allclose(np.corrcoef(drawn.T), covariance / np.outer(spread, spread), atol=0.05)
    limits = np.float32(statistics["range"])
    assert (drawn >= limits[:, 0]).all() and (drawn <= limits[:, 1]).all()
    assert coverage_distance(drawn, statistics["centre"], covariance).max() <= statistics["reach"]


def test_drawn_ratings_depend_on_seed_and_place_alone(bundled):
    many = draw_ratings(bundled, 2500, seed=1)
    np.testing.assert_array_equal(draw_ratings(bundled, 700, seed=1), many[:700])
    assert len(np.unique(many, axis=0)) == 2500
    assert not np.isin(draw_ratings(bundled, 50, seed=2)[:, 0], many[:, 0]).any()


@pytest.mark.parametrize("name", STATISTICS)
def test_a_checkpoint_without_the_distribution_is_refused(bundled, name):
    statistics = {**bundled.rating_statistics, name: None}
    config = SimpleNamespace(**{**vars(bundled), "rating_statistics": statistics})
    with pytest.raises(ValueError, match=rf"\['{name}'\] missing .* Give --ratings_file"):
        draw_ratings(config, 5, 0)

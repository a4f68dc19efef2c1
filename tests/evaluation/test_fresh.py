"""Fresh virtual surfaces: what they give without a file is what a file would hold."""

import numpy as np
import pytest
from report.fresh import FIRST_FRESH, fresh_ratings, fresh_textures
from scipy.spatial.distance import pdist

from tactile_diffusers.data import PreparedDataset, RecordingsWriter, SegmentLimits, prepare_recordings
from tactile_diffusers.signal import DEVICE_RATE, RATING_AXES
from tactile_diffusers.virtual import VELOCITY_RATE, Collection, VirtualSurface
from tactile_diffusers.virtual.raters import draw_raters
from tactile_diffusers.virtual.recipe import draw_surface
from tactile_diffusers.virtual.relief import profile_tables
from tactile_diffusers.virtual.streams import Stream, stream

SEED = 3
COLLECTION = Collection(12.0, seed=SEED)


def test_a_rated_surface_needs_no_profile():
    surface = VirtualSurface(SEED, FIRST_FRESH)
    surface.answers(draw_raters(SEED))
    assert "_tables" not in vars(surface)
    # made later it is the same: the profile goes on in the stream that the parameters were drawn from
    rng = stream(SEED, Stream.SURFACE, FIRST_FRESH)
    assert draw_surface(rng) == surface.parameters
    tables = profile_tables(surface.parameters, rng)
    surface.explore(0, 2.0)
    np.testing.assert_array_equal(surface._tables, tables)


def test_ratings_in_the_units_of_a_data_set(virtual_prepared):
    data = PreparedDataset(virtual_prepared, "all", "full")
    training = np.unique(PreparedDataset(virtual_prepared, "train", "full").surface_ids)
    raters = draw_raters(data.attributes["seed"])
    answers = np.stack([VirtualSurface(SEED, number).answers(raters) for number in training], axis=1)
    mean, scale = (moment[:, None].astype(np.float64) for moment in (answers.mean(1), answers.std(1)))
    fresh = np.stack([VirtualSurface(SEED, FIRST_FRESH + number).answers(raters) for number in range(5)], axis=1)
    expected = ((fresh - mean) / scale).mean(0)
    np.testing.assert_allclose(fresh_ratings(5, COLLECTION, training=training), expected, atol=1e-5)  # float32 moments


def test_ratings_of_a_file_with_other_raters():
    attributes = {"agreement": 3.0, "raters": 15, "rating_correlation": [0.4, -0.8, -0.3], "seed": SEED, "seconds": 9.0}
    collection = Collection.from_attributes({**attributes, "band": 1})
    assert collection == Collection(9.0, seed=SEED, agreement=3.0, raters=15, rating_correlation=(0.4, -0.8, -0.3))
    surfaces = [VirtualSurface(SEED, FIRST_FRESH + number) for number in range(20)]
    asked = [2, 7, 14]  # the others are held out
    answers = [s.answers(draw_raters(SEED, 15), 3.0, (0.4, -0.8, -0.3))[asked] for s in surfaces]
    answers = np.stack(answers, axis=1).astype(np.float64)
    z = (answers - answers.mean(1, keepdims=True)) / answers.std(1, keepdims=True)
    fresh = fresh_ratings(20, collection, raters=asked)
    np.testing.assert_allclose(fresh, z.mean(0), atol=1e-6)  # float32
    assert not np.array_equal(fresh, fresh_ratings(20, collection))


def test_textures_of_chosen_explorers():
    limits = SegmentLimits(seconds=0.5)
    both, second = (
        fresh_textures(FIRST_FRESH, COLLECTION, who, 12.0, limits, per_surface=100)[0] for who in (None, [1])
    )
    first = fresh_textures(FIRST_FRESH, COLLECTION, [0], 12.0, limits, per_surface=100)[0]
    assert 0 < len(first) < len(both) and 0 < len(second) < len(both)
    with pytest.raises(ValueError, match="`explorers`"):
        fresh_textures(FIRST_FRESH, COLLECTION, [], 12.0, limits)


@pytest.mark.parametrize("turnarounds", ["keep", "mask"])
def test_textures_are_those_of_a_prepared_file(tmp_path, turnarounds):
    """Every texture is a window of the file that recordings of the same surface make, with the same numbers."""
    limits = SegmentLimits(normal_force=(0.3, 0.8), speed=(60.0, 110.0), seconds=0.8)
    surfaces = [VirtualSurface(SEED, FIRST_FRESH + number) for number in range(3)]
    with RecordingsWriter(tmp_path / "r.h5", source="virtual surfaces", licence="CC0-1.0") as writer:
        for surface in surfaces:
            for number in range(2):
                force, velocity = surface.explore(number, 6.0)
                rates = {"force_rate": DEVICE_RATE, "velocity_rate": VELOCITY_RATE}
                writer.add_recording(surface.name, f"e{number}", "0", force=force, velocity=velocity, **rates)
        answers = np.stack([surface.answers(draw_raters(SEED)) for surface in surfaces], axis=1)
        writer.set_ratings(answers, [str(r) for r in range(len(answers))], [s.name for s in surfaces], RATING_AXES)
    filters = {"band": (30.0, 900.0), "turnarounds": turnarounds}
    prepare_recordings(tmp_path / "r.h5", tmp_path / "p.h5", limits=limits, validation=0, test=0, quiet=True, **filters)
    data = PreparedDataset(tmp_path / "p.h5", "all")
    for number, surface in enumerate(surfaces):
        rows = np.flatnonzero(data.surface_ids == number)
        textures, friction, levels, speeds = fresh_textures(surface.index, COLLECTION, None, 6.0, limits, **filters)
        assert textures.shape == (2, 8000)
        stored = data.textures(rows)
        for k, texture in enumerate(textures):
            row = rows[np.flatnonzero((stored == texture).all(1))]  # bit for bit
            assert len(row) == 1
            assert friction[k] == data.friction_coefficients[row] and levels[k] == data.levels[row]
            assert speeds[k] == data.speeds[row]


def test_textures_share_no_sample_and_come_from_both_explorers():
    limits = SegmentLimits(seconds=0.5)
    textures, friction, levels, speeds = fresh_textures(FIRST_FRESH, COLLECTION, None, 12.0, limits, per_surface=6)
    assert textures.shape == (6, 5000) and textures.dtype == friction.dtype == levels.dtype == speeds.dtype == "f4"
    assert pdist(textures).min() > 0
    # explorers in turn: the second one's skin is drier, its friction coefficient three quarters (within the 10 % that
    # speed and load change)
    np.testing.assert_allclose(friction[1::2].mean() / friction[::2].mean(), 0.75, rtol=0.1)
    # all that there are: float32 values rarely meet by chance, overlapping windows would share half of theirs
    values = fresh_textures(FIRST_FRESH, COLLECTION, None, 12.0, limits, per_surface=100)[0]
    assert len(values) > 10 and len(np.unique(values)) > 0.98 * values.size
    again = fresh_textures(FIRST_FRESH, COLLECTION, None, 12.0, limits, per_surface=6)[0]
    np.testing.assert_array_equal(textures, again)
    other = fresh_textures(FIRST_FRESH, COLLECTION, None, 12.0, limits, per_surface=6, trial=1)[0]
    assert np.isin(other, textures).mean() < 0.01


def test_a_surface_without_a_window_has_no_texture():
    nowhere = SegmentLimits(speed=(500.0, 501.0))
    textures, *facts = fresh_textures(FIRST_FRESH, COLLECTION, [0], 3.0, nowhere)
    assert textures.shape == (0, 16384) and all(values.shape == (0,) for values in facts)


def test_no_candidates_are_refused():
    with pytest.raises(ValueError, match="`candidates`"):
        fresh_ratings(0, COLLECTION)

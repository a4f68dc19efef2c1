"""Preparation as a whole and its reader."""

import json
import pickle
import shutil

import h5py
import numpy as np
import pytest
import torch

from tactile_diffusers.data import PreparedDataset, RecordingsFile, SegmentLimits, prepare_recordings, split_surfaces
from tactile_diffusers.signal import (
    BAND_HZ,
    DEVICE_RATE,
    SEGMENT_SAMPLES,
    WORKING_RATE,
    band_pass,
    level,
    nine_band_error_db,
    resample,
)
from tactile_diffusers.virtual import generate_recordings


def test_item(virtual_prepared):
    data = PreparedDataset(virtual_prepared)
    item = data[1]
    assert item["texture"].shape == (SEGMENT_SAMPLES,) and item["texture"].dtype == torch.float32
    for name in ("friction_coefficient", "level", "reference_speed"):
        assert item[name].shape == () and item[name].dtype == torch.float32
    for name in ("ratings", "ratings_std", "ratings_count"):
        assert item[name].shape == (3,) and item[name].dtype == torch.float32
    assert item["surface"].dtype == torch.int64 and item["index"] == 1
    assert item["level"] == pytest.approx(float(level(item["texture"].numpy())), abs=1e-4)  # float32
    assert 66 < item["reference_speed"] < 99 and 0.1 < item["friction_coefficient"] < 3
    torch.testing.assert_close(item["ratings"], torch.tensor(data.ratings.mean[item["surface"]]))
    assert (data.sampling_rate, data.unit, data.band) == (DEVICE_RATE, "N", BAND_HZ)
    with pytest.raises(IndexError):
        data[len(data)]


def test_attributes_are_plain_values(virtual_prepared):
    data = PreparedDataset(virtual_prepared)
    assert data.attributes["source"] == data.source == "virtual surfaces"
    assert data.attributes["seed"] == 3 and type(data.attributes["seed"]) is int
    assert data.attributes["agreement"] == 1.0 and type(data.attributes["agreement"]) is float
    assert data.attributes["band"] == list(BAND_HZ) and type(data.attributes["recipe_version"]) is int
    assert (data.attributes["filter_order"], data.attributes["filter_passes"]) == (4, 2)
    assert (data.attributes["turnarounds"], data.attributes["hold_out"]) == ("mask", None)
    assert SegmentLimits(**data.attributes["limits"]).samples(DEVICE_RATE) == data.segment_samples
    assert json.loads(json.dumps(data.attributes)) == data.attributes
    assert data.explorers == 1


def test_explorers_are_counted_once(tmp_path):
    generate_recordings(tmp_path / "r.h5", surfaces=2, seconds=8, explorers=2, seed=3, quiet=True)
    prepare_recordings(tmp_path / "r.h5", tmp_path / "p.h5", validation=0, test=0, quiet=True)
    assert PreparedDataset(tmp_path / "p.h5", subset="full").explorers == 2


def test_splits_are_by_surface(virtual_prepared):
    parts = [set(PreparedDataset(virtual_prepared, s, "full").surface_ids) for s in ("train", "validation", "test")]
    assert [len(part) for part in parts] == [4, 1, 1]
    assert set.union(*parts) == set(range(6))
    assert len(PreparedDataset(virtual_prepared, "all", "full")) == sum(
        len(PreparedDataset(virtual_prepared, split, "full")) for split in ("train", "validation", "test")
    )


def test_full_set_is_larger_and_leaves_the_limits(virtual_prepared):
    filtered, full = (PreparedDataset(virtual_prepared, "all", subset) for subset in ("filtered", "full"))
    assert len(full) > len(filtered)
    assert full.speeds.max() > filtered.speeds.max()


def test_texture_is_the_filtered_recording(virtual_recordings, tmp_path):
    prepare_recordings(virtual_recordings, tmp_path / "p.h5", quiet=True, turnarounds="keep")
    data = PreparedDataset(tmp_path / "p.h5", "all")
    with RecordingsFile(virtual_recordings) as source:
        recording = source.read(data.recordings[data.recording_ids[3]])
    start = data.starts[3]
    heading = np.arctan2(recording.velocity[:, 1], recording.velocity[:, 0])
    heading = np.interp(np.arange(recording.samples) / 20, np.arange(len(heading)), np.unwrap(heading))
    lateral = recording.force[:, 0] * np.cos(heading) + recording.force[:, 1] * np.sin(heading)
    expected = band_pass(lateral, DEVICE_RATE)[start : start + SEGMENT_SAMPLES]
    # the reader smooths the direction, this reference does not: a few percent where the finger turns
    assert np.std(data.textures(3)[0] - expected) < 0.1 * np.std(expected)


@pytest.mark.parametrize("rate", [WORKING_RATE, 4000])  # one that the file holds, one made when it is opened
def test_resampled_item_equals_resampling_the_whole_then_cropping(virtual_prepared, rate):
    native, data = PreparedDataset(virtual_prepared), PreparedDataset(virtual_prepared, sampling_rate=rate)
    assert data.segment_samples == round(SEGMENT_SAMPLES * rate / DEVICE_RATE)
    with h5py.File(virtual_prepared) as file:
        offsets, lateral = file[f"offset/{DEVICE_RATE}"][()], file[f"lateral/{DEVICE_RATE}"][()]
    for index in (0, len(data) // 2, len(data) - 1):
        recording = slice(*offsets[native.recording_ids[index] :][:2])
        whole = resample(lateral[recording], DEVICE_RATE, rate)
        assert data.starts[index] == round(native.starts[index] * rate / DEVICE_RATE)
        expected = whole[data.starts[index] :][: data.segment_samples]
        np.testing.assert_array_equal(data[index]["texture"].numpy(), np.float32(expected))


def test_textures_by_index(virtual_prepared):
    for rate in (None, WORKING_RATE, 4000):
        data = PreparedDataset(virtual_prepared, "all", sampling_rate=rate)
        batch = data.textures([2, 0])
        assert batch.shape == (2, data.segment_samples) and batch.dtype == np.float32
        np.testing.assert_array_equal(batch[1], data[0]["texture"].numpy())


@pytest.mark.parametrize("rate", [None, WORKING_RATE])
def test_opening_loads_no_texture(virtual_prepared, rate):
    data = PreparedDataset(virtual_prepared, "all", sampling_rate=rate)
    data.textures([0, 5])
    # what is held, and sent to worker processes, is the index: windows and names, no recording
    assert len(pickle.dumps(data)) < 0.01 * virtual_prepared.stat().st_size


def test_a_file_that_is_replaced_does_not_mix_with_the_old_index(virtual_prepared, virtual_recordings, tmp_path):
    path = tmp_path / "p.h5"
    shutil.copy(virtual_prepared, path)
    data = PreparedDataset(path, "all")
    prepare_recordings(virtual_recordings, path, band=(20, 500), quiet=True)
    np.testing.assert_array_equal(data.textures([0, 3]), PreparedDataset(virtual_prepared, "all").textures([0, 3]))


def test_compressed_lateral_force_is_refused(virtual_prepared, tmp_path):
    shutil.copy(virtual_prepared, tmp_path / "p.h5")
    with h5py.File(tmp_path / "p.h5", "r+") as file:
        values = file["lateral/10000"][()]
        del file["lateral/10000"]
        file.create_dataset("lateral/10000", data=values, compression="gzip")
    with pytest.raises(ValueError, match="p.h5: lateral force is chunked or compressed. Prepare"):
        PreparedDataset(tmp_path / "p.h5")


def test_max_samples_spreads_over_the_view(virtual_prepared):
    data = PreparedDataset(virtual_prepared, "all", "full", max_samples=12)
    assert len(data) == len(data.levels) == len(data.surface_ids) == 12
    assert len(set(data.surface_ids)) == 6


@pytest.mark.parametrize("rate", [None, WORKING_RATE, 4000])
def test_worker_processes_and_pickling(virtual_prepared, rate):
    data = PreparedDataset(virtual_prepared, sampling_rate=rate, max_samples=4)
    expected = data.textures(range(4))  # maps the file in this process before the workers fork
    for copy in (data, pickle.loads(pickle.dumps(data))):
        batches = list(torch.utils.data.DataLoader(copy, batch_size=2, num_workers=2))
        np.testing.assert_array_equal(torch.cat([batch["texture"] for batch in batches]).numpy(), expected)


def test_missing_ratings_and_nan_stretch(tmp_path, recording_maker, recordings_writer):
    recordings = {name: recording_maker(seconds=5.0, seed=i) for i, name in enumerate("abc")}
    recordings["b"]["force"][10_000:10_100] = np.nan
    path = recordings_writer(tmp_path / "r.h5", recordings)
    report = prepare_recordings(path, tmp_path / "p.h5", quiet=True)
    assert "the source has no ratings: they are NaN" in report.notes
    assert "missing samples (NaN) excluded, in 1 recordings, first b/explorer/0" in report.notes
    assert report.seconds["filtered"]["missing (NaN)"] == pytest.approx(0.01)
    assert sum(report.seconds["filtered"].values()) == pytest.approx(15.0)
    data = PreparedDataset(tmp_path / "p.h5", "all")
    assert np.isnan(data.ratings.mean).all() and torch.isnan(data[0]["ratings"]).all()
    assert np.isfinite(data.textures(range(len(data)))).all()
    assert "missing samples" in str(report)


def test_ratings_reach_the_items(tmp_path, recording_maker, recordings_writer):
    recordings = {name: recording_maker(seed=i) for i, name in enumerate("abcd")}
    values = np.array([[[1, 1, 1], [3, 2, 5], [5, 7, 5], [7, 3, 2]], [[2, 2, 2], [3, 3, 3], [4, 4, 4], [4, 4, 4]]])
    values[1, :, 2] = 6
    path = recordings_writer(tmp_path / "r.h5", recordings, values)
    report = prepare_recordings(path, tmp_path / "p.h5", validation=0, test=0, quiet=True)
    assert "rater left out: r1 on slipperiness: the same answer on all training surfaces" in report.notes
    data = PreparedDataset(tmp_path / "p.h5", "train")
    assert data[0]["ratings_count"].tolist() == [2, 2, 1]
    np.testing.assert_allclose(data.ratings.raw_mean[2], values[0, :, 2].mean())


def test_split_seed_and_sizes():
    np.testing.assert_array_equal(split_surfaces(50, seed=1), split_surfaces(50, seed=1))
    assert (split_surfaces(50, seed=1) != split_surfaces(50, seed=2)).any()
    assert np.bincount(split_surfaces(50)).tolist() == [40, 5, 5]
    # evaluation needs two of each; from 15 surfaces on a tenth is two anyway
    for surfaces, held in ((7, 1), (8, 2), (14, 2), (15, 2), (24, 2), (26, 3)):
        assert np.bincount(split_surfaces(surfaces)).tolist() == [surfaces - 2 * held, held, held]
    assert np.bincount(split_surfaces(10, validation=0.05, test=1)).tolist() == [8, 1, 1]
    assert np.bincount(split_surfaces(15, validation=0, test=3), minlength=3).tolist() == [12, 0, 3]
    for arguments in ({"test": -0.1}, {"validation": 1.5}, {"validation": 3, "test": 3}):
        with pytest.raises(ValueError, match="`(test|validation)`"):
            split_surfaces(6, **arguments)


@pytest.mark.parametrize(
    "arguments, message",
    [
        ({"split": "training"}, "`split` must be one of"),
        ({"subset": "all"}, "`subset` must be one of"),
        ({"sampling_rate": 2000}, "`sampling_rate` must be .* above 2000"),
        ({"max_samples": 0}, "`max_samples`"),
        ({"max_surfaces": 0}, "`max_surfaces` must be at least 1 or None, got 0"),
    ],
)
def test_reader_refuses(virtual_prepared, arguments, message):
    with pytest.raises(ValueError, match=message):
        PreparedDataset(virtual_prepared, **arguments)


def test_reader_refuses_other_files_and_empty_views(tmp_path, virtual_recordings, recording_maker, recordings_writer):
    with pytest.raises(ValueError, match="is not a prepared data set"):
        PreparedDataset(virtual_recordings)
    path = recordings_writer(tmp_path / "r.h5", {"a": recording_maker()})
    prepare_recordings(path, tmp_path / "p.h5", validation=0, test=0, quiet=True)
    with pytest.raises(ValueError, match="no filtered segment in the split 'test'"):
        PreparedDataset(tmp_path / "p.h5", "test")


def test_mixed_rates_and_bad_band_are_refused(tmp_path, recording_maker, recordings_writer):
    other = {**recording_maker(), "force_rate": 8000}
    path = recordings_writer(tmp_path / "r.h5", {"a": recording_maker(), "b": other, "c": recording_maker()})
    with pytest.raises(ValueError, match="rates \\[8000, 10000\\] Hz. Resample"):
        prepare_recordings(path, tmp_path / "p.h5", quiet=True)
    path = recordings_writer(tmp_path / "r.h5", {name: recording_maker() for name in "abc"})
    with pytest.raises(ValueError, match="`band` must satisfy"):
        prepare_recordings(path, tmp_path / "p.h5", band=(20, 6000), quiet=True)


def test_other_segment_length_and_overlap(tmp_path, recording_maker, recordings_writer):
    path = recordings_writer(tmp_path / "r.h5", {name: recording_maker() for name in "abc"})
    limits = SegmentLimits(seconds=0.5, overlap=0.0)
    prepare_recordings(path, tmp_path / "p.h5", limits=limits, quiet=True)
    data = PreparedDataset(tmp_path / "p.h5", "all")
    assert data.segment_samples == 5000 and len(data) == 3 * 7  # 3.8 s of 4 are free of filter margins


def test_virtual_statistics(tmp_path):
    """The levels and baselines that the recipe aims at, on few surfaces: wide tolerances to catch a wrong law."""
    generate_recordings(tmp_path / "r.h5", surfaces=16, seconds=20, explorers=2, seed=0, quiet=True)
    prepare_recordings(tmp_path / "r.h5", tmp_path / "p.h5", quiet=True)
    data = PreparedDataset(tmp_path / "p.h5", "all")
    assert 0.005 < np.exp(data.levels).mean() < 0.016  # aim 0.009 N
    rng = np.random.default_rng(0)
    first, second = rng.integers(0, len(data), (2, 400))
    textures = data.textures(first), data.textures(second)
    error = nine_band_error_db(*textures, data.sampling_rate)
    same = (data.surface_ids[first] == data.surface_ids[second]) & (first != second)
    other = data.surface_ids[first] != data.surface_ids[second]
    assert error[same].mean() < 3.0 and 4.0 < error[other].mean() < 9.0  # aims 1.4 (one explorer) and 6.7 dB
    take, another = textures[0][same], textures[1][same]
    snr = 10 * np.log10(np.square(take).sum(1) / np.square(take - another).sum(1))
    assert snr.mean() == pytest.approx(-3.0, abs=1.0)  # independent takes of equal power


def test_max_surfaces_keeps_whole_surfaces_spread_over_the_view(virtual_prepared):
    every = PreparedDataset(virtual_prepared, "all", "full")
    for count, kept in ((1, [0]), (2, [0, 5]), (3, [0, 2, 5]), (6, range(6)), (7, range(6))):
        data = PreparedDataset(virtual_prepared, "all", "full", max_surfaces=count)
        assert np.unique(data.surface_ids).tolist() == list(kept)
        inside = np.isin(every.surface_ids, data.surface_ids)
        for name in ("surface_ids", "recording_ids", "starts", "levels", "friction_coefficients"):
            np.testing.assert_array_equal(getattr(data, name), getattr(every, name)[inside])
        np.testing.assert_array_equal(data.textures([0, -1]), every.textures(np.flatnonzero(inside)[[0, -1]]))
        # indices go on meaning the surfaces of the file
        assert data.surfaces == every.surfaces and len(data.ratings.mean) == 6


@pytest.mark.parametrize("split", ["train", "validation"])
def test_max_surfaces_counts_surfaces_of_the_split(virtual_prepared, split):
    every = np.unique(PreparedDataset(virtual_prepared, split, "full").surface_ids)
    kept = np.unique(PreparedDataset(virtual_prepared, split, "full", max_surfaces=2).surface_ids)
    assert kept.tolist() == (every[[0, -1]].tolist() if len(every) > 1 else every.tolist())


def test_max_samples_are_those_of_the_surfaces_that_are_left(virtual_prepared):
    data = PreparedDataset(virtual_prepared, "all", "full", max_samples=8, max_surfaces=2)
    assert len(data) == 8 and set(data.surface_ids) == {0, 5}


@pytest.mark.parametrize("rate", [None, WORKING_RATE, 4000])
def test_max_surfaces_at_every_rate(virtual_prepared, rate):
    every = PreparedDataset(virtual_prepared, "all", sampling_rate=rate)
    data = PreparedDataset(virtual_prepared, "all", sampling_rate=rate, max_surfaces=1)
    expected = every.textures(np.flatnonzero(every.surface_ids == data.surface_ids[0]))
    np.testing.assert_array_equal(data.textures(range(len(data))), expected)


def test_ratings_of_single_raters_average_to_the_pooled_ones(virtual_prepared):
    data = PreparedDataset(virtual_prepared)
    raters, *shape = data.ratings.single.shape
    assert raters > 1 and shape == [6, 3] and data.ratings.single.dtype == np.float32
    np.testing.assert_allclose(np.nanmean(data.ratings.single, axis=0), data.ratings.mean, atol=1e-6)  # float32
    np.testing.assert_array_equal((~np.isnan(data.ratings.single)).sum(0), data.ratings.count)
    assert data.ratings.single.std(0).max() > 0.1  # raters differ


def test_no_single_ratings_where_nobody_rated(tmp_path, recording_maker, recordings_writer):
    path = recordings_writer(tmp_path / "r.h5", {name: recording_maker() for name in "abc"})
    prepare_recordings(path, tmp_path / "p.h5", quiet=True)
    assert PreparedDataset(tmp_path / "p.h5").ratings.single is None

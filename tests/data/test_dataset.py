"""Preparation as a whole and its reader."""

import json
import pickle
import shutil

import h5py
import numpy as np
import pytest
import torch

from tactile_diffusers.data import PreparedDataset, SegmentLimits, prepare_recordings, split_surfaces
from tactile_diffusers.signal import (
    BAND_HZ,
    DEVICE_RATE,
    SEGMENT_SAMPLES,
    WORKING_RATE,
    level,
    resample,
)


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
    assert (data.attributes["turnarounds"], data.attributes["hold_out"]) == ("mask", None)
    assert SegmentLimits(**data.attributes["limits"]).samples(DEVICE_RATE) == data.segment_samples
    assert json.loads(json.dumps(data.attributes)) == data.attributes
    assert data.explorers == 1
    single = data.ratings.single
    assert len(single) > 1 and single.dtype == np.float32 and single.std(0).max() > 0.1  # raters differ
    np.testing.assert_allclose(np.nanmean(single, axis=0), data.ratings.mean, atol=1e-6)  # float32


def test_splits_are_by_surface(virtual_prepared):
    parts = [set(PreparedDataset(virtual_prepared, s, "full").surface_ids) for s in ("train", "validation", "test")]
    assert [len(part) for part in parts] == [4, 1, 1]
    assert set.union(*parts) == set(range(6))
    filtered, full = (PreparedDataset(virtual_prepared, "all", subset) for subset in ("filtered", "full"))
    splits = ("train", "validation", "test")
    assert len(full) == sum(len(PreparedDataset(virtual_prepared, split, "full")) for split in splits) > len(filtered)
    assert full.speeds.max() > filtered.speeds.max()


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
    data = PreparedDataset(virtual_prepared, "all", "full", max_samples=8, max_surfaces=2)
    assert len(data) == 8 and set(data.surface_ids) == {0, 5}


@pytest.mark.parametrize("rate", [None, WORKING_RATE, 4000])
def test_worker_processes_and_pickling(virtual_prepared, rate):
    data = PreparedDataset(virtual_prepared, sampling_rate=rate, max_samples=4)
    expected = data.textures(range(4))  # maps the file in this process before the workers fork
    for copy in (data, pickle.loads(pickle.dumps(data))):
        batches = list(torch.utils.data.DataLoader(copy, batch_size=2, num_workers=2))
        np.testing.assert_array_equal(torch.cat([batch["texture"] for batch in batches]).numpy(), expected)


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
    with pytest.raises(ValueError, match="`split_seed` must be a whole number of at least 0, got -1"):
        split_surfaces(6, seed=-1)
    with pytest.raises(ValueError, match="`test` must be a share below 1 or a whole number"):
        split_surfaces(6, test=float("inf"))


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


def test_max_surfaces_keeps_whole_surfaces_spread_over_the_view(virtual_prepared):
    every = PreparedDataset(virtual_prepared, "all", "full")
    for count, kept in ((1, [0]), (2, [0, 5]), (3, [0, 2, 5]), (7, range(6))):
        data = PreparedDataset(virtual_prepared, "all", "full", max_surfaces=count)
        assert np.unique(data.surface_ids).tolist() == list(kept)
        inside = np.isin(every.surface_ids, data.surface_ids)
        for name in ("surface_ids", "recording_ids", "starts", "levels", "friction_coefficients"):
            np.testing.assert_array_equal(getattr(data, name), getattr(every, name)[inside])
        np.testing.assert_array_equal(data.textures([0, -1]), every.textures(np.flatnonzero(inside)[[0, -1]]))
        # indices go on meaning the surfaces of the file
        assert data.surfaces == every.surfaces and len(data.ratings.mean) == 6

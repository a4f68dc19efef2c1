"""Reader of the BioTac slides: a made-up file, and the real one where it is at hand."""

from pathlib import Path

import h5py
import numpy as np
import pytest
from biotac import BIOTAC_BAND_HZ, convert_biotac, main

from tactile_diffusers.data import PreparedDataset, RecordingsFile
from tactile_diffusers.signal import SEGMENT_SECONDS

REAL = Path(__file__).parents[2].parent / "shared/data/biotac_slide/biotac_slide.h5"


@pytest.fixture
def slides(tmp_path):
    rng = np.random.default_rng(0)
    with h5py.File(tmp_path / "slides.h5", "w") as file:
        file.attrs.update(sampling_rate_hz=2200.0, sliding_speed_mm_s=25.0, source="made up", licence="none stated")
        for number in range(6):
            group = file.create_group(f"mat{number:02d}")
            group.attrs["name"] = f"Paper {number}"
            group["pac"] = (500 * rng.standard_normal((2, 13_178))).astype(np.int16)
    return tmp_path / "slides.h5"


def check(root, tmp_path, surfaces):
    main([str(root), str(tmp_path / "r.h5"), str(tmp_path / "p.h5"), "--quiet"])
    with RecordingsFile(tmp_path / "r.h5") as file:
        assert len(file.surfaces) == surfaces and file.unit == "1" and file.ratings is None
        recording = file.read(file.names[0])
    with h5py.File(root) as source:
        first = source[sorted(source)[0]]["pac"][0]
    assert recording.rate == 2200
    np.testing.assert_array_equal(recording.lateral, first[1100:])  # the first 0.5 s is contact
    data = PreparedDataset(tmp_path / "p.h5", "test")
    assert data.segment_samples == round(SEGMENT_SECONDS * 2200) and data.band == BIOTAC_BAND_HZ
    assert len(set(data.surface_ids)) == 3 and data.unit == "1"
    assert np.isnan(data.friction_coefficients).all() and np.allclose(data.speeds, 25)
    assert not set(data.surface_ids) & set(PreparedDataset(tmp_path / "p.h5", "train").surface_ids)


def test_made_up_slides(slides, tmp_path, capsys):
    check(slides, tmp_path, surfaces=6)
    assert "sensor counts, not newtons" in capsys.readouterr().out


@pytest.mark.skipif(not REAL.is_file(), reason="the BioTac slides are not beside the repository")
def test_real_slides(tmp_path):
    check(REAL, tmp_path, surfaces=15)


def test_another_file_is_refused(tmp_path):
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = 1
    with pytest.raises(ValueError, match="other.h5 has no `sampling_rate_hz`"):
        convert_biotac(tmp_path / "other.h5", tmp_path / "r.h5", quiet=True)

"""Recordings of lateral force only, unrated: both scripts train, and what nobody knew stays unknown."""

import numpy as np
import pytest
import torch

from tactile_diffusers import TactileTexturePipeline
from tactile_diffusers.data import PreparedDataset, RecordingsWriter, SegmentLimits, prepare_recordings
from tactile_diffusers.export import write_npz

SECONDS = 0.2048


@pytest.fixture
def lateral_only(tmp_path):
    recordings, prepared = tmp_path / "recordings.h5", tmp_path / "prepared.h5"
    rng = np.random.default_rng(0)
    with RecordingsWriter(recordings, source="a test", licence="CC0-1.0") as writer:
        for surface in range(5):
            lateral = 0.3 + 0.01 * rng.standard_normal(30_000)
            writer.add_recording(f"surface-{surface}", "explorer", "0", lateral=lateral, lateral_rate=10_000)
    report = prepare_recordings(recordings, prepared, SegmentLimits(seconds=SECONDS), validation=1, test=1, quiet=True)
    return report, prepared


def test_everything_up_to_the_exported_file(lateral_only, script, run_script, tmp_path, capsys):
    report, prepared = lateral_only
    notes = " ".join(report.notes)
    assert "limits of normal_force" in notes and "limits of speed" in notes and "friction coefficient is NaN" in notes
    data = PreparedDataset(prepared, "train")
    assert np.isnan(data.friction_coefficients).all() and np.isnan(data.speeds).all() and len(data) > 20

    changes = {"train_data_dir": prepared, "max_train_steps": 2}
    lctg = run_script(script("train_lctg"), "lctg", tmp_path / "lctg", subset="full", **changes)
    run_script(script("train_dale"), "dale", tmp_path / "pipe", pretrained_model_name_or_path=lctg, **changes)
    assert "No surface is rated" in capsys.readouterr().out

    pipe = TactileTexturePipeline.from_pretrained(str(tmp_path / "pipe"))
    pipe.set_progress_bar_config(disable=True)
    assert pipe.dale.config.log_friction_mean is None and pipe.dale.config.reference_speed is None
    out = pipe(None, num_inference_steps=2, generator=torch.Generator().manual_seed(0))
    assert np.isfinite(out.textures).all() and np.isfinite(out.level).all()
    assert np.isnan(out.friction_coefficient).all() and np.isnan(out.reference_speed)
    write_npz(
        tmp_path / "texture.npz",
        out.textures[0],
        sampling_rate=out.sampling_rate,
        friction_coefficient=float(out.friction_coefficient[0]),
        ratings=np.full(3, np.nan),
        seed=0,
        reference_speed=out.reference_speed,
    )
    assert np.isnan(np.load(tmp_path / "texture.npz")["friction_coefficient"])

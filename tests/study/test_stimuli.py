"""Stimuli of a tiny pipeline: levels, blindness, determinism, refusals."""

import json

import numpy as np
import pytest
from study import (
    BASELINES,
    StimulusSettings,
    make_stimuli,
    make_study,
    participant_trials,
    read_study,
)
from study.stimuli import choose_takes

from tactile_diffusers.data import PreparedDataset, SegmentLimits, prepare_recordings
from tactile_diffusers.signal import RATING_AXES, rms
from tactile_diffusers.virtual import generate_recordings

SETTINGS = StimulusSettings(surfaces=3, baselines=("mean_spectrum",))


@pytest.fixture(scope="module")
def prepared(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    generate_recordings(folder / "r.h5", surfaces=9, seconds=15, explorers=2, seed=4, quiet=True)
    limits = SegmentLimits(seconds=2048 / 2500)  # those of `evaluable_pipe`
    prepare_recordings(folder / "r.h5", folder / "p.h5", limits=limits, validation=1, test=4, quiet=True)
    return folder / "p.h5"


@pytest.fixture(scope="module")
def tiny_pipe(make_pipeline):
    return make_pipeline(True, 0, {"latent_frames": 128}, {"segment_samples": 2048})


@pytest.fixture(scope="module")
def stimuli(tiny_pipe, prepared):
    """A function of changed settings."""
    return lambda **changes: make_stimuli(tiny_pipe, prepared, StimulusSettings(**{**vars(SETTINGS), **changes}))


@pytest.fixture(scope="module")
def study(tiny_pipe, prepared, tmp_path_factory):
    """Nobody writes to it."""
    folder = tmp_path_factory.mktemp("made") / "study"
    return make_study(tiny_pipe, prepared, folder, SETTINGS, participants=2, checkpoint="tiny")


def test_textures_of_a_surface_have_one_level(stimuli):
    made = stimuli()
    key = made.key
    assert len(key) == 2 * 3 * 5 and made.attenuation_db == 0  # copies, surfaces, conditions
    np.testing.assert_allclose(rms(made.textures), key["rms_n"], rtol=1e-12)
    for _, rows in key.groupby("surface"):
        np.testing.assert_allclose(rows["rms_n"], rows["rms_n"].iloc[0], rtol=1e-9)  # float64
        assert rows["friction_coefficient"].nunique(dropna=False) == 1
    assert np.abs(made.textures).max() == pytest.approx(made.full_scale)
    np.testing.assert_array_equal(made.textures[: len(key) // 2], made.textures[len(key) // 2 :])
    assert (key.loc[key["condition"] == "reference", "gain_db"] == 0).all()


def test_natural_levels_are_kept(stimuli, prepared):
    made = stimuli(level="natural")
    assert (made.key["gain_db"] == 0).all()
    dataset = PreparedDataset(prepared, "test")
    rows, others = choose_takes(dataset, 3, 0)
    for condition, indices in (("reference", rows), ("other_take", others)):
        places = made.key.index[(made.key["condition"] == condition) & (made.key["copy_of"] == "")]
        np.testing.assert_array_equal(made.textures[places], dataset.textures(indices))
    assert made.key.loc[made.key["surface"] == made.key["surface"][0], "rms_n"].nunique() > 2


def test_takes_are_far_apart_in_ratings_and_share_no_sample(prepared):
    dataset = PreparedDataset(prepared, "test")
    rows, others = choose_takes(dataset, 3, seed=0)
    assert (dataset.surface_ids[rows] == dataset.surface_ids[others]).all()
    assert len(set(dataset.surface_ids[rows])) == 3
    apart = np.abs(dataset.starts[rows] - dataset.starts[others]) >= dataset.segment_samples
    assert (apart | (dataset.recording_ids[rows] != dataset.recording_ids[others])).all()
    surfaces = np.unique(dataset.surface_ids)
    ratings = dataset.ratings.mean[surfaces]
    extreme = surfaces[np.argmax(np.linalg.norm(ratings - ratings.mean(0), axis=-1))]
    assert extreme in dataset.surface_ids[rows]


def test_files_are_blind(study):
    """Names, sidecars and arrays of conditions differ in the waveform alone."""
    key, folder = study.key, study.folder / "stimuli"
    ids = set(key["id"])
    assert len(ids) == len(key) == 30 and all(len(name) == 6 and name.isalpha() for name in ids)
    assert {path.name for path in folder.iterdir()} == {f"{i}{e}" for i in ids for e in (".wav", ".wav.json", ".npz")}
    sidecars = [json.loads((folder / f"{name}.wav.json").read_text()) for name in ids]
    for sidecar in sidecars:
        assert sidecar["ratings"] == [None] * 3 and sidecar["seed"] == 0
        assert sidecar["newtons_per_full_scale"] == sidecars[0]["newtons_per_full_scale"]
    assert len({(folder / f"{name}.wav").stat().st_size for name in ids}) == 1
    arrays = [np.load(folder / f"{name}.npz") for name in ids]
    assert len({float(array["reference_speed"]) for array in arrays}) == 1
    public = [path for path in study.folder.rglob("*") if path.is_file() and path.parent.name != "experimenter"]
    for path in public:
        assert not any(surface.encode() in path.read_bytes() for surface in key["surface"].unique()), path
    abx = participant_trials(key, 1, seed=0, tasks=["abx"])
    assert not set(abx["stimulus_x"]) & {*abx["stimulus_a"], *abx["stimulus_b"]}
    # order of the ids tells nothing: conditions are mixed in the alphabet
    ordered = key.sort_values("id")["condition"].tolist()
    assert ordered != sorted(ordered) and (study.folder / "protocol.md").is_file()


def test_the_same_seed_makes_the_same_study(study, evaluable_pipe, prepared, tmp_path):
    again = make_study(evaluable_pipe(), prepared, tmp_path / "again", SETTINGS, participants=2, checkpoint="tiny")
    files = sorted(path.relative_to(study.folder) for path in study.folder.rglob("*") if path.is_file())
    assert files == sorted(path.relative_to(again.folder) for path in again.folder.rglob("*") if path.is_file())
    for path in files:
        if path.suffix != ".npz":  # archives hold the time of writing
            assert (study.folder / path).read_bytes() == (again.folder / path).read_bytes(), path


def test_a_study_is_read_again(study):
    read = read_study(study.folder)
    assert read.settings == study.settings
    for name in ("id", "copy_of", "surface", "condition", "recording"):
        assert read.key[name].tolist() == study.key[name].tolist()
    for name in (*(f"asked_{axis}" for axis in RATING_AXES), "rms_n", "gain_db", "friction_coefficient"):
        np.testing.assert_allclose(read.key[name], study.key[name], rtol=1e-12)
    text = (study.folder / "protocol.md").read_text()
    assert "Nothing here is a human result" in text and "ethics board" in text


def test_what_cannot_be_made_is_refused(evaluable_pipe, prepared, tmp_path):
    with pytest.raises(ValueError, match="has no DALE"):
        make_stimuli(evaluable_pipe(dale=False), prepared, SETTINGS)
    with pytest.raises(ValueError, match="`surfaces` must be at most"):
        make_stimuli(evaluable_pipe(), prepared, StimulusSettings(surfaces=5))
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "file").write_text("")
    with pytest.raises(ValueError, match="must be a new or an empty folder"):
        make_study(evaluable_pipe(), prepared, tmp_path / "full", SETTINGS)
    with pytest.raises(ValueError, match="`tasks` must be"):
        make_study(evaluable_pipe(), prepared, tmp_path / "new", SETTINGS, tasks=["taste"])
    assert not (tmp_path / "new").exists()
    with pytest.raises(FileNotFoundError, match="make a study first"):
        read_study(tmp_path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"surfaces": 1}, "`surfaces` must be at least 2"),
        ({"baselines": ("silence",)}, "`baselines` must be different ones"),
        ({"level": "loud"}, "`level` must be one of"),
        ({"full_scale": 0.0}, "`full_scale` must be a finite number above 0 in N"),
        ({"seed": -1}, "`seed` must be a whole number of at least 0"),
    ],
)
def test_bad_settings_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        StimulusSettings(**changes)


def test_every_baseline_that_is_offered_can_be_made(stimuli):
    made = stimuli(baselines=BASELINES)
    assert set(BASELINES) < set(made.key["condition"]) and np.isfinite(made.textures).all()


def test_the_key_tells_where_textures_come_from(stimuli):
    key = stimuli(level="natural").key
    real = key["condition"].isin(["reference", "other_take"])
    assert (key["recording"] != "").equals(real)
    assert all(name.startswith(f"{s}/") for name, s in key.loc[real, ["recording", "surface"]].to_numpy())
    generated = key[(key["condition"] == "generated") & (key["copy_of"] == "")]
    assert generated["seed"].nunique() == 3 and (generated["reference_speed"] == 80).all()  # of a DALE by default


def test_a_failure_leaves_no_half_of_a_study(evaluable_pipe, prepared, tmp_path, monkeypatch):
    monkeypatch.setattr("study.folder.protocol_markdown", lambda facts: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        make_study(evaluable_pipe(), prepared, tmp_path / "study", SETTINGS, participants=1)
    assert not list(tmp_path.iterdir())

"""Text files: layouts, ratings, profiles and calibrations of displays, studies, what a training leaves behind.

Text tables have no length: one that was cut passes for a shorter one, unless the end of a row is missing.
"""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from dataset.ratings import read_ratings_file
from study.folder import FORMAT, KEY, KEY_COLUMNS, SETTINGS, VERSION, read_study
from study.trials import read_tables

from tactile_diffusers.data.folder import load_layout
from tactile_diffusers.data.folder.rating_tables import read_ratings
from tactile_diffusers.display import DriveProfile
from tactile_diffusers.display.drive_files import read_drive_calibration
from tactile_diffusers.signal import RATING_AXES
from tactile_diffusers.training.launch import read_model_config

CONFIG = SimpleNamespace(rating_axes=list(RATING_AXES))
LAYOUT = """format = "tactile-layout"
version = 1
source = "a test"
licence = "CC0-1.0"

[[files]]
pattern = "{surface}.csv"
rate = 5000
lateral = { column = "fx", unit = "N" }

[ratings]
pattern = "answers.csv"
form = "long"
rater = "rater"
surface = "surface"
scale = [0, 8]
[ratings.axes]
roughness = { column = "rough", high = "rough" }
"""


def _layout(path):
    layout = load_layout(path)
    return [len(layout.files), layout.files[0].rate]


def _answers(path):
    scores, _ = read_ratings(path.parent, load_layout(path.with_name("layout.toml")), ("a", "b"))
    return np.nan_to_num(scores.values)


def _profile(path):
    profile = DriveProfile.load(path.with_name("profile.json"))
    return [profile.gain, profile.offset, profile.cutoffs, profile.max_drive, profile.lookup]


def _calibration(path):
    found = read_drive_calibration(path.with_name("calibration.json"))
    return [found["command"], found["measured"], found["sampling_rate"]]


def _study(path):
    study = read_study(path.parents[1])
    return [study.key["rms_n"].to_numpy(), study.key["seed"].to_numpy()]


def _responses(path):
    table = read_tables(path.parent)
    return [len(table)]


def _dataset_ratings(path):
    return np.nan_to_num(read_ratings_file(path, CONFIG, 12))


#: Kind -> (name of the file, reader, whether a cut one can be noticed).
KINDS = {
    "layout": ("folder/layout.toml", _layout, False),
    "answers": ("folder/answers.csv", _answers, False),
    "profile": ("display/profile.json", _profile, True),
    "lookup": ("display/profile.lookup.csv", _profile, False),
    "calibration": ("display/calibration.json", _calibration, True),
    "calibration recording": ("display/strokes.csv", _calibration, False),
    "study settings": (f"study/{SETTINGS}", _study, True),
    "study key": (f"study/{KEY}", _study, False),
    "responses": ("responses/p001.csv", _responses, False),
    "ratings csv": ("ratings/ratings.csv", _dataset_ratings, False),
    "ratings json": ("ratings/ratings.json", _dataset_ratings, True),
    "ratings npy": ("ratings/ratings.npy", _dataset_ratings, True),
    "model config": ("config/model.json", lambda path: len(read_model_config(path, {"lctg", "dale"})), True),
}


def _write_display(folder):
    amplitudes = np.linspace(0, 1, 6)
    table = np.stack([amplitudes, 0.2 * amplitudes], axis=1)
    profile = DriveProfile(
        kind="ultrasonic", gain=1.0, offset=0.3, cutoffs=[(80.0, 300.0)], max_drive=1.0, normal_force=0.5, lookup=table
    )
    profile.save(folder / "profile.json")
    (folder / "strokes.csv").write_text("drive,lateral_force\n" + "".join(f"0.{i},0.2{i}\n" for i in range(9)))
    units = {"force": "N", "speed": "mm/s", "frequency": "Hz", "drive": "1"}
    about = {"kind": "ultrasonic", "sampling_rate": 10_000, "normal_force": 0.5, "speed": 80.0}
    about |= {"format": "tactile-drive-calibration", "version": 1, "units": units, "recording": "strokes.csv"}
    (folder / "calibration.json").write_text(json.dumps({**about, "lookup": "profile.lookup.csv"}, indent=1))


def _write_study(folder):
    (folder / SETTINGS).parent.mkdir()
    (folder / SETTINGS).write_text(json.dumps({"format": FORMAT, "version": VERSION, "seed": 0}))
    words, names = ("id", "surface", "condition", "copy_of", "recording"), [*KEY_COLUMNS, "asked_roughness"]
    rows = [",".join(f"w{row}" if name in words else str(row) for name in names) for row in range(4)]
    (folder / KEY).write_text("\n".join([",".join(names), *rows]) + "\n")


@pytest.fixture(scope="module")
def texts(tmp_path_factory):
    root = tmp_path_factory.mktemp("texts")
    for name in ("folder", "display", "study", "responses", "ratings", "config"):
        (root / name).mkdir()
    (root / "folder" / "layout.toml").write_text(LAYOUT)
    (root / "folder" / "answers.csv").write_text("rater,surface,rough\nr,a,3\nr,b,5\ns,a,2\ns,b,7\n")
    _write_display(root / "display")
    _write_study(root / "study")
    rows = [f"p001,{trial},rating,x,,,roughness,5" for trial in range(1, 7)]
    header = "participant,trial,task,stimulus_a,stimulus_b,stimulus_x,axis,response"
    (root / "responses" / "p001.csv").write_text("\n".join([header, *rows]) + "\n")
    ratings = np.round(np.random.default_rng(0).uniform(-2, 2, (4, 3)), 3)
    (root / "ratings" / "ratings.csv").write_text(
        "\n".join([",".join(RATING_AXES), *(",".join(map(str, row)) for row in ratings)]) + "\n"
    )
    (root / "ratings" / "ratings.json").write_text(json.dumps(ratings.tolist()))
    np.save(root / "ratings" / "ratings.npy", ratings)
    (root / "config" / "model.json").write_text(json.dumps({"lctg": {"widths": [8, 16]}, "dale": {"widths": [32]}}))
    return root


def _sane(result):
    """NaN is an empty cell of a study's key, infinity nothing."""
    parts = result if isinstance(result, list) else [result]
    return not any(np.isinf(np.asarray(part, dtype=float)).any() for part in parts if part is not None)


@pytest.mark.parametrize("kind", KINDS)
def test_damage(kind, texts, damaged, flips, foreign):
    name, read, whole = KINDS[kind]
    if kind == "ratings json":  # the one that is a list
        del foreign["json list"]
    case = damaged(texts / name, read, sane=_sane, whole=whole, root=texts / name.split("/")[0])
    case.damage(flips, foreign.values())


@pytest.mark.parametrize("kind", ["profile", "calibration", "study settings"])
def test_a_key_is_missing_or_odd(kind, texts, damaged, refusal, odd_values):
    name, read, _ = KINDS[kind]
    case = damaged(texts / name, read, root=texts / name.split("/")[0])
    content = json.loads(case.content)
    for key in content:
        for odd in odd_values:
            changed = {other: value for other, value in content.items() if other != key or odd != "missing"}
            changed |= {} if odd == "missing" else {key: odd}
            result, message = refusal(read, case.put(json.dumps(changed).encode()))
            assert message or case.sane(result), (key, odd)


@pytest.mark.parametrize(
    "text",
    [
        "a = " + "[" * 100_000 + "]" * 100_000,
        "a." * 100_000 + "a = 1",
        "version = 1" + "0" * 100_000,
        LAYOUT.replace("5000", "inf"),
        LAYOUT.replace("5000", "1e400"),
        LAYOUT.replace('"{surface}.csv"', '"{surface}' + "*" * 10_000 + '.csv"'),
    ],
    ids=["nested", "dotted", "long number", "infinite", "overflowing", "stars"],
)
def test_an_absurd_layout(text, texts, damaged, refusal):
    case = damaged(texts / "folder" / "layout.toml", _layout)
    result, message = refusal(_layout, case.put(text.encode()))
    assert message or "*****" in text

"""The generate command: its arguments, its call of the pipeline and its files, with a pipeline that only records."""

import json
import math
import re
import warnings
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import tactile_diffusers
from tactile_diffusers import bundled_checkpoint
from tactile_diffusers.cli.generate import main, parse_arguments
from tactile_diffusers.pipelines import PRESETS

#: a small checkpoint of an earlier version, with the typical rater's statistics but without quantiles
AXES = ("roughness", "bumpiness", "slipperiness")
TINY = Path(__file__).parents[1] / "fixtures" / "tiny_pipeline"


class RecordingPipeline:
    """Stands in for `TactileTexturePipeline`: keeps the call, returns noise drawn from the generators."""

    def __init__(self):
        self.call = None
        self.folder = None
        self.progress_bar = {}
        self.error = None
        self.dale = SimpleNamespace(config=SimpleNamespace(rating_axes=AXES))

    def from_pretrained(self, folder):
        self.folder = folder
        return self

    def set_progress_bar_config(self, **options):
        self.progress_bar = options

    def __call__(self, ratings, *, num_textures_per_rating, generator, **options):
        import torch

        self.call = {"ratings": ratings, "num_textures_per_rating": num_textures_per_rating, **options}
        if self.error is not None:
            raise self.error
        generators = generator if isinstance(generator, list) else [generator]
        textures = [0.01 * torch.randn(2000, generator=one).numpy() for one in generators]
        assert len(textures) == num_textures_per_rating
        return SimpleNamespace(
            textures=np.stack(textures),
            friction_coefficient=np.full(len(textures), 0.5, dtype=np.float32),
            sampling_rate=10000,
            reference_speed=80.0,
        )


@pytest.fixture
def pipeline(monkeypatch):
    recorder = RecordingPipeline()
    monkeypatch.setattr(tactile_diffusers, "TactileTexturePipeline", recorder, raising=False)
    return recorder


def _parse(*arguments):
    return parse_arguments([*arguments, "--output", "out"])


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("--ratings 1.5 0 -1", [1.5, 0, -1]),
        ("--ratings -1.5 -.5 -2", [-1.5, -0.5, -2]),
        ("--ratings 1.5 nan -1", [1.5, math.nan, -1]),
        ("--ratings none 0 -1", [math.nan, 0, -1]),
        ("--bumpiness -1.2", [math.nan, -1.2, math.nan]),
        ("--roughness 1 --bumpiness 2 --slipperiness -1", [1, 2, -1]),
        ("--preset denim", list(PRESETS["denim"])),
        ("--bumpiness 1 --rating_scale percentile", [math.nan, 1, math.nan]),
    ],
)
def test_ratings_by_row_by_axis_or_by_name(words, expected):
    ratings = _parse(*words.split()).ratings
    np.testing.assert_array_equal([ratings.get(axis, math.nan) for axis in AXES], expected)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "give either --ratings, or --preset, or one or more of --roughness, --bumpiness, --slipperiness"),
        (["--ratings", "1", "0", "0", "--roughness", "1"], "give either --ratings, or"),
        (["--preset", "denim", "--roughness", "1"], "give either --ratings, or"),
        (["--preset", "denim", "--rating_scale", "raw"], "argument --rating_scale: leave it out"),
        (["--ratings", "1", "0", "rough"], "must be a number, or none = not specified, got 'rough'"),
        (["--roughness", "1", "--num_textures_per_rating", "0"], "must be at least 1, got 0"),
        (["--roughness", "1", "--seed", "9223372036854775808"], "argument --seed"),
        (["--roughness", "1", "--num_inference_steps", "ten"], "argument --num_inference_steps: invalid int value"),
        (["--roughness", "1", "--checkpoint", "no such folder"], "no such folder is neither a folder"),
    ],
)
def test_bad_arguments_are_refused_with_one_line(capsys, arguments, message):
    with pytest.raises(SystemExit) as stop:
        _parse(*arguments)
    assert stop.value.code == 2
    assert message in capsys.readouterr().err.splitlines()[-1]


def test_one_take_writes_its_files(pipeline, tmp_path, capsys):
    output = tmp_path / "new" / "out"
    assert main(["--ratings", "1.5", "0", "-1", "--output", str(output)]) == 0
    names = [f"texture{suffix}" for suffix in (".npz", ".png", ".wav", ".wav.json")]
    assert sorted(path.name for path in output.iterdir()) == names
    # what was not asked for is left to the pipeline
    common = {"num_textures_per_rating": 1, "rating_scale": "z", "guidance_scale": 1.0}
    assert pipeline.call == {"ratings": dict(zip(AXES, (1.5, 0, -1), strict=True)), **common}
    assert pipeline.folder == bundled_checkpoint()
    with np.load(output / "texture.npz") as file:
        assert (file["seed"], file["sampling_rate"], file["reference_speed"]) == (0, 10000, 80)
        assert file["checkpoint"] == "virtual-surfaces"
        np.testing.assert_array_equal(file["ratings"], [1.5, 0, -1])
        rms = np.sqrt(np.mean(file["texture"].astype(np.float64) ** 2))
    printed = capsys.readouterr().out
    expected = (*("texture.npz", "texture.wav", "texture.png"), f"RMS {1e3 * rms:.2f} mN", "friction coefficient 0.50")
    assert all(text in printed for text in expected)


def test_options_are_passed_on(pipeline, tmp_path, capsys):
    words = "--roughness=1 --num_inference_steps=4 --num_latent_inference_steps=6 --guidance_scale=2.5 --duration_s=3"
    words += f" --checkpoint {tmp_path} --output {tmp_path / 'out'} --quiet"
    assert main(words.split()) == 0
    assert pipeline.folder == str(tmp_path)
    assert pipeline.progress_bar == {"disable": True}
    del pipeline.call["ratings"]
    assert pipeline.call == {
        "num_textures_per_rating": 1,
        "rating_scale": "z",
        "num_inference_steps": 4,
        "num_latent_inference_steps": 6,
        "guidance_scale": 2.5,
        "duration_s": 3.0,
    }
    assert capsys.readouterr().out == ""


def test_the_seed_in_each_file_makes_that_take_again(pipeline, tmp_path):
    assert main(["--roughness", "1", "--num_textures_per_rating", "3", "--seed", "40", "--output", str(tmp_path)]) == 0
    assert sorted(path.name for path in tmp_path.glob("*.npz")) == [f"texture_{take:03d}.npz" for take in range(3)]
    assert [path.name for path in tmp_path.glob("*.png")] == ["texture_000.png"]
    with np.load(tmp_path / "texture_002.npz") as third:
        assert third["seed"] == 42
        main(["--roughness", "1", "--seed", "42", "--quiet", "--output", str(tmp_path)])
        with np.load(tmp_path / "texture.npz") as again:
            np.testing.assert_array_equal(third["texture"], again["texture"])


@pytest.mark.parametrize("error", [ValueError("`ratings` must lie\nwithin ±6."), OSError("no weights")])
def test_a_refusal_is_one_line_and_writes_nothing(pipeline, tmp_path, capsys, error):
    pipeline.error = error
    assert main(["--ratings", "9", "0", "0", "--output", str(tmp_path / "out")]) == 2
    printed = capsys.readouterr()
    assert printed.err == f"generate.py: error: {' '.join(str(error).split())}\n"
    assert printed.out == ""
    assert not (tmp_path / "out").exists()


def test_the_rating_scale_is_passed_on_and_files_hold_z_scores(pipeline, tmp_path, capsys):
    statistics = {"mean": [4.0, 3.0, 5.0], "std": [2.0, 1.0, 1.0]}
    pipeline.dale = SimpleNamespace(config=SimpleNamespace(rating_axes=AXES, rating_statistics=statistics))
    assert main(["--ratings", "7", "nan", "4", "--rating_scale", "raw", "--output", str(tmp_path)]) == 0
    asked = pipeline.call.pop("ratings")
    assert (asked["roughness"], asked["slipperiness"]) == (7, 4) and math.isnan(asked["bumpiness"])
    assert pipeline.call == {"num_textures_per_rating": 1, "rating_scale": "raw", "guidance_scale": 1.0}
    with np.load(tmp_path / "texture.npz") as file:
        np.testing.assert_allclose(file["ratings"], [1.5, np.nan, -1.0])
    assert json.loads((tmp_path / "texture.wav.json").read_text())["ratings"] == [1.5, None, -1.0]
    assert "ratings in z-scores: roughness 1.50, bumpiness nan, slipperiness -1.00" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--ratings", "9", "4", "4", "--rating_scale", "raw"], "between 0 and 8 .* got roughness = 9.0"),
        (["--bumpiness", "-1", "--rating_scale", "raw"], "between 0 and 8 .* got bumpiness = -1.0"),
        (["--ratings", "7", "4", "4"], "z-scores between -6 and 6 .* got roughness = 7.0"),
        (["--roughness", "50", "--rating_scale", "percentile"], r"needs \['quantiles'\]"),
    ],
)
def test_the_check_of_ratings_follows_the_scale(tmp_path, capsys, arguments, message):
    assert main([*arguments, "--checkpoint", str(TINY), "--output", str(tmp_path / "out"), "--quiet"]) == 2
    assert re.match(f"generate.py: error: .*{message}", capsys.readouterr().err.splitlines()[-1])
    assert not (tmp_path / "out").exists()


def test_guidance_that_makes_levels_explode_is_refused_in_a_line(tmp_path, capsys):
    words = ["--ratings", "1", "0", "0", "--guidance_scale", "1e30", "--num_inference_steps", "2", "--quiet"]
    with warnings.catch_warnings(action="error", category=RuntimeWarning):
        assert main([*words, "--checkpoint", str(TINY), "--output", str(tmp_path / "out")]) == 2
    assert "generate.py: error: Textures overflow" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_an_axis_by_its_name():
    assert _parse("--rating", "fineness", "1.5", "--roughness", "1").ratings == {"roughness": 1.0, "fineness": 1.5}
    with pytest.raises(SystemExit):
        _parse("--rating", "fineness", "much")
    with pytest.raises(SystemExit):
        _parse("--ratings", "1", "0", "0", "--rating", "roughness", "1")


@pytest.mark.parametrize(
    "words", ["--roughness 1", "--ratings 1 0 0", "--preset denim", "--preset denim --rating soft 1"]
)
def test_a_checkpoint_with_a_further_axis_takes_every_way_of_asking(pipeline, tmp_path, monkeypatch, words):
    titles = []
    monkeypatch.setattr("matplotlib.figure.Figure.suptitle", lambda self, title, **_: titles.append(title))
    pipeline.dale.config = SimpleNamespace(rating_axes=(*AXES, "soft"), rating_statistics=None)
    assert main([*words.split(), "--output", str(tmp_path)]) == 0
    asked = pipeline.call["ratings"]
    assert asked["roughness"] in (1, PRESETS["denim"][0]) and asked.get("soft") == (1 if "soft" in words else None)
    assert ("soft +1" if "soft" in words else "soft not specified") in titles[0]
    with np.load(tmp_path / "texture.npz") as file:
        assert len(file["ratings"]) == 4

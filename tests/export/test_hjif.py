"""MPEG haptics: the schemas take the files, and key frames lie where they should."""

import json
from pathlib import Path

import numpy as np
import pytest

from tactile_diffusers.export import write_hjif
from tactile_diffusers.export.hjif import SPATIAL, TEMPORAL
from tactile_diffusers.signal import DEVICE_RATE

SCHEMAS = Path(__file__).parents[2].parent / "shared/data/mpeg_haptics_schemas"
COMMON = {"sampling_rate": DEVICE_RATE, "friction_coefficient": 0.6, "reference_speed": 81.37, "seed": 0}
COMMON["ratings"] = [1.5, float("nan"), -1.0]


@pytest.fixture
def texture(pink_noise):
    return pink_noise(4000, DEVICE_RATE)[0]


def _write(path, texture, **changes):
    write_hjif(path, texture, **{**COMMON, **changes})
    return json.loads(path.read_text())


@pytest.mark.skipif(not SCHEMAS.is_dir(), reason="the MPEG haptics schemas are not beside the repository")
@pytest.mark.parametrize("modality", TEMPORAL + SPATIAL)
def test_the_schemas_take_it(tmp_path, texture, modality):
    from jsonschema import Draft4Validator
    from referencing import Registry, Resource
    from referencing.jsonschema import DRAFT4

    schemas = {path.name: json.loads(path.read_text(encoding="utf-8")) for path in SCHEMAS.glob("*.schema.json")}
    resources = [(name, Resource.from_contents(schema, DRAFT4)) for name, schema in schemas.items()]
    validator = Draft4Validator(
        schemas["MPEG_haptics.schema.json"],
        registry=Registry().with_resources(resources),
        format_checker=Draft4Validator.FORMAT_CHECKER,
    )
    experience = _write(tmp_path / "a.hjif", texture, modality=modality)
    assert not [error.message for error in validator.iter_errors(experience)]
    # and they would find a fault as deep as it lies
    experience["perceptions"][0]["channels"][0]["bands"][0]["effects"][0]["keyframes"][5]["amplitude_modulation"] = 1.5
    assert [error.message for error in validator.iter_errors(experience)]


@pytest.mark.parametrize(("modality", "timescale", "step"), [("Force", 8000, 1), ("Vibrotactile Texture", 81370, 10)])
def test_gain_times_key_frames_is_newtons(tmp_path, modality, timescale, step):
    """A player that takes position for time plays what is felt at the reference speed."""
    seconds = np.arange(4000) / DEVICE_RATE
    experience = _write(tmp_path / "a.hjif", 0.03 * np.cos(2 * np.pi * 100 * seconds), modality=modality)
    (perception,) = experience["perceptions"]
    (channel,) = perception["channels"]
    frames = channel["bands"][0]["effects"][0]["keyframes"]
    assert experience["timescale"] == timescale and perception["perception_modality"] == modality
    places = np.array([frame["relative_position"] for frame in frames])
    assert (np.diff(places) == step).all() and places[-1] / timescale < 0.4 <= (places[-1] + step) / timescale
    newtons = channel["gain"] * np.array([frame["amplitude_modulation"] for frame in frames])
    np.testing.assert_allclose(newtons, 0.03 * np.cos(2 * np.pi * 100 * places / timescale), atol=1e-5)
    assert (perception["unit_exponent"] == -6) == (modality in SPATIAL)


def test_friction_is_about_its_mean(tmp_path, texture):
    experience = _write(tmp_path / "a.hjif", texture, modality="Friction", normal_force=0.4)
    channel = experience["perceptions"][0]["channels"][0]
    frames = channel["bands"][0]["effects"][0]["keyframes"]
    friction = channel["gain"] * np.array([frame["amplitude_modulation"] for frame in frames])
    assert friction.mean() == pytest.approx(0.6, abs=1e-3)
    assert friction.std() == pytest.approx(texture.std() / 0.4, rel=0.01)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"modality": "Water"}, "`modality` must be one of Force, Friction, Vibrotactile Texture, got 'Water'"),
        ({"normal_force": 0.0}, "`normal_force` must be a finite number above 0 in N"),
        ({"modality": "Friction", "reference_speed": 5.0}, "`reference_speed` must be at least 8 mm/s"),
    ],
)
def test_bad_options_are_refused(tmp_path, texture, change, message):
    with pytest.raises(ValueError, match=message):
        _write(tmp_path / "a.hjif", texture, **change)
    assert not list(tmp_path.iterdir())

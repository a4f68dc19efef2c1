"""What is built without arguments is the bundled checkpoint, but for what is fitted to data or distilled."""

import json
from pathlib import Path

import pytest
import torch

from tactile_diffusers import DALEModel, LCTGModel, TactileFeatureExtractor, bundled_checkpoint

FITTED = {
    "lctg": {"modulation_gains"},
    "dale": {
        *("latent_mean", "latent_std", "departure_std", "size_mean", "size_std", "level_mean", "level_std"),
        *("log_friction_mean", "log_friction_std", "rating_statistics", "reference_speed"),
        *(
            "distilled_steps",
            "scalar_width",
            "calibration",
            "network_axes",
            "estimator_statistics",
        ),  # not its teacher's
    },
}


def _plain(values):
    return json.loads(json.dumps({name: value for name, value in values.items() if not name.startswith("_")}))


@pytest.mark.parametrize(("name", "cls"), [("lctg", LCTGModel), ("dale", DALEModel)])
def test_models_are_those_of_the_bundled_checkpoint(name, cls):
    ours, bundled = (_plain(config) for config in (cls().config, cls.load_config(bundled_checkpoint(), subfolder=name)))
    assert ours.keys() >= bundled.keys()  # what a checkpoint does not name has its default
    assert {key for key in bundled if ours[key] != bundled[key]} | (ours.keys() - bundled.keys()) <= FITTED[name]


def test_the_extractor_is_that_of_the_bundled_checkpoint():
    ours = _plain(TactileFeatureExtractor().to_dict())
    bundled = json.loads((Path(bundled_checkpoint()) / "feature_extractor/preprocessor_config.json").read_text())
    assert ours.keys() == bundled.keys()
    different = {key for key in ours if ours[key] != bundled[key]}
    assert different == {"preemphasis_frequencies", "preemphasis_db"}


def test_the_geometry_of_the_extractor_is_that_of_the_models():
    lctg, geometry = LCTGModel(), TactileFeatureExtractor().lctg_geometry
    assert {name: lctg.config[name] for name in geometry} == geometry
    assert DALEModel().latent_channels == lctg.base_channels


@pytest.mark.slow
@pytest.mark.parametrize("how", ["compile", "compile_repeated_blocks"])
@torch.no_grad()
def test_the_default_decoder_compiles_whole_for_several_batch_sizes(how, randomized):
    model = randomized(LCTGModel()).eval()
    inputs = [(torch.randn(n, 1, 4096), 500.0, torch.randn(n, 44, 64)) for n in (1, 2, 3, 5, 8)]
    expected = [model(*values).sample for values in inputs]
    torch._dynamo.reset()
    getattr(model, how)(fullgraph=True, backend="eager")
    for values, wanted in zip(inputs, expected, strict=True):
        torch.testing.assert_close(model(*values).sample, wanted, rtol=0, atol=1e-4)  # the order of sums
        conditions = model.condition(values[2], torch.tensor([500.0, 100.0]))
        torch.testing.assert_close(model(values[0], None, conditions[0]).sample, wanted, rtol=0, atol=1e-4)
    torch._dynamo.reset()

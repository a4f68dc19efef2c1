"""Saving and loading: the committed checkpoint, incomplete and mixed checkpoints."""

import json
import shutil

import numpy as np
import pytest
import torch

from tactile_diffusers import TactileTexturePipeline

COMPONENTS = ("lctg", "dale", "scheduler", "dale_scheduler", "feature_extractor")


@pytest.fixture
def saved(pipe, tmp_path):
    pipe.save_pretrained(str(tmp_path / "saved"))
    return tmp_path / "saved"


def test_configs_weights_and_textures_survive_saving(pipe, saved, seeded):
    again = TactileTexturePipeline.from_pretrained(str(saved))
    again.set_progress_bar_config(disable=True)
    for name in ("lctg", "dale", "scheduler", "dale_scheduler"):
        before, after = (json.loads(getattr(p, name).to_json_string()) for p in (pipe, again))
        assert [key for key in before if not key.startswith("_") and after[key] != before[key]] == []
    before, after = (json.loads(p.feature_extractor.to_json_string()) for p in (pipe, again))
    assert before == after
    for name in ("lctg", "dale"):
        before, after = (getattr(p, name).state_dict() for p in (pipe, again))
        assert all(torch.equal(value, after[key]) for key, value in before.items())
    first, second = (p([1.0, None, -1.0], 3, generator=seeded(5)).textures for p in (pipe, again))
    # weights are equal, but their place in memory may change the order of float32 sums
    np.testing.assert_allclose(second, first, rtol=0, atol=1e-5 * np.abs(first).max())


def test_committed_checkpoint_still_loads_and_makes_the_stored_texture(tiny_checkpoint, recorded_warnings):
    with recorded_warnings() as found:
        pipe = TactileTexturePipeline.from_pretrained(str(tiny_checkpoint))
    assert found == []
    pipe.set_progress_bar_config(disable=True)
    stored = np.load(tiny_checkpoint.parent / "tiny_texture.npz")
    out = pipe(
        stored["ratings"],
        num_inference_steps=int(stored["num_inference_steps"]),
        guidance_scale=float(stored["guidance_scale"]),
        generator=torch.Generator("cpu").manual_seed(int(stored["seed"])),
    )
    assert out.sampling_rate == stored["sampling_rate"] and out.reference_speed == stored["reference_speed"]
    # other processors and releases of torch sum float32 in another order, which four steps and the guidance amplify:
    # 1e-3 of the RMS allows for that, while another noise, formula or weight changes the texture by about 1 RMS
    atol = 1e-3 * np.sqrt(np.mean(stored["texture"] ** 2))
    np.testing.assert_allclose(out.textures[0], stored["texture"], rtol=0, atol=atol)
    np.testing.assert_allclose(out.level[0], stored["level"], rtol=1e-3)
    np.testing.assert_allclose(out.friction_coefficient[0], stored["friction_coefficient"], rtol=1e-3)


@pytest.mark.parametrize("component", COMPONENTS)
def test_checkpoint_without_a_component_folder_names_it(saved, component):
    shutil.rmtree(saved / component)
    with pytest.raises((OSError, ValueError), match=component):
        TactileTexturePipeline.from_pretrained(str(saved))


def test_folder_that_is_no_checkpoint_is_refused(tmp_path):
    (tmp_path / "empty").mkdir()
    with pytest.raises(OSError, match="model_index.json"):
        TactileTexturePipeline.from_pretrained(str(tmp_path / "empty"))


def test_a_dale_with_other_latent_channels_is_refused(pipe, make_dale):
    other = make_dale(in_channels=7, latent_mean=[0.0] * 5, latent_std=[1.0] * 5)
    with pytest.raises(ValueError, match="`dale` does not fit `lctg`"):
        TactileTexturePipeline(**{**pipe.components, "dale": other})


def test_folders_of_different_checkpoints_are_refused(saved, make_lctg):
    shutil.rmtree(saved / "lctg")
    make_lctg(latent_channels=5).save_pretrained(str(saved / "lctg"))
    with pytest.raises(ValueError, match="different checkpoints"):
        TactileTexturePipeline.from_pretrained(str(saved))


@pytest.mark.parametrize("shared", [True, False], ids=["one for both stages", "none for DALE"])
def test_dale_needs_a_scheduler_of_its_own(pipe, shared):
    with pytest.raises(ValueError, match="`dale_scheduler`"):
        TactileTexturePipeline(**{**pipe.components, "dale_scheduler": pipe.scheduler if shared else None})

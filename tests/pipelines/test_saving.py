"""Saving and loading: fresh processes, the committed checkpoint, the Hub, incomplete and mixed checkpoints."""

import hashlib
import json
import os
import shutil
import subprocess
import sys

import huggingface_hub
import numpy as np
import pytest
import torch

from tactile_diffusers import TactileTexturePipeline

COMPONENTS = ("lctg", "dale", "scheduler", "dale_scheduler", "feature_extractor")

LOAD_AND_GENERATE = """
import sys
import tactile_diffusers
pipe = tactile_diffusers.TactileTexturePipeline.from_pretrained(sys.argv[1])
import hashlib, numpy, torch
digest = hashlib.sha256()
for name in ("lctg", "dale"):
    for key, value in sorted(getattr(pipe, name).state_dict().items()):
        digest.update(key.encode() + value.contiguous().numpy().tobytes())
pipe.set_progress_bar_config(disable=True)
out = pipe([1.0, None, -1.0], num_inference_steps=3, generator=torch.Generator("cpu").manual_seed(5))
numpy.savez(sys.argv[2], texture=out.textures, friction=out.friction_coefficient, digest=digest.hexdigest())
"""


def weights_hash(pipe):
    digest = hashlib.sha256()
    for name in ("lctg", "dale"):
        for key, value in sorted(getattr(pipe, name).state_dict().items()):
            digest.update(key.encode() + value.contiguous().numpy().tobytes())
    return digest.hexdigest()


@pytest.fixture
def saved(pipe, tmp_path):
    pipe.save_pretrained(str(tmp_path / "saved"))
    return tmp_path / "saved"


def test_fresh_process_that_only_imports_the_package_makes_the_same_texture_silently(pipe, saved, seeded, tmp_path):
    script = tmp_path / "load_and_generate.py"
    script.write_text(LOAD_AND_GENERATE)
    done = subprocess.run(
        [sys.executable, str(script), str(saved), str(tmp_path / "made.npz")],
        capture_output=True,
        text=True,
        env={**os.environ, "HF_HUB_OFFLINE": "1"},
        cwd=tmp_path,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    # diffusers' bar of loaded components is the only thing that may be written
    pieces = done.stderr.replace("\r", "\n").splitlines()
    assert [p for p in pieces if p.strip() and not p.startswith("Loading pipeline components")] == []
    made = np.load(tmp_path / "made.npz")
    assert str(made["digest"]) == weights_hash(pipe)
    expected = pipe([1.0, None, -1.0], num_inference_steps=3, generator=seeded(5))
    # weights are equal, but their place in memory may change the order of float32 sums: 1e-5 of the RMS
    atol = 1e-5 * np.sqrt(np.mean(expected.textures**2))
    np.testing.assert_allclose(made["texture"], expected.textures, rtol=0, atol=atol)
    np.testing.assert_allclose(made["friction"], expected.friction_coefficient, rtol=1e-5)


def test_model_index_names_the_package_and_not_files_that_may_move(saved):
    index = json.loads((saved / "model_index.json").read_text())
    assert {name: index[name][0] for name in COMPONENTS} == dict.fromkeys(COMPONENTS, "tactile_diffusers")
    assert index["_class_name"] == "TactileTexturePipeline"


def test_every_config_value_survives_saving(pipe, saved):
    again = TactileTexturePipeline.from_pretrained(str(saved))
    for name in ("lctg", "dale", "scheduler", "dale_scheduler"):
        before, after = (json.loads(getattr(p, name).to_json_string()) for p in (pipe, again))
        for key in before:
            if not key.startswith("_"):
                assert after[key] == before[key], (name, key)
    before, after = pipe.feature_extractor.to_dict(), again.feature_extractor.to_dict()
    assert {k: list(v) if isinstance(v, tuple) else v for k, v in before.items()} == {
        k: list(v) if isinstance(v, tuple) else v for k, v in after.items()
    }


def test_half_precision_under_plain_names_loads_as_float32_without_a_warning(
    make_pipeline, tmp_path, recorded_warnings
):
    half = make_pipeline()
    half.to(torch.float16)
    half.save_pretrained(str(tmp_path / "half"))
    with recorded_warnings() as found:
        again = TactileTexturePipeline.from_pretrained(str(tmp_path / "half"))
    assert found == []
    assert again.lctg.dtype == again.dale.dtype == torch.float32
    expected = half.dale.state_dict()
    for key, value in again.dale.state_dict().items():
        assert torch.equal(value, expected[key].float()), key


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


def test_committed_checkpoint_is_small(tiny_checkpoint):
    files = [path for path in tiny_checkpoint.parent.rglob("*") if path.is_file() and path.suffix != ".pyc"]
    assert sum(path.stat().st_size for path in files) < 1_000_000


@pytest.mark.parametrize("component", COMPONENTS)
def test_checkpoint_without_a_component_folder_names_it(saved, component):
    shutil.rmtree(saved / component)
    with pytest.raises((OSError, ValueError), match=component):
        TactileTexturePipeline.from_pretrained(str(saved))


def test_folder_that_is_no_checkpoint_is_refused(tmp_path):
    (tmp_path / "empty").mkdir()
    with pytest.raises(OSError, match="model_index.json"):
        TactileTexturePipeline.from_pretrained(str(tmp_path / "empty"))


def test_pipeline_without_dale_saves_and_loads_without_a_warning(make_pipeline, tmp_path, recorded_warnings):
    make_pipeline(dale=False).save_pretrained(str(tmp_path / "decoder"))
    with recorded_warnings() as found:
        again = TactileTexturePipeline.from_pretrained(str(tmp_path / "decoder"))
    assert found == [] and again.dale is None and again.dale_scheduler is None


class TestComponentsOfDifferentCheckpoints:
    def test_extractor_with_other_channels(self, pipe, make_extractor):
        other = make_extractor(feature_size=32, num_filters=24)
        with pytest.raises(ValueError, match="`feature_extractor`"):
            TactileTexturePipeline(pipe.lctg, other, pipe.scheduler, pipe.dale, pipe.dale_scheduler)

    def test_extractor_with_the_same_channels_but_another_hop(self, pipe, make_extractor):
        other = make_extractor(feature_size=24, num_filters=8, hop_length=16)
        with pytest.raises(ValueError, match="`feature_extractor`"):
            TactileTexturePipeline(pipe.lctg, other, pipe.scheduler, pipe.dale, pipe.dale_scheduler)

    def test_extractor_whose_frames_do_not_fill_latents(self, pipe, make_extractor):
        other = make_extractor(frame_multiple=1)
        with pytest.raises(ValueError, match="`feature_extractor`"):
            TactileTexturePipeline(pipe.lctg, other, pipe.scheduler, pipe.dale, pipe.dale_scheduler)

    def test_dale_with_other_latent_channels(self, pipe, make_dale):
        other = make_dale(in_channels=7, latent_mean=[0.0] * 5, latent_std=[1.0] * 5)
        with pytest.raises(ValueError, match="`dale`"):
            TactileTexturePipeline(
                pipe.lctg, pipe.feature_extractor, pipe.scheduler, other, dale_scheduler=pipe.dale_scheduler
            )

    def test_saved_folders_mixed_on_disk(self, saved, make_lctg):
        shutil.rmtree(saved / "lctg")
        make_lctg(latent_channels=5).save_pretrained(str(saved / "lctg"))
        with pytest.raises(ValueError, match="different checkpoints"):
            TactileTexturePipeline.from_pretrained(str(saved))

    def test_one_scheduler_for_both_stages(self, pipe):
        with pytest.raises(ValueError, match="`dale_scheduler`"):
            TactileTexturePipeline(pipe.lctg, pipe.feature_extractor, pipe.scheduler, pipe.dale, pipe.scheduler)

    def test_dale_without_a_scheduler(self, pipe):
        with pytest.raises(ValueError, match="`dale_scheduler`"):
            TactileTexturePipeline(pipe.lctg, pipe.feature_extractor, pipe.scheduler, pipe.dale)


class TestHub:
    def test_from_pretrained_fetches_configs_and_safetensors_only(self, saved, monkeypatch, pipe):
        fetched = []

        def snapshot_download(repo_id, **kwargs):
            fetched.append((repo_id, kwargs))
            return str(saved)

        monkeypatch.setattr(huggingface_hub, "snapshot_download", snapshot_download)
        again = TactileTexturePipeline.from_pretrained("someone/textures", revision="v2", token="secret")
        assert weights_hash(again) == weights_hash(pipe)
        [(repo, kwargs)] = fetched
        assert repo == "someone/textures"
        assert kwargs["revision"] == "v2" and kwargs["token"] == "secret"
        assert set(kwargs["allow_patterns"]) == {"*.json", "*.safetensors"}  # neither code nor pickles

    def test_download_passes_on_what_it_is_given(self, monkeypatch):
        monkeypatch.setattr(huggingface_hub, "snapshot_download", lambda repo, **kwargs: (repo, kwargs))
        options = {
            "revision": "main",
            "token": "t",
            "cache_dir": "/nowhere",
            "local_files_only": True,
            "force_download": True,
        }
        repo, kwargs = TactileTexturePipeline.download("a/b", **options, custom_pipeline=None, variant="fp16")
        assert repo == "a/b"
        assert {name: kwargs[name] for name in options} == options
        assert set(kwargs) == {*options, "allow_patterns"}
        assert kwargs["allow_patterns"] == ["*.json", "*.fp16*.safetensors"]

"""What a diffusers pipeline is expected to do beyond a plain call: components, callbacks, offload, files."""

import inspect
from pathlib import Path

import numpy as np
import pytest
import torch
from diffusers import ModelMixin, SchedulerMixin, UNet1DModel
from transformers.feature_extraction_utils import FeatureExtractionMixin

from tactile_diffusers import RatingEstimator, TactileTexturePipeline, bundled_checkpoint
from tactile_diffusers.pipelines.hub import CODE, CODE_FILE


@pytest.fixture
def whole(pipe, make_lctg):
    """A pipeline with every component."""
    torch.manual_seed(0)
    pipe.register_modules(rating_estimator=RatingEstimator(channel_groups=[4, 0, 2]).eval())
    pipe.register_modules(lctg_distilled=make_lctg(distilled_steps=1))
    return pipe


def _textures(pipe, ratings=(1.0, None, 0.0), **options):
    options = {"num_inference_steps": 2, "generator": torch.Generator().manual_seed(0), **options}
    return pipe(list(ratings), **options).textures


# --- components


def test_every_component_can_be_saved_and_the_index_holds_nothing_else(whole):
    for component in whole.components.values():
        assert isinstance(component, ModelMixin | SchedulerMixin | FeatureExtractionMixin)
        assert type(component).__module__ == "tactile_diffusers"
    components, settings = TactileTexturePipeline._get_signature_keys(TactileTexturePipeline)
    arguments = inspect.signature(TactileTexturePipeline.__init__).parameters
    assert set(components) == set(whole.components) == set(arguments) - {"self"} and not settings
    assert {name for name in whole.config if not name.startswith("_")} == set(whole.components)
    with_default = {name for name, argument in arguments.items() if argument.default is None}
    assert with_default == set(TactileTexturePipeline._optional_components)


def test_a_pipeline_of_right_components_is_made_without_a_word(whole, recorded_warnings):
    with recorded_warnings() as found:
        other = TactileTexturePipeline(**whole.components)
        again = TactileTexturePipeline.from_pipe(other)
    assert found == []
    assert np.array_equal(_textures(again), _textures(whole))


@pytest.mark.parametrize("name", ["lctg", "feature_extractor", "dale", "rating_estimator"])
@pytest.mark.parametrize("wrong", [None, UNet1DModel()], ids=["None", "UNet1DModel"])
def test_a_component_of_another_class_is_named(pipe, name, wrong):
    if wrong is None and name in pipe._optional_components:
        pytest.skip("may be missing")
    with pytest.raises(ValueError, match=f"`{name}` must be a .*, got {type(wrong).__name__}"):
        TactileTexturePipeline(**{**pipe.components, name: wrong})


def test_compiled_models_are_components(pipe):
    TactileTexturePipeline.from_pipe(pipe, lctg=torch.compile(pipe.lctg), dale=torch.compile(pipe.dale))


def test_a_call_says_nothing(whole, recorded_warnings, pink_noise):
    with recorded_warnings() as found:
        _textures(whole, guidance_scale=2.0, duration_s=0.5)
        whole.estimate_ratings(pink_noise(2048, 10_000), 10_000, 0.5)
        whole.reconstruct(pink_noise(2048, 10_000), 10_000, 2)
    assert found == []


def test_the_progress_bar_counts_both_stages(pipe, capsys):
    pipe.set_progress_bar_config(disable=False, mininterval=0)
    _textures(pipe, num_latent_inference_steps=3)
    assert "5/5" in capsys.readouterr().err
    pipe.set_progress_bar_config(disable=True)
    _textures(pipe)
    assert capsys.readouterr().err == ""


# --- devices, offloading, types


def test_models_leave_the_accelerator_in_the_order_of_use(whole, pink_noise):
    order = whole.model_cpu_offload_seq.split("->")
    models = {name for name, part in whole.components.items() if isinstance(part, torch.nn.Module)}
    assert set(order) == models and order.index("dale") < order.index("lctg") < order.index("rating_estimator")
    expected = _textures(whole)
    ratings = whole.estimate_ratings(pink_noise(2048, 10_000), 10_000)
    whole.enable_model_cpu_offload(device="cpu")  # the hooks are those of an accelerator, the places are not
    assert [type(hook.model) for hook in whole._all_hooks] == [type(getattr(whole, name)) for name in order]
    np.testing.assert_allclose(_textures(whole), expected, rtol=0, atol=1e-5 * np.abs(expected).max())
    np.testing.assert_allclose(whole.estimate_ratings(pink_noise(2048, 10_000), 10_000), ratings, atol=1e-5)


# --- files


def test_a_pipelines_files_are_configurations_and_safetensors(whole, tmp_path):
    whole.save_pretrained(tmp_path)
    files = {
        path.name for path in tmp_path.rglob("*") if path.suffix not in (".json", ".safetensors") and path.is_file()
    }
    assert files == {"pipeline.py"}


def test_no_file_of_the_bundled_checkpoint_breaks_variants():
    # a name without a dot in a component's folder is an IndexError of the loader; and no pickles
    files = [path for path in Path(bundled_checkpoint()).rglob("*") if path.is_file()]
    assert len(files) > 10 and {path.suffix for path in files} <= {".json", ".safetensors", ".md", ".png", ".py"}
    assert (Path(bundled_checkpoint()) / CODE_FILE).read_text() == CODE

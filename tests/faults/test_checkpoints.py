"""Folders of models and pipelines: whole and ours, or refused; never unpickled."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file, save_file

from tactile_diffusers import DALEModel, LCTGModel, TactileTexturePipeline

TINY = Path(__file__).parents[1] / "fixtures" / "tiny_pipeline"
NAME = "diffusion_pytorch_model"
WEIGHTS, CONFIG = f"{NAME}.safetensors", "config.json"
MODELS = {"lctg": LCTGModel, "dale": DALEModel}
OTHERS = (
    "model_index.json",
    "scheduler/scheduler_config.json",
    "dale_scheduler/scheduler_config.json",
    "feature_extractor/preprocessor_config.json",
)
pytestmark = pytest.mark.filterwarnings("ignore")


def _numbers(loaded):
    models = [loaded] if isinstance(loaded, torch.nn.Module) else [loaded.lctg, loaded.dale]
    return [part.numpy() for model in models for _, part in sorted(model.state_dict().items())]


def _as_model(path):
    return _numbers(MODELS[path.parent.name].from_pretrained(path.parent))


def _as_pipeline(path):
    top = path.parent if path.name == "model_index.json" else path.parents[1]
    return _numbers(TactileTexturePipeline.from_pretrained(str(top)))


def _sane(numbers):
    """A flipped bit changes a weight, which nothing can notice; finite it must be."""
    return all(np.isfinite(array).all() for array in numbers)


@pytest.mark.parametrize("name", [*(f"{model}/{file}" for model in MODELS for file in (CONFIG, WEIGHTS)), *OTHERS])
def test_damage(name, damaged, flips, foreign):
    others = [*foreign.values()]
    if name not in OTHERS:
        others += [
            (TINY / OTHERS[0]).read_bytes(),
            (TINY / {"l": "dale", "d": "lctg"}[name[0]] / name[5:]).read_bytes(),
        ]
    read = _as_pipeline if name in OTHERS else _as_model
    damaged(TINY / name, read, sane=_sane, root=TINY).damage(flips // 4, others)


@pytest.mark.parametrize("name", [f"{model}/{CONFIG}" for model in MODELS] + list(OTHERS))
def test_a_key_is_absurd(name, damaged, refusal, odd_values):
    """Values of any size and kind; what does not change the shape of a model may pass, and be refused in use."""
    read = _as_pipeline if name in OTHERS else _as_model
    case = damaged(TINY / name, read, root=TINY)
    content = json.loads(case.content)
    for key in [key for key in content if not key.startswith("_") and not key.endswith("_type")]:
        for absurd in odd_values[1:]:  # a key that older versions did not write has a default
            result, message = refusal(read, case.put(json.dumps({**content, key: absurd}).encode()))
            assert message or _sane(result), (key, absurd)


@pytest.mark.parametrize("model", MODELS)
def test_what_decides_shapes_is_refused_before_memory_is_spent(model, damaged):
    case = damaged(TINY / model / CONFIG, _as_model, root=TINY)
    content = json.loads(case.content)
    for change in (
        {"widths": [10**9] * 2},
        {"widths": [8] * 100_000},
        {"embedding_dim": 10**9},
        {"kernel_size": 10**9},
    ):
        assert "config.json" in case.refuse(json.dumps({**content, **change}).encode())
    for key in ("widths", "embedding_dim"):  # the default is of another size
        case.refuse(json.dumps({name: value for name, value in content.items() if name != key}).encode())
    case.refuse(json.dumps({**content, "_class_name": "UNet2DModel"}).encode(), "UNet2DModel")


@pytest.mark.parametrize("read", [_as_model, _as_pipeline])
@pytest.mark.parametrize("model", MODELS)
def test_weights_that_do_not_fit(model, read, damaged, refusal):
    case = damaged(TINY / model / WEIGHTS, read, root=TINY)
    weights = load_file(case.path)
    first, *rest = sorted(weights)
    for changed in (
        {name: weights[name] for name in rest},
        {**weights, first: weights[first][..., None]},
        {**weights, first: torch.full_like(weights[first], torch.nan)},
        {**weights, first: weights[first].long()},
        {},
    ):
        save_file(changed, case.path, metadata={"format": "pt"})
        assert refusal(read, case.path)[1]
    for size in (0, 2**63, 2**40, 10**6):  # of the header, as its first eight bytes say
        case.refuse(size.to_bytes(8, "little") + case.content[8:])
    header = b'{"a":{"dtype":"F32","shape":[1099511627776],"data_offsets":[0,4398046511104]}}'
    case.refuse(len(header).to_bytes(8, "little") + header)


class Marked:
    """Unpickling it leaves a mark."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return Path.touch, (self.path,)


@pytest.mark.parametrize("read", [_as_model, _as_pipeline])
@pytest.mark.parametrize("suffix", [".bin", ".pt", ".pth", ".ckpt", ".pkl"])
def test_pickles_are_refused_with_the_reason(suffix, read, damaged, tmp_path):
    case = damaged(TINY / "lctg" / WEIGHTS, read, root=TINY)
    case.path.unlink()
    torch.save({"weight": Marked(tmp_path / "mark")}, case.path.with_name(NAME + suffix))
    with pytest.raises(ValueError, match="lctg.*pickle runs the code"):
        read(case.path)
    assert not (tmp_path / "mark").exists()


def test_pickles_of_a_variant_or_by_keyword_are_refused(damaged, tmp_path):
    case = damaged(TINY / "lctg" / WEIGHTS, _as_model, root=TINY)
    torch.save({"weight": Marked(tmp_path / "mark")}, case.path.with_name(f"{NAME}.fp16.bin"))
    top = str(case.path.parents[1])
    for load in (
        lambda: LCTGModel.from_pretrained(case.path.parent, variant="fp16"),
        lambda: TactileTexturePipeline.from_pretrained(top, variant="fp16"),
        lambda: LCTGModel.from_pretrained(top, subfolder="lctg", use_safetensors=False),
        lambda: TactileTexturePipeline.from_pretrained(top, use_safetensors=False),
    ):
        with pytest.raises(ValueError, match="pickle runs the code"):
            load()
    assert not (tmp_path / "mark").exists()


def _shard(path):
    """The weights of a model in two files with an index; returns the index's path and content."""
    model = MODELS[path.parent.name].from_pretrained(path.parent)
    path.unlink()
    model.save_pretrained(path.parent, max_shard_size="50KB")
    index = path.with_name(f"{WEIGHTS}.index.json")
    return index, json.loads(index.read_text())


def test_shards_are_read_and_indices_that_lead_elsewhere_refused(damaged, refusal, same, tmp_path):
    case = damaged(TINY / "lctg" / WEIGHTS, _as_model, root=TINY)
    index, content = _shard(case.path)
    assert same(_as_model(index), case.expected)
    torch.save({"weight": Marked(tmp_path / "mark")}, index.with_name("x.bin"))
    shutil.copy(TINY / "lctg" / WEIGHTS, index.parents[1] / "x.safetensors")
    for name in (
        "../x.safetensors",
        str(index.parents[1] / "x.safetensors"),
        "x.bin",
        7,
        "..",
        "",
    ):
        index.write_text(json.dumps({**content, "weight_map": dict.fromkeys(content["weight_map"], name)}))
        message = refusal(_as_model, index)[1]
        assert message and (name != "x.bin" or "pickle runs the code" in message), name
    index.with_name("x.bin").unlink()
    index.write_text(json.dumps({**content, "weight_map": dict.fromkeys(content["weight_map"], "absent.safetensors")}))
    with pytest.raises(FileNotFoundError, match="absent.safetensors"):
        _as_model(index)
    for changed in ([], {}, {"weight_map": {}, "metadata": {}}, {"weight_map": content["weight_map"]}):
        index.write_text(json.dumps(changed))
        assert refusal(_as_model, index)[1], changed
    assert not (tmp_path / "mark").exists()


@pytest.mark.parametrize(
    "entry",
    [
        ["os", "system"],
        ["diffusers", "UNet2DModel"],
        ["tactile_diffusers", "data"],
        ["torch", "load"],
        ["tactile_diffusers"],
    ]
    + [7, "word", [None, "LCTGModel"], ["antigravity", "fly"], ["transformers", "BertModel"], [["a"], {}]],
)
def test_foreign_components_are_refused(entry, damaged):
    case = damaged(TINY / "model_index.json", _as_pipeline, root=TINY)
    content = json.loads(case.content)
    for name in ("lctg", "scheduler", "unet"):
        case.refuse(json.dumps({**content, name: entry}).encode(), "model_index.json")


def test_code_in_a_folder_is_not_run(damaged, tmp_path):
    case = damaged(TINY / "lctg" / WEIGHTS, _as_pipeline, root=TINY)
    mark = tmp_path / "mark"
    case.path.with_name("tactile_diffusers.py").write_text(f"open({str(mark)!r}, 'w')\nclass LCTGModel: pass\n")
    with pytest.raises(ValueError, match="tactile_diffusers"):
        _as_pipeline(case.path)
    assert not mark.exists()

"""Local folders of models: config and weights exist and fit each other. Only headers are read."""

import inspect
from pathlib import Path

import torch
from safetensors import safe_open

from ..io.reading import read_json, reading

WEIGHTS = "diffusion_pytorch_model"
PICKLES = (".bin", ".pt", ".pth", ".ckpt", ".pkl", ".pickle")
WHY_NO_PICKLES = (
    "Such files are pickles, and reading a pickle runs the code in it, so only safetensors are read. If you trust the "
    "file, load it where it was written and save it again with `save_pretrained`."
)
_AGAIN = "Copy the checkpoint again as a whole."


def check_safe(name, value):
    """Raises a `ValueError` if the argument `name`, of loading or saving, asks for pickles; `None` does not."""
    if value is not None and not value:
        raise ValueError(f"`{name}` must not be False. {WHY_NO_PICKLES}")


def check_plain(model):
    """Raises a `ValueError` if a model to be saved wears adapters: its weights would have names that none can load."""
    if getattr(model, "_hf_peft_config_loaded", False):
        raise ValueError(
            f"The {type(model).__name__} wears the adapter(s) {list(model.peft_config)}, which `save_pretrained` does "
            "not save. Save them by `save_lora_adapter(folder)`, or keep them in the weights by `fuse_lora()`; then "
            "`unload_lora()`."
        )


def check_loaded(model, missing, path):
    """Raises a `ValueError` if a loaded model lacks weights, or one is not finite."""
    damaged = [*missing, *(name for name, part in model.named_parameters() if _is_not_finite(part))]
    if damaged:
        raise ValueError(
            f"{WEIGHTS}.safetensors of {path} lacks weights of {type(model).__name__}, or they are not finite: "
            f"{damaged[:3]}. {_AGAIN}"
        )


def _is_not_finite(parameter):
    plain = parameter.dtype in (torch.float16, torch.bfloat16, torch.float32) and not parameter.is_meta
    return plain and not parameter.isfinite().all()


def check_folder(cls, folder, variant, changes):
    """Raises unless config and weights of a local folder exist and fit each other.

    Args:
        cls (`type`): of the model.
        folder (`Path`): its own.
        variant (`str` or `None`): of the weights' names.
        changes (`dict`): arguments of `from_pretrained`, some of which replace entries of the config.
    """
    if not (folder / "config.json").is_file():
        pipeline = next((here for here in (folder, folder.parent) if (here / "model_index.json").is_file()), None)
        held = [] if pipeline is None else sorted(path.parent.name for path in pipeline.glob("*/config.json"))
        remedy = f"`subfolder` must be one of {', '.join(held)}, of the pipeline {pipeline}." if held else _AGAIN
        raise FileNotFoundError(f"There is no {folder / 'config.json'}. {remedy}")
    found, paths = {}, _weights(folder, variant)
    held = paths[0].name if len(paths) == 1 else f"{len(paths)} shards"
    for path in paths:
        with reading(path, "safetensors", _AGAIN), safe_open(path, framework="pt") as file:
            for name in file.keys():
                part = file.get_slice(name)
                if not part.get_dtype().startswith(("F", "BF")):
                    raise ValueError(f"{name} holds {part.get_dtype()}, not real numbers")
                found[name] = tuple(part.get_shape())
    with reading(folder / "config.json", f"the config of a {cls.__name__}", _AGAIN):
        config = read_json(folder / "config.json", "JSON")
        if config.get("_class_name", cls.__name__) != cls.__name__:
            raise ValueError(f"{folder} holds a {config['_class_name']}, no {cls.__name__}: load it by its own class.")
        names = inspect.signature(cls.__init__).parameters
        settings = {name: value for name, value in {**config, **changes}.items() if name in names}
        with torch.device("meta"):  # shapes alone: a config may ask for any size
            expected = {name: tuple(part.shape) for name, part in cls(**settings).state_dict().items()}
        missing = sorted(expected.keys() - found.keys())
        others = [name for name, shape in expected.items() if found.get(name, shape) != shape]
        if missing:
            few = f"{len(missing)} of {len(expected)} weights"
            raise ValueError(f"{held} lacks {few} that it asks for, {missing[0]} for one")
        if others and not changes.get("ignore_mismatched_sizes"):
            name = others[0]
            raise ValueError(f"it asks for {name} of shape {expected[name]}, {held} has {found[name]}")


def _weights(folder, variant):
    """Paths of the safetensors files that hold the weights: one, or those that the index of a sharded model names."""
    part = f".{variant}" if variant else ""
    single, index = folder / f"{WEIGHTS}{part}.safetensors", folder / f"{WEIGHTS}.safetensors.index{part}.json"
    if index.is_file():
        with reading(index, "the index of a sharded model", _AGAIN):
            content = read_json(index, "JSON")
            dict(content["metadata"])
            names = sorted(set(dict(content["weight_map"]).values()))
            if any(Path(name).suffix in PICKLES for name in names):
                raise ValueError(f"{index} names {names}. {WHY_NO_PICKLES}")
            if not names or any(Path(name).name != name or Path(name).suffix != ".safetensors" for name in names):
                raise ValueError(f"{index} must name .safetensors files in its own folder, got {names}. {_AGAIN}")
        paths = [folder / name for name in names]
    else:
        paths = [single]
    absent = [path for path in paths if not path.is_file()]
    if absent:
        pickles = sorted(path.name for path in folder.iterdir() if path.suffix in PICKLES)
        if pickles:
            raise ValueError(f"{folder} has no {absent[0].name}, only {', '.join(pickles)}. {WHY_NO_PICKLES}")
        held = sorted({path.name.split(".")[1] for path in folder.glob(f"{WEIGHTS}.*.safetensors")} - {variant})
        remedy = f"Give `variant`: the folder has {', '.join(held)}." if held else _AGAIN
        raise FileNotFoundError(f"There is no {absent[0]}. {remedy}")
    return paths

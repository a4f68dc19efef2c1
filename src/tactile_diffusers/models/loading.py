"""Loading models from folders that may be damaged or untrusted: no pickles, and no model with parts missing."""

import functools
import inspect
from pathlib import Path

import torch
from diffusers.models.modeling_utils import ModelMixin
from safetensors import safe_open

from ..io.reading import read_json, reading

WEIGHTS = "diffusion_pytorch_model"
PICKLES = (".bin", ".pt", ".pth", ".ckpt", ".pkl", ".pickle")
WHY_NO_PICKLES = (
    "Such files are pickles, and reading a pickle runs the code in it, so only safetensors are read. If you trust the "
    "file, load it where it was written and save it again with `save_pretrained`."
)
_AGAIN = "Copy the checkpoint again as a whole."


class SafeLoadingMixin:
    """`from_pretrained` that reads no pickles, and compares config and weights before it loads them."""

    @classmethod
    def from_pretrained(cls, pretrained_model_name_or_path, **kwargs):
        """Loads a model from safetensors, see [`ModelMixin.from_pretrained`].

        Raises:
            OSError: if a file is missing.
            ValueError: naming the file, for pickled weights, a damaged file, a config that the weights do not fit, or
                weights that are missing: nothing is newly initialised in silence.
        """
        if kwargs.get("use_safetensors") is False:
            raise ValueError(
                f"`use_safetensors` must not be False for {pretrained_model_name_or_path}. {WHY_NO_PICKLES}"
            )
        path = Path(pretrained_model_name_or_path)
        if path.is_dir():
            folder = path / (kwargs.get("subfolder") or "")
            _check_model_folder(cls, folder, kwargs.get("variant"), kwargs)
        with_info = kwargs.pop("output_loading_info", False)
        kwargs["use_safetensors"] = True  # the default, None, would fall back to pickles
        model, info = super().from_pretrained(pretrained_model_name_or_path, output_loading_info=True, **kwargs)
        damaged = [*info["missing_keys"], *(name for name, part in model.named_parameters() if _is_not_finite(part))]
        if damaged:
            raise ValueError(
                f"{WEIGHTS}.safetensors of {pretrained_model_name_or_path} lacks weights of {cls.__name__}, or they "
                f"are not finite: {damaged[:3]}. {_AGAIN}"
            )
        return (model, info) if with_info else model

    @functools.wraps(ModelMixin.save_pretrained)  # pipelines look at the signature
    def save_pretrained(self, save_directory, *args, **kwargs):
        given = inspect.signature(ModelMixin.save_pretrained).bind(self, save_directory, *args, **kwargs).arguments
        if not given.get("safe_serialization", True):
            raise ValueError(f"`safe_serialization` must not be False. {WHY_NO_PICKLES}")
        return super().save_pretrained(save_directory, *args, **kwargs)


def _is_not_finite(parameter):
    plain = parameter.dtype in (torch.float16, torch.bfloat16, torch.float32) and not parameter.is_meta
    return plain and not parameter.isfinite().all()


def _check_model_folder(cls, folder, variant, changes):
    """Raises unless config and weights of a local folder exist and fit each other; reads only their headers."""
    if not (folder / "config.json").is_file():
        pipeline = (folder / "model_index.json").is_file()
        remedy = f"{folder} is a pipeline's: name the model's `subfolder`, too." if pipeline else _AGAIN
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
            raise ValueError(f"it is of a {config['_class_name']}")
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

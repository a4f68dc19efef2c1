"""What the models share: loading that refuses damaged files, compiling, and hooks, which see `forward` alone."""

import functools
import inspect
from pathlib import Path

import torch
from diffusers.models.modeling_utils import ModelMixin

#: graphs that torch.compile may keep for one function: fifteen blocks of different widths, a few batch sizes of each
MOST_GRAPHS = 64


def _with_room(kwargs):
    if "recompile_limit" in inspect.signature(torch.compile).parameters:
        return {"recompile_limit": MOST_GRAPHS, **kwargs}
    torch._dynamo.config.recompile_limit = max(torch._dynamo.config.recompile_limit, MOST_GRAPHS)
    return kwargs


class CompileMixin:
    """`compile` and `compile_repeated_blocks` with room for more graphs than torch's eight."""

    def compile(self, *args, **kwargs):
        """Compiles `forward`, see [`torch.nn.Module.compile`]; up to 64 graphs are kept."""
        return super().compile(*args, **_with_room(kwargs))

    def compile_repeated_blocks(self, *args, **kwargs):
        """Compiles each block of the U-Net, see [`ModelMixin.compile_repeated_blocks`]; up to 64 graphs are kept."""
        return super().compile_repeated_blocks(*args, **_with_room(kwargs))


def has_hooks(model):
    """Whether a part of a model has a hook of accelerate or diffusers (offloading, device maps, narrow storage).

    Then only `forward` may be called, not `condition`.
    """
    parts = [model]  # `model.modules()` takes five times as long, and a call asks several times
    while parts:
        own = vars(parts.pop())
        if "_hf_hook" in own or "_diffusers_hook" in own:
            return True
        parts += [part for part in own["_modules"].values() if part is not None]
    return False


class HookMixin:
    """`dtype` without diffusers' search through all parts, twice, where no hook may have changed it."""

    @property
    def dtype(self):
        """dtype of the weights, or that in which a model of narrow storage computes."""
        return super().dtype if has_hooks(self) else next(self.parameters()).dtype


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
        from .model_files import check_folder, check_loaded, check_safe

        check_safe("use_safetensors", kwargs.get("use_safetensors"))
        path = Path(pretrained_model_name_or_path)
        if path.is_dir():
            check_folder(cls, path / (kwargs.get("subfolder") or ""), kwargs.get("variant"), kwargs)
        with_info = kwargs.pop("output_loading_info", False)
        kwargs["use_safetensors"] = True  # the default, None, would fall back to pickles
        model, info = super().from_pretrained(pretrained_model_name_or_path, output_loading_info=True, **kwargs)
        check_loaded(model, info["missing_keys"], path)
        return (model, info) if with_info else model

    @functools.wraps(ModelMixin.save_pretrained)  # pipelines look at the signature
    def save_pretrained(self, save_directory, *args, **kwargs):
        from .model_files import check_plain, check_safe

        check_plain(self)
        arguments = inspect.signature(ModelMixin.save_pretrained).bind(self, save_directory, *args, **kwargs).arguments
        check_safe("safe_serialization", arguments.get("safe_serialization"))
        return super().save_pretrained(save_directory, *args, **kwargs)

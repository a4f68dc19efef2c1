"""Loading models from folders that may be damaged or untrusted: no pickles, and no model with parts missing."""

import functools
import inspect
from pathlib import Path

from diffusers.models.modeling_utils import ModelMixin


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

"""The child of test_fresh_process.py: loads checkpoints and prints, as JSON, what came of it.

python fresh_process.py CHECKPOINTS TINY
"""

import importlib
import json
import logging
import os
import pickle
import sys
import time
import warnings

BASE = (
    "diffusers.models.modeling_utils",
    "diffusers.pipelines.pipeline_utils",
    "transformers.feature_extraction_utils",
    "scipy.signal",
)
HEAVY = ("matplotlib", "librosa", "numba", "gradio", "tensorboard", "pandas", "h5py", "openpyxl")


class Collector(logging.Handler):
    """Keeps what is logged at level WARNING or above."""

    def __init__(self):
        super().__init__(logging.WARNING)
        self.texts = []

    def emit(self, record):
        self.texts.append(record.getMessage())


def main(root, tiny):
    # what the package cannot do without, before it, so that its own share of the time is known
    for name in BASE:
        importlib.import_module(name)
    before, began = set(sys.modules), time.process_time()  # of a busy machine only what is spent here
    import tactile_diffusers

    seconds = time.process_time() - began
    found, log = {}, Collector()
    for name in (None, "diffusers", "transformers", "accelerate"):
        logging.getLogger(name).addHandler(log)

    def attempt(name, function):
        log.texts.clear()
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            try:
                entry = {"result": function()}
            except Exception as error:
                entry = {"error": f"{type(error).__name__}: {error}"}
        found[name] = entry | {"warnings": [*log.texts, *(str(warning.message) for warning in caught)]}

    def imported():
        public = ("DALEModel", "LCTGModel", "TactileTexturePipeline")
        bases = ("FeatureExtractionMixin", "ModelMixin", "SchedulerMixin")
        return {
            "seconds": seconds,
            "heavy": [name for name in HEAVY if name in set(sys.modules) - before],
            "public": [name for name in public if hasattr(tactile_diffusers, name)],
            "bases": [name for name in bases if hasattr(tactile_diffusers, name)],  # as the loader asks for them
        }

    attempt("import", imported)
    load(attempt, tactile_diffusers, root, tiny)
    print(json.dumps(found))


def load(attempt, tactile_diffusers, root, tiny):
    import torch
    from diffusers import DiffusionPipeline

    Pipeline = tactile_diffusers.TactileTexturePipeline

    def described(pipe):
        components = {name: part for name, part in pipe.components.items() if part is not None}
        models = {name: part for name, part in components.items() if isinstance(part, torch.nn.Module)}
        return {
            "classes": {name: type(part).__name__ for name, part in components.items()},
            "dtypes": {name: str(part.dtype) for name, part in models.items()},
        }

    def generated(pipe):
        pipe.set_progress_bar_config(disable=True)
        out = pipe([1.0, None, -1.0], num_inference_steps=2, generator=torch.Generator("cpu").manual_seed(5))
        return {"finite": bool(torch.from_numpy(out.textures).isfinite().all())}

    def loaded(folder, **options):
        return described(Pipeline.from_pretrained(os.path.join(root, folder), **options))

    def full_name(folder, **options):
        made = type(DiffusionPipeline.from_pretrained(os.path.join(root, folder), **options))
        return f"{made.__module__}.{made.__qualname__}"

    def tiny_one():
        pipe = Pipeline.from_pretrained(tiny)
        return described(pipe) | generated(pipe)

    attempt("tiny", tiny_one)
    for folder in ("plain", "shards", "decoder"):
        attempt(folder, lambda folder=folder: loaded(folder))
    attempt("variant", lambda: loaded("variant", variant="fp16"))
    attempt("variant without asking", lambda: loaded("variant"))
    attempt("another variant", lambda: loaded("variant", variant="bf16"))
    attempt("dtype of each", lambda: loaded("plain", dtype={"dale": torch.bfloat16, "default": torch.float16}))
    attempt("device map", lambda: loaded("plain", device_map="balanced"))
    attempt("unknown device map", lambda: loaded("plain", device_map="auto"))

    attempt("base class", lambda: full_name("plain"))
    attempt("code without trust", lambda: full_name("plain", custom_pipeline="pipeline"))

    with open(os.path.join(root, "components.pkl"), "rb") as file:
        parts = {name: part for name, part in pickle.load(file).items() if part is not None}
        attempt("pickle", lambda: {name: type(part).__name__ for name, part in parts.items()})


if __name__ == "__main__":
    main(*sys.argv[1:])

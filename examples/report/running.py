"""Runs the sections of a report, keeps each that is done, and puts them together."""

import json
import os
import platform
import time
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np
from tqdm.auto import tqdm

from tactile_diffusers.evaluation.metrics.embedding import EMBEDDING_VERSION
from tactile_diffusers.io.files import write_text
from tactile_diffusers.io.reading import read_json
from tactile_diffusers.pipelines.folders import folder_digest
from tactile_diffusers.training.record import count_seen, phases, read_losses, surfaces_of, trained_on

from .result_files import machine_facts
from .sampling import one_thread
from .sections import SECTIONS, WITHOUT_RATINGS
from .virtual_truth import can_be_continued

#: Raise it with every change that changes a figure of a report: sections kept under another version are measured again.
METRICS_VERSION = 5
#: Sections of a report that hold leaves; null where the checkpoint or the data have nothing to measure.
MEASURED = (*SECTIONS, "unseen_surfaces")
_PACKAGES = ("tactile-diffusers", "torch", "diffusers", "transformers", "numpy", "scipy", "librosa")
# only training DALE has this argument
_DALE_ARGUMENT = "condition_dropout"


def run_sections(context, names, checkpoint):
    """Runs sections (`names` of `SECTIONS`) one after the other; those done under the same conditions are read instead.

    Each result is a file `sections/<name>.json` in the output folder, so that an interrupted run continues. Returns the
    report, a dict: sections that are not in `names`, or have nothing to measure, are None; "seconds" is how long each
    section took.
    """
    conditions, folder = _conditions(context, checkpoint), context.output / "sections"
    folder.mkdir(parents=True, exist_ok=True)
    report = {
        "checkpoint": {"name": Path(checkpoint).name, "sha256": conditions["checkpoint"]},
        "training": training_facts(checkpoint) | {"parameters": context.pipe.lctg.num_parameters()},
        "data": _data_facts(context.data),
        "judged": surfaces_of(context.data.dataset, context.data.rows),
        "seen_in_training": seen_in_training(context, checkpoint),
        "seed": context.seed,
        "settings": {**asdict(context.settings), "guidance_scales": context.guidance_scales},
        "pipeline": {"num_inference_steps": context.steps, "guidance_scale": context.default_guidance},
        "machine": machine_facts(),
        "versions": _versions(),
        **dict.fromkeys(MEASURED),
        "seconds": {},
    }
    for name in tqdm(names, desc="sections", disable=context.quiet):
        if name in WITHOUT_RATINGS or _has_ratings(context):
            result, seconds = _kept(folder / f"{name}.json", conditions, lambda name=name: _run(name, context))
            report |= result
            report["seconds"][name] = seconds
    return report


def _run(name, context):
    """A section in one thread, but for the one that times what all threads do."""
    if name == "speed":
        return SECTIONS[name](context)
    with one_thread(context.pipe.device):
        return SECTIONS[name](context)


def seen_in_training(context, checkpoint):
    """How many of the context's held-out surfaces the training of a checkpoint used; `None` if not recorded."""
    found, _ = trained_on([checkpoint])
    return count_seen(surfaces_of(context.data.dataset, context.data.rows), found) if found else None


def training_facts(folder):
    """Cost of one training of LCTG, summed over its phases: "phases" (names of folders), "optimiser_steps" and
    "seconds".

    The folder is followed back through what it was trained from; phases that trained DALE are left out. None where a
    phase is not known.
    """
    known = [(place, record) for place, record in phases(folder) if _DALE_ARGUMENT not in record.get("arguments", {})]
    logs = [read_losses(folder) for folder, _ in known]
    steps = [log[-1]["step"] if log else record.get("steps") for log, (_, record) in zip(logs, known, strict=True)]
    seconds = [log[-1].get("seconds") if log else None for log in logs]
    return {
        "phases": [folder.name for folder, record in known if record],
        "optimiser_steps": sum(steps) if steps and None not in steps else None,
        "seconds": sum(seconds) if seconds and None not in seconds else None,
    }


def _has_ratings(context):
    rated = (context.data.ratings, context.data.training.ratings)
    return context.pipe.dale is not None and all(np.isfinite(ratings).all(-1).any() for ratings in rated)


def _kept(path, conditions, measure):
    """The result in a file if measured under these conditions, else a new one, which replaces it; and its seconds."""
    try:
        stored = read_json(path, "JSON")
    except (FileNotFoundError, ValueError):
        stored = {}
    if stored.get("conditions") == conditions and {"result", "seconds"} <= stored.keys():
        return stored["result"], stored["seconds"]
    start = time.perf_counter()
    stored = {"conditions": conditions, "result": measure(), "seconds": round(time.perf_counter() - start, 1)}
    write_text(path, json.dumps(stored, allow_nan=False))
    return stored["result"], stored["seconds"]


def _conditions(context, checkpoint):
    """What a result depends on, as JSON."""
    data = context.data
    facts = os.stat(data.dataset.path)
    state = {
        "metrics_version": METRICS_VERSION,
        "embedding_version": EMBEDDING_VERSION,
        "checkpoint": folder_digest(checkpoint),
        "data": [facts.st_size, facts.st_mtime_ns],
        "split": data.dataset.split,
        "seed": context.seed,
        "settings": asdict(context.settings),
        "guidance_scales": context.guidance_scales,
        "pipeline": [context.steps, context.default_guidance],
        "versions": _versions(),
        "machine": machine_facts(),
    }
    return json.loads(json.dumps(state))


def _data_facts(data):
    dataset, train = data.dataset, data.train
    return {
        "name": Path(dataset.path).name,
        "source": dataset.source,
        "recipe": dataset.attributes.get("recipe_version"),
        "fresh_surfaces": can_be_continued(dataset),
        "split": dataset.split,
        "held_out": _held_out(dataset),
        "unit": dataset.unit,
        "sampling_rate": dataset.sampling_rate,
        "band": list(dataset.band),
        "surfaces": len(set(data.surfaces.tolist())),
        "segments": len(data.surfaces),
        "rater_alpha": _alpha(dataset.ratings.reliability),
        "training_surfaces": len(set(train.surface_ids.tolist())),
        "reference_surfaces": len(set(train.surface_ids.tolist())),
        "reference_segments": len(data.training.textures),
        "embedding_version": EMBEDDING_VERSION,
    }


def _held_out(dataset):
    """What training does not see of the hard split, such as "explorers explorer-1"; `None` of other splits."""
    patterns = (dataset.attributes["hold_out"] or {}).items() if dataset.split == "hard" else ()
    return "; ".join(f"{kind} {', '.join(names)}" for kind, names in patterns if names) or None


def _alpha(reliability):
    """Cronbach's alpha of the mean rating on each axis, `None` where no two raters answered."""
    if reliability is None:
        return None
    pairs = zip(reliability.axes, reliability.alpha, strict=True)
    return {axis: None if np.isnan(alpha) else float(alpha) for axis, alpha in pairs}


def _versions():
    found = {"python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = None
    return found

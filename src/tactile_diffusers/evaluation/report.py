"""The report: runs sections, keeps each that is done, and puts them together as report.json."""

import hashlib
import json
import os
import platform
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np
import torch
from tqdm.auto import tqdm

from ..checkpoints import DISTILLED
from ..io.files import write_text
from ..io.reading import read_json
from ..training.surfaces import count_seen, surfaces_of, trained_on
from .metrics.statistics import is_leaf
from .report_figures import plot_beside
from .result_files import machine_facts
from .sections import SECTIONS, WITHOUT_RATINGS, anchors
from .training_record import training_facts

#: Sections of a report that hold leaves; null where the checkpoint or the data have nothing to measure.
MEASURED = (
    *("reconstruction", "generation", "control", "unseen_surfaces", "speed", "paper", "long_textures"),
    *("latents", "robustness", "novel", "regression"),
)
# files that only write tables, or what is read anew each time
_TELLING = (
    "labels.py",
    "summary.py",
    "tables.py",
    "telling.py",
    "telling_ratings.py",
    "obedience.py",
    "comparison.py",
    "training_record.py",
    "winners.py",
)
# of a checkpoint, beside its components: what they are, and how they were trained
_TOLD = ("model_index.json", "training.json")
_PACKAGES = ("tactile-diffusers", "torch", "diffusers", "transformers", "numpy", "scipy", "librosa")


def run_sections(context, names, checkpoint, training=()):
    """Runs sections one after the other; those already done under the same conditions are read instead.

    Each result is a file `sections/<name>.json` in the output folder, so that a run that was cut off goes on. The
    embedding that distances are measured in is kept there likewise, and written to `embedding.json` for others to use.

    Args:
        context (`Context`): what is evaluated.
        names (`list[str]`): of `SECTIONS`.
        checkpoint (`str` or `Path`): its folder.
        training (`Sequence[Path]`): folders of the phases of its LCTG's training; by default what lies in `checkpoint`.

    Returns:
        `dict`: the report, see README; sections not asked for, or without anything to measure, are None. "anchors"
        holds leaves and training facts of each of the context's anchors, or is None.
    """
    conditions = _conditions(context, checkpoint)
    folder = context.output / "sections"
    folder.mkdir(parents=True, exist_ok=True)
    report = {
        "checkpoint": {"name": Path(checkpoint).name, "sha256": conditions["checkpoint"]},
        "training": _training(context.pipe, training or [checkpoint]),
        "data": _data(context),
        "judged": surfaces_of(context.held_out, context.chosen[0]),
        "seen_in_training": seen_in_training(context, [checkpoint, *training]),
        "seed": context.seed,
        "settings": {**asdict(context.settings), "guidance_scales": context.guidance_scales},
        "pipeline": {"num_inference_steps": context.steps, "guidance_scale": context.default_guidance},
        "machine": machine_facts(),
        "versions": _versions(),
        **dict.fromkeys((*MEASURED, "anchors")),
    }
    for name in tqdm(names, desc="sections", disable=context.quiet):
        if name not in WITHOUT_RATINGS and not _can_steer(context):
            continue
        report |= _kept(folder / f"{name}.json", conditions, SECTIONS[name], context)
    if context.anchors:
        report["anchors"] = _anchors(context, conditions, folder)
        if report["reconstruction"]:
            plot_beside(report["reconstruction"], report["anchors"], context.output / "beside.png")
    embedding = _kept(folder / "embedding.json", conditions, _embedding, context)
    write_text(context.output / "embedding.json", json.dumps(embedding))
    return report


def seen_in_training(context, folders):
    """How many of the judged surfaces the checkpoint was trained on; `None` where nothing tells.

    Args:
        context (`Context`): with the judged surfaces.
        folders (`Sequence[str` or `Path]`): the checkpoint's, and those of its trainings.

    Returns:
        `int` or `None`
    """
    found, _ = trained_on(folders)
    return count_seen(surfaces_of(context.held_out, context.chosen[0]), found) if found else None


def _anchors(context, conditions, folder):
    """Leaves and training facts of each anchor; an anchor is measured as if it were the checkpoint."""
    found = {}
    for name, anchor in tqdm(context.anchors.items(), desc="anchors", disable=context.quiet):
        own = conditions | {"checkpoint": folder_digest(anchor.folder)}
        # what is kept holds for this anchor alone: others come and go without measuring it again
        made = _kept(folder / f"anchor_{name}.json", own, lambda c, pipe=anchor.pipe: anchors.measure(c, pipe), context)
        found[name] = made | {"training": _training(anchor.pipe, [anchor.folder])}
    return found


def _training(pipe, folders):
    return training_facts(folders) | {"parameters": pipe.lctg.num_parameters()}


def _embedding(context):
    return context.reference.embedding.to_dict()


def _can_steer(context):
    rated = (context.held_out.surface_ratings[context.surfaces], context.training.ratings)
    return context.pipe.dale is not None and all(np.isfinite(ratings).all(-1).any() for ratings in rated)


def _kept(path, conditions, make, context):
    """The result in a file if it was made under these conditions, else a new one, which replaces it."""
    try:
        stored = read_json(path, "JSON")
    except (FileNotFoundError, ValueError):
        stored = {}
    if stored.get("conditions") == conditions and "result" in stored:
        return stored["result"]
    result = make(context)
    write_text(path, json.dumps({"conditions": conditions, "result": result}, allow_nan=False))
    return result


def _conditions(context, checkpoint):
    """What a result depends on, as JSON."""
    facts = os.stat(context.held_out.path)
    named = context.embedding and getattr(context.embedding, "__qualname__", type(context.embedding).__qualname__)
    state = {
        "checkpoint": folder_digest(checkpoint),
        "data": [facts.st_size, facts.st_mtime_ns],
        "split": context.split,
        "baseline_surfaces": context.baseline_surfaces,
        "seed": context.seed,
        "settings": asdict(context.settings),
        "guidance_scales": context.guidance_scales,
        "embedding": named and f"{context.embedding.__module__}:{named}",
        "vibromaf": context.vibromaf,
        "pipeline": [context.steps, context.default_guidance],
        "threads": torch.get_num_threads(),
        "versions": _versions(),
        "machine": machine_facts(),
        "code": _code_digest(),
    }
    return json.loads(json.dumps(state))


def _code_digest():
    """SHA-256 over the source of what is measured, not of how it is told: other code, another result."""
    digest = hashlib.sha256()
    root = Path(__file__).parents[1]
    for path in sorted(root.rglob("*.py")):
        if path.parent.name in ("cli", "export", "study") or path.name in _TELLING:
            continue
        digest.update(str(path.relative_to(root)).encode() + path.read_bytes())
    return digest.hexdigest()


def folder_digest(folder):
    """SHA-256 over the configs and weights of a checkpoint folder, whatever else lies there: reports, checkpoints."""
    folder, digest = Path(folder), hashlib.sha256()
    index = folder / _TOLD[0]
    ours = {*_TOLD, DISTILLED, *(read_json(index, "the index of a checkpoint") if index.is_file() else ())}
    for path in sorted(folder.rglob("*")):
        place = path.relative_to(folder)
        if place.parts[0] in ours and path.suffix in (".json", ".safetensors"):
            digest.update(str(place).encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()


def _data(context):
    held_out, train = context.held_out, context.train
    return {
        "name": Path(held_out.path).name,
        "source": held_out.source,
        "split": context.split,
        "unit": held_out.unit,
        "sampling_rate": held_out.sampling_rate,
        "band": list(held_out.band),
        "surfaces": len(set(context.surfaces.tolist())),
        "segments": len(context.surfaces),
        "rater_alpha": _alpha(held_out.reliability),
        "training_surfaces": context.baseline_surfaces or len(set(train.surface_ids.tolist())),
        "reference_surfaces": len(set(train.surface_ids.tolist())),
        "reference_segments": len(context.training.textures),
    }


def _alpha(reliability):
    """Cronbach's alpha of the mean rating on each axis, `None` where no two raters answered."""
    if reliability is None:
        return None
    return {
        axis: None if np.isnan(alpha) else float(alpha)
        for axis, alpha in zip(reliability.axes, reliability.alpha, strict=True)
    }


def _versions():
    found = {"python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = None
    return found


def leaves(entry, path=()):
    """All leaves below an entry of a report: pairs of path and leaf."""
    if is_leaf(entry):
        yield path, entry
    elif isinstance(entry, dict | list):
        for key, value in entry.items() if isinstance(entry, dict) else enumerate(entry):
            yield from leaves(value, (*path, key))

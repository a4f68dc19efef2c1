"""`python examples/publish.py`: a trained pipeline as a small, documented checkpoint folder."""

import argparse
import json
import os
import shutil
from pathlib import Path

import numpy as np

from ..checkpoints import DISTILLED

CARD = """---
library_name: diffusers
license: apache-2.0
pipeline_tag: other
tags: [tactile, haptics, texture, friction, diffusion]
---

# {name}

Force that a finger feels while it slides, from perceptual ratings: LCTG and DALE of tactile_diffusers {version}.

    from tactile_diffusers import TactileTexturePipeline
    pipe = TactileTexturePipeline.from_pretrained(folder)
    out = pipe(ratings=[[1.5, 0.0, -1.0]])  # five steps of the second-order sampler

{distilled}It is loaded by this package's class, not by `DiffusionPipeline`. Weights are stored in half precision
and load as float32.

## What it was trained on

{source}: {surfaces}. Virtual surfaces are simulated: they show what the method
can do, not how real surfaces feel. Normal force {normal_force}, {speed}; textures are
band-passed to {low:g}-{high:g} Hz. Prepared by examples/prepare_data.py.

## How it was trained

{runs}
## Limits

- Ratings beyond the training surfaces' range are extrapolated: {ranges}.
- A texture is what one finger feels at the reference speed; other speeds are for playback to derive.
- No person has felt these textures yet: figures judge signals, not perception.
"""

DISTILLED_CARD = f"""A decoder for two steps, or one, in place of five lies beside it:

    lctg = LCTGModel.from_pretrained(folder, subfolder="{DISTILLED}")
    pipe = TactileTexturePipeline.from_pretrained(folder, lctg=lctg)

"""

RUN = """### {title}

    accelerate launch {script} {arguments}

{segments} segments, {steps} optimiser steps, {minutes:.0f} minutes on {machine}; torch {torch}, diffusers {diffusers}.
Last training loss {loss:.4f}; last validation: {validation}.

![{title}]({picture})
"""


def parse_arguments(argv=None):
    """Arguments of the command."""
    parser = argparse.ArgumentParser(prog="publish.py", description="Store a trained pipeline small and documented.")
    parser.add_argument("--checkpoint", type=Path, required=True, metavar="FOLDER", help="trained pipeline")
    parser.add_argument(
        "--runs",
        type=Path,
        nargs="+",
        required=True,
        metavar="FOLDER",
        help="output folders of its trainings, in order",
    )
    parser.add_argument("--lctg", type=Path, metavar="FOLDER", help="take LCTG from here: same encoder, better decoder")
    parser.add_argument("--distilled", type=Path, metavar="FOLDER", help="output folder of distill_lctg.py, goes along")
    parser.add_argument("--data", type=Path, required=True, metavar="PREPARED.h5", help="what it was trained on")
    parser.add_argument("--output", type=Path, required=True, metavar="FOLDER")
    parser.add_argument("--note", default="", help="a sentence on how the trainings were run, for the card")
    arguments = parser.parse_args(argv)
    for run in [*arguments.runs, *([arguments.distilled] if arguments.distilled else [])]:
        if not (run / "training.json").is_file():
            parser.error(f"argument --runs: {run} has no training.json; it is written by the training scripts")
    return arguments


def _command(record):
    """The arguments of a run, without those that say nothing about the result."""
    left_out = {"quiet", "resume_from_checkpoint", "report_to", "logging_dir", "tracker_project_name"}
    words = []
    for name, value in record["arguments"].items():
        if name in left_out or value is False:
            continue
        words.append(f"--{name}" if value is True else f"--{name} {Path(value).name if '/' in str(value) else value}")
    return " ".join(words)


def describe_run(run, picture):
    """One training as Markdown, from `training.json` and `log.jsonl`."""
    record = json.loads((run / "training.json").read_text())
    entries = [json.loads(line) for line in (run / "log.jsonl").read_text().splitlines()]
    last = [entry for entry in entries if "train/loss" in entry][-1]
    validations = [entry for entry in entries if any(key.startswith("validation/") for key in entry)]
    found = (
        {k.split("/")[1]: v for k, v in validations[-1].items() if k.startswith("validation/")} if validations else {}
    )
    return RUN.format(
        title=run.name,
        script=record["script"],
        arguments=_command(record),
        segments=record["segments"],
        steps=record["steps"],
        minutes=last["seconds"] / 60,
        machine=record["machine"],
        loss=last["train/loss"],
        validation=", ".join(f"{name} {value:.3f}" for name, value in found.items()) or "none",
        picture=picture,
        **record["versions"],
    )


def _replace_lctg(pipe, folder):
    """Gives `pipe` the LCTG of another pipeline folder.

    Raises:
        ValueError: if its encoder differs: DALE was trained on the latents of the one that `pipe` has; or if it does
            not fit the other components.
    """
    from tactile_diffusers import LCTGModel
    from tactile_diffusers.models.lctg import same_encoder
    from tactile_diffusers.pipelines.inputs import check_components

    other = LCTGModel.from_pretrained(folder, subfolder="lctg", dtype=pipe.lctg.dtype)
    if not same_encoder(other, pipe.lctg):
        raise ValueError(f"--lctg {folder} has another encoder than --checkpoint: DALE would speak another language.")
    pipe.register_modules(lctg=other)
    check_components(pipe.lctg, pipe.feature_extractor, pipe.dale)  # what the weights of an encoder do not tell


def _add_distilled(pipe, folder, output):
    """Stores the distilled LCTG of a training beside the pipeline.

    Raises:
        ValueError: if its encoder is not the pipeline's.
    """
    from tactile_diffusers import LCTGModel
    from tactile_diffusers.models.lctg import same_encoder

    lctg = LCTGModel.from_pretrained(folder, subfolder=DISTILLED, dtype=pipe.lctg.dtype)
    if not same_encoder(lctg, pipe.lctg):
        raise ValueError(f"--distilled {folder} has another encoder than --checkpoint: DALE's latents do not fit it.")
    lctg.save_pretrained(str(output / DISTILLED))


def _normal_force(data):
    """The limits of normal force that the segments were cut within, in words."""
    if np.isnan(data.friction_coefficients).all():
        return "not measured"  # limits of a channel that the source lacks are skipped
    limits = data.attributes["limits"]["normal_force"]
    return "not limited" if limits is None else f"{limits[0]:g}-{limits[1]:g} N"


def main(argv=None):
    """Runs the command: writes the folder under a temporary name, then renames it."""
    arguments = parse_arguments(argv)
    import torch

    from tactile_diffusers import TactileTexturePipeline, __version__

    from ..data import PreparedDataset

    pipe = TactileTexturePipeline.from_pretrained(str(arguments.checkpoint), dtype=torch.float16)
    if arguments.lctg is not None:
        _replace_lctg(pipe, arguments.lctg)
    data = PreparedDataset(arguments.data, "train")
    temporary = arguments.output.with_name(f".{arguments.output.name}.unfinished")
    shutil.rmtree(temporary, ignore_errors=True)
    pipe.save_pretrained(str(temporary))
    if arguments.distilled is not None:
        _add_distilled(pipe, arguments.distilled, temporary)
    for path in temporary.rglob("*.json"):  # where it was on this machine is nobody's business
        config = json.loads(path.read_text())
        if config.pop("_name_or_path", None) is not None:
            path.write_text(json.dumps(config, indent=2, sort_keys=True) + "\n")
    runs = []
    for run in [*arguments.runs, *([arguments.distilled] if arguments.distilled else [])]:
        picture = f"loss_{run.name}.png"
        shutil.copyfile(run / "loss.png", temporary / picture)
        runs.append(describe_run(run, picture))
    config, extractor = pipe.dale.config, pipe.feature_extractor
    seconds = data.segment_samples / data.sampling_rate
    ranges = ", ".join(
        f"{axis} {low:.1f} to {high:.1f}"
        for axis, (low, high) in zip(config.rating_axes, config.ratings_range or [], strict=False)
    )
    card = CARD.format(
        name=arguments.output.name,
        distilled="" if arguments.distilled is None else DISTILLED_CARD,
        version=__version__,
        source=data.source,
        surfaces=f"{len(set(data.surface_ids))} training surfaces, {len(data)} segments of {seconds:.2f} s",
        normal_force=_normal_force(data),
        speed="speed unknown" if config.reference_speed is None else f"speed about {config.reference_speed:.0f} mm/s",
        low=extractor.band[0],
        high=extractor.band[1],
        runs="\n".join([*runs, f"{arguments.note}\n" if arguments.note else ""]),
        ranges=ranges or "not recorded",
    )
    (temporary / "README.md").write_text(card)
    shutil.rmtree(arguments.output, ignore_errors=True)
    os.replace(temporary, arguments.output)
    size = sum(path.stat().st_size for path in arguments.output.rglob("*") if path.is_file())
    print(f"{arguments.output}: {size / 1e6:.1f} MB")
    return 0

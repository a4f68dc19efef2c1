"""The model card of a checkpoint, README.md.

The training scripts write it for what they leave behind, `examples/publish.py` for what it stores.
"""

import json
import re
import shlex
from pathlib import Path

import numpy as np
import torch
from huggingface_hub import ModelCardData

from ..checkpoints import DISTILLED
from ..data.card.markdown import limits_in_words, table
from ..data.splits import SPLITS
from ..io.files import write_text
from ..models import RatingStatistics
from ..pipelines.hub import CARD_FILE, forget_folders, upload_checkpoint
from ..version import __version__
from ..virtual.generate import SOURCE as VIRTUAL
from .card_runs import describe_run

TAGS = ["tactile", "haptics", "texture", "friction", "diffusion"]
#: Licences of data that the Hub knows by name; https://huggingface.co/docs/hub/repositories-licenses
HUB_LICENCES = re.compile(r"apache-2\.0|mit|cc0-1\.0|cc-by(-nc)?(-sa|-nd)?-[234]\.0|odbl|pddl|cdla-permissive-[12]\.0")
#: Numbers that preparation noted of a file, told apart from what the source noted.
_PREPARATION = {"version", "sampling_rate", "segment_samples", "filter_order", "filter_passes", "split_seed"}

CARD = """---
{metadata}
---

# {name}

{what} of tactile_diffusers {version}.

## Usage

```python
{usage}
```

{where}
Load it by this package's class: the snippet that the Hub shows, with `DiffusionPipeline`, does not run.{precision}

{distilled}## Training data

{data}

## Configuration

{configuration}

## Training

{runs}

## Evaluation

{report}

## Limits

{limits}
"""

LOCAL = "Run this in the folder around the checkpoint's; elsewhere write its path in place of `{place}`."
ON_THE_HUB = "`{place}` is its name on the Hub; the path of a copy will do as well."

HALF = "\nWeights are stored in half precision and load as float32."

GENERATES = "Force that a finger feels while it slides, from perceptual ratings: LCTG and DALE"
RECONSTRUCTS = "Force that a finger feels while it slides, encoded to latents and decoded again: LCTG"
DECODES = "A decoder for few steps, distilled from that of `{teacher}`: LCTG"

GENERATING = """out = pipe(ratings={ratings})  # {axes}, in z-scores
print(out.textures.shape, out.sampling_rate, out.friction_coefficient)  # newtons, Hz"""

RECONSTRUCTING = """texture = 0.01 * np.random.default_rng(0).standard_normal({samples})  # N: put a recording here
out = pipe.reconstruct(texture, sampling_rate={rate})
print(out.textures.shape, out.sampling_rate)  # newtons, Hz"""

WITH_DISTILLED = """A decoder for fewer steps lies beside it:

```python
{usage}
```

"""

EVALUATE = """None yet. On surfaces that training has not seen:

```bash
{command}
```
"""

PUBLISH = """
Its tables and figures take the place of these lines when the checkpoint is published:

```bash
python examples/publish.py --checkpoint {place} --runs {runs} --data {data} --report report --output published
```
"""


def write_card(
    folder, pipe, dataset, runs, place=None, teacher=None, licence=None, warnings=None, report=None, note=""
):
    """Writes the model card of a checkpoint, and copies the loss curves of its trainings beside it.

    Args:
        folder (`str` or `Path`): the checkpoint's; it gets `README.md` and `loss_<n>.png`.
        pipe (`TactileTexturePipeline`): what is in the folder; without DALE, or with a distilled LCTG, too.
        dataset (`PreparedDataset`): what it was trained on: the training view.
        runs (`Sequence[str` or `Path]`): output folders of its trainings, in order, with `training.json`.
        place (`str`, *optional*): title, and what the usage loads from; defaults to the folder's name.
        teacher (`str`, *optional*): the pipeline whose place the folder's distilled decoder takes, where the folder
            holds no pipeline.
        licence (`str`, *optional*): of the weights, as the Hub names it; defaults to that of the data.
        warnings (`str`, *optional*): those of the data card, in Markdown.
        report (`str`, *optional*): results of an evaluation, in Markdown, its pictures relative to the folder.
        note (`str`): a sentence on how the trainings were run.

    Raises:
        OSError: if the folder cannot be written to.
    """
    folder = Path(folder)
    place = place or folder.resolve().name
    if teacher is not None and Path(teacher).is_dir():
        teacher = Path(teacher).resolve().name  # where it is on this machine is nobody's business
    beside = teacher is None and (folder / DISTILLED).is_dir()
    told = [describe_run(Path(run), folder, number) for number, run in enumerate(runs, start=1)]
    card = CARD.format(
        metadata=_metadata(licence or str(dataset.attributes.get("licence", "unknown"))),
        name=place,
        what=_what(pipe, teacher),
        version=__version__,
        place=place,
        usage=usage(pipe, dataset, place, teacher),
        where=(ON_THE_HUB if "/" in place else LOCAL).format(place=place),
        precision=HALF if pipe.dtype == torch.float16 else "",
        distilled=WITH_DISTILLED.format(usage=usage_of_distilled(pipe, dataset, place)) if beside else "",
        data=_data(dataset, warnings),
        configuration=_configuration(pipe),
        runs="\n\n".join([*told, *([note] if note else [])]),
        report=(report or _how_to_evaluate(place, dataset, runs, teacher)).strip(),
        limits="\n".join(f"- {limit}" for limit in _limits(pipe, dataset)),
    )
    write_text(folder / CARD_FILE, card)


def _metadata(licence):
    """The YAML block: library, licence, tags."""
    named = licence.strip().lower().replace(" ", "-")
    known = HUB_LICENCES.fullmatch(named)
    facts = {"license": named} if known else {"license": "other", "license_name": licence}
    return ModelCardData(library_name="diffusers", pipeline_tag="other", tags=TAGS, **facts).to_yaml()


def _what(pipe, teacher):
    if teacher is not None:
        return DECODES.format(teacher=teacher)
    return RECONSTRUCTS if pipe.dale is None else GENERATES


# --- usage: code that runs as it is printed, in the folder around the checkpoint's


def usage(pipe, dataset, place, teacher=None):
    """Python that loads a checkpoint and makes a texture.

    Args:
        pipe, dataset, teacher: as in `write_card`.
        place (`str`): what `from_pretrained` is given.

    Returns:
        `str`
    """
    if teacher is None:
        return _program(pipe, dataset, ["TactileTexturePipeline"], [_load(place)])
    lines = [
        _load_distilled(place),
        f'scheduler = VDDIMScheduler.from_pretrained({_text(place)}, subfolder="scheduler")',
    ]
    names = ["LCTGModel", "TactileTexturePipeline", "VDDIMScheduler"]
    return _program(pipe, dataset, names, [*lines, _load(teacher, "lctg=lctg, scheduler=scheduler")])


def usage_of_distilled(pipe, dataset, place):
    """The same with the decoder that lies beside the pipeline in the folder."""
    lines = [_load_distilled(place), _load(place, "lctg=lctg")]
    return _program(pipe, dataset, ["LCTGModel", "TactileTexturePipeline"], lines)


def _text(value):
    return json.dumps(value, ensure_ascii=False)  # in the quotes that code is formatted with


def _load(place, parts=""):
    return f"pipe = TactileTexturePipeline.from_pretrained({', '.join(filter(None, [_text(place), parts]))})"


def _load_distilled(place):
    return f'lctg = LCTGModel.from_pretrained({_text(place)}, subfolder="{DISTILLED}")'


def _program(pipe, dataset, names, lines):
    imports = f"from tactile_diffusers import {', '.join(names)}"
    if pipe.dale is not None:
        rated = np.isfinite(dataset.surface_ratings).any()
        axes = ", ".join(pipe.dale.config.rating_axes)
        use = GENERATING.format(ratings="[[1.5, 0.0, -1.0]]" if rated else "None", axes=axes if rated else "unrated")
        return "\n".join([imports, "", *lines, use])
    rate, extractor = pipe.feature_extractor.delivery_rate, pipe.feature_extractor
    samples = round(pipe.lctg.config.segment_samples * rate / extractor.sampling_rate)
    return "\n".join(["import numpy as np", "", imports, "", *lines, RECONSTRUCTING.format(samples=samples, rate=rate)])


# --- training data and configuration


def _data(dataset, warnings):
    attributes, name = dataset.attributes, Path(dataset.path).name
    seconds = dataset.segment_samples / dataset.sampling_rate
    splits = {split: dataset.splits.count(split) for split in SPLITS if split in dataset.splits}
    conditions = limits_in_words(attributes["limits"]) if dataset.subset == "filtered" else "none of force and speed"
    rows = {
        "source": dataset.source,
        "licence": attributes.get("licence", "none stated"),
        "also noted": ", ".join(_noted(attributes)),
        "surfaces": ", ".join(f"{split} {count}" for split, count in splits.items()),
        "trained on": f"{len(dataset)} segments of {seconds:.4g} s, of {len(set(dataset.surface_ids))} surfaces",
        "explorers": dataset.explorers,
        "ratings": _ratings(dataset),
        "unit of force": "N" if dataset.unit == "N" else "1: uncalibrated, so levels are relative to one count",
        "limits of segments": conditions,
        "friction coefficient": "unknown: no normal force" if np.isnan(dataset.friction_coefficients).all() else "",
        "band-pass": "{:g}–{:g} Hz, order {}, passes {}".format(
            *dataset.band, attributes["filter_order"], attributes["filter_passes"]
        ),
        "turnarounds": attributes["turnarounds"],
        "prepared by": f"`examples/prepare_data.py`, as `{name}`",
    }
    parts = [table(("", ""), [row for row in rows.items() if row[1] != ""], align="---")]
    notes = [line for line in attributes["report"].splitlines() if line.startswith("note: ")]
    if notes:
        parts.append("\n".join(f"- {note.removeprefix('note: ')}" for note in notes))
    if warnings is not None:
        parts.append(f"Warnings of its data card:\n\n{warnings}")
    else:
        command = f"python examples/inspect_data.py --recordings recordings.h5 --prepared {shlex.quote(name)}"
        parts.append(f"Its data card, with warnings: `{command} --output card`.")
    return "\n\n".join(parts)


def _noted(attributes):
    """Numbers that the source noted of itself: a virtual one its seed and recipe."""
    for name, value in attributes.items():
        if name not in _PREPARATION and isinstance(value, int | float) and not isinstance(value, bool):
            yield f"{name} {value:g}" if isinstance(value, float) else f"{name} {value}"


def _ratings(dataset):
    rated = np.isfinite(dataset.surface_ratings).any(axis=-1).sum()
    if not rated:
        return "none"
    words = f"of {rated} surfaces"
    if dataset.single_ratings is not None:
        words += f" by {len(dataset.single_ratings)} raters"
    if dataset.reliability is None:
        return words
    pairs = zip(dataset.reliability.axes, dataset.reliability.alpha, strict=True)
    alphas = ", ".join(f"{axis} {alpha:.2f}" for axis, alpha in pairs if np.isfinite(alpha))
    return f"{words}; Cronbach's alpha: {alphas}" if alphas else words


def _configuration(pipe):
    lctg, dale, extractor = pipe.lctg, pipe.dale, pipe.feature_extractor
    networks = {"LCTG": lctg, "DALE": dale, "rating estimator": pipe.rating_estimator}
    sizes = [f"{name} {part.num_parameters() / 1e6:.3g} million" for name, part in networks.items() if part is not None]
    samplers = {"LCTG": pipe.scheduler} | ({} if dale is None else {"DALE": pipe.dale_scheduler})
    frames, hop = lctg.config.segment_samples // lctg.config.latent_hop, lctg.config.latent_hop
    steps = dict(zip(samplers, pipe.resolve_steps(), strict=False))
    rows = {
        "parameters": ", ".join(sizes),
        "latents": f"{lctg.config.latent_channels} channels, of which DALE makes {lctg.base_channels}",
        "frames": f"{frames} a segment, of {hop} samples each",
        "steps by default": ", ".join(f"{name} {count}" for name, count in steps.items()),
        "samplers": ", ".join(f"{name} {_sampler(scheduler)}" for name, scheduler in samplers.items()),
        "sampling rates": f"{extractor.sampling_rate} Hz inside, {extractor.delivery_rate} Hz delivered",
        "band": "{:g}–{:g} Hz".format(*extractor.band),
    }
    if dale is not None:
        speed = dale.config.reference_speed
        rows["reference speed"] = "unknown" if speed is None else f"{speed:.0f} mm/s"
    return table(("", ""), rows.items(), align="---")


def _sampler(scheduler):
    order = scheduler.config.get("multistep_order")
    return type(scheduler).__name__ + ("" if order is None else f" of order {order}")


def _limits(pipe, dataset):
    if dataset.source == VIRTUAL:
        yield "Virtual surfaces are simulated: they show what the method can do, not how real surfaces feel."
    if pipe.dale is not None:
        statistics = RatingStatistics.from_config(pipe.dale.config)
        pairs = zip(pipe.dale.config.rating_axes, statistics.range or [], strict=False)
        ranges = ", ".join(f"{axis} {low:.1f} to {high:.1f}" for axis, (low, high) in pairs) or "not recorded"
        yield f"Ratings beyond the training surfaces' range are extrapolated: {ranges}."
    else:
        yield "It reconstructs textures; to generate them from ratings, train DALE on it (`examples/train_dale.py`)."
    if pipe.lctg.config.distilled_steps is not None:
        yield f"More than {pipe.lctg.config.distilled_steps} steps make it worse: it was distilled to so many."
    yield "A texture is what one finger feels at the reference speed; other speeds are for playback to derive."
    if dataset.unit != "N":
        yield "The force it learned from is uncalibrated: levels are relative to one count of the sensor, not newtons."
    yield "No person has felt these textures yet: figures judge signals, not perception."


def _how_to_evaluate(place, dataset, runs, teacher):
    place, data = place.rsplit("/", 1)[-1], shlex.quote(Path(dataset.path).name)  # of a copy of what is on the Hub
    if teacher is not None:
        command = f"python examples/benchmarks/decoder.py --checkpoint {shlex.quote(teacher)} --data {data}"
        return EVALUATE.format(command=f"{command} --decoders {shlex.quote(f'distilled={place}')} --output report")
    place = shlex.quote(place)
    command = f"python examples/evaluate.py --checkpoint {place} --data {data} --output report"
    names = " ".join(shlex.quote(Path(run).resolve().name) for run in runs)
    return EVALUATE.format(command=command) + PUBLISH.format(place=place, runs=names, data=data)


def send_to_hub(args):
    """Sends what a training leaves behind to the Hub, as its arguments say (`add_hub_arguments`).

    Raises:
        huggingface_hub.errors.HfHubHTTPError: if the Hub refuses; the folder is whole by then.
    """
    forget_folders(args.output_dir)
    name = args.hub_model_id or Path(args.output_dir).resolve().name
    upload_checkpoint(args.output_dir, name, args.hub_token, args.hub_private_repo or None)

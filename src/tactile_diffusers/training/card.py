"""The end of a training: the model card of a checkpoint (README.md, from `model_card.jinja`), and the Hub.

The training scripts write the card for what they leave behind, `examples/publish.py` for what it stores.
"""

import json
import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import torch
from huggingface_hub import EvalResult, ModelCard, ModelCardData

from ..checkpoints import DISTILLED
from ..data.splits import SPLITS
from ..io.files import atomic_path, write_text
from ..io.locks import unlock_folder
from ..io.reading import reading
from ..models import RatingStatistics
from ..pipelines.hub import CARD_FILE, forget_folders, upload_checkpoint
from ..signal.constants import VIRTUAL_SOURCE
from ..version import __version__
from .checkpoints import save_result, writing
from .record import is_complete, phases, read_log, read_losses, read_record
from .validation import plot_losses

TEMPLATE = Path(__file__).parent / "model_card.jinja"
TAGS = ["tactile", "haptics", "texture", "friction", "diffusion"]
#: Licences of data that the Hub knows by name; https://huggingface.co/docs/hub/repositories-licenses
HUB_LICENCES = re.compile(r"apache-2\.0|mit|cc0-1\.0|cc-by(-nc)?(-sa|-nd)?-[234]\.0|odbl|pddl|cdla-permissive-[12]\.0")
#: Numbers among a file's attributes that preparation wrote; the others are of the source.
_PREPARATION = {"version", "sampling_rate", "segment_samples", "filter_order", "filter_passes", "split_seed"}
#: Arguments of a training that do not change its result.
_WITHOUT_EFFECT = {
    *("quiet", "resume_from_checkpoint", "overwrite_output_dir", "checkpoints_total_limit"),
    *("logging_dir", "tracker_project_name"),
    *("cache_dir", "push_to_hub", "hub_model_id", "hub_private_repo"),
}

GENERATE = """out = pipe(ratings={ratings})  # {axes}, in z-scores
print(out.textures.shape, out.sampling_rate, out.friction_coefficient)  # newtons, Hz"""

RECONSTRUCT = """texture = 0.01 * np.random.default_rng(0).standard_normal({samples})  # N: put a recording here
out = pipe.reconstruct(texture, sampling_rate={rate})
print(out.textures.shape, out.sampling_rate)  # newtons, Hz"""


def finish(args, save, pipe, dataset, teacher=None):
    """Writes the trained models, the curves of their losses and their card; sends them to the Hub if asked.

    For the main process. Others may write to the output folder afterwards.

    Args:
        args (`argparse.Namespace`): of the training script.
        save (`Callable`): of `save_result`.
        pipe, dataset, teacher: of `write_card`.

    Raises:
        OSError: if something cannot be written: what that is, and whether the models are saved.
        huggingface_hub.errors.HfHubHTTPError: if the Hub refuses; the folder is whole by then.
    """
    output, name = Path(args.output_dir), getattr(args, "hub_model_id", None)
    save_result(output, save)
    with writing("loss.png", output, finished=True):
        plot_losses(output)
    described = phases(output)[-1:] if teacher is not None else phases(output)
    runs = [folder for folder, record in described if is_complete(record)]
    with writing("The model card", output, finished=True):
        write_card(output, pipe, dataset, runs, place=name, teacher=teacher)
    if getattr(args, "push_to_hub", False):
        forget_folders(output)
        upload_checkpoint(output, name or output.resolve().name, args.hub_token, args.hub_private_repo or None)
    unlock_folder(output)


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
        teacher (`str`, *optional*): the pipeline whose decoder is replaced, if the folder holds a distilled decoder and
            no pipeline.
        licence (`str`, *optional*): of the weights, as the Hub names it; defaults to that of the data.
        warnings (`str`, *optional*): those of the data card, in Markdown.
        report (`str`, *optional*): results of an evaluation, in Markdown, its pictures relative to the folder.
        note (`str`): a sentence on how the trainings were run.

    Raises:
        OSError: if the folder cannot be written to.
        ValueError: if the record of a training is damaged.
    """
    folder = Path(folder)
    name = place or folder.resolve().name
    if teacher is not None and Path(teacher).is_dir():
        teacher = Path(teacher).resolve().name  # without the folders of this machine
    trainings = [describe_run(Path(run), folder, number) for number, run in enumerate(runs, start=1)]
    has_distilled = teacher is None and (folder / DISTILLED).is_dir()
    evaluate, publish = _commands(name, dataset, runs, teacher)
    card = ModelCard.from_template(
        _metadata(licence or str(dataset.attributes.get("licence", "unknown")), name, dataset, trainings),
        template_path=str(TEMPLATE),
        name=name,
        version=__version__,
        summary=_summary(pipe, teacher),
        teacher=teacher,
        usage=_usage(pipe, dataset, name, teacher),
        distilled_usage=_usage(pipe, dataset, name, decoder="distilled") if has_distilled else "",
        half=pipe.dtype == torch.float16,
        data=_data(dataset),
        data_file=shlex.quote(Path(dataset.path).name),
        notes=re.findall("^note: (.*)", dataset.attributes["report"], re.M),
        warnings=warnings,
        configuration=_configuration(pipe),
        trainings=trainings,
        note=note,
        report=report and report.strip(),
        evaluate=evaluate,
        publish=publish,
        simulated=dataset.source == VIRTUAL_SOURCE,
        ranges=_ranges(pipe),
        distilled_steps=pipe.lctg.config.distilled_steps,
        uncalibrated=dataset.unit != "N",
    )
    write_text(folder / CARD_FILE, f"{str(card).strip()}\n")


def _metadata(licence, name, dataset, trainings):
    """The YAML block; the last validation stands for the results until somebody evaluates the checkpoint."""
    known = HUB_LICENCES.fullmatch(licence.strip().lower().replace(" ", "-"))
    facts = {"license": known[0]} if known else {"license": "other", "license_name": licence}
    scores = trainings[-1]["scores"] if trainings else {}
    source = {"dataset_type": "tactile-recordings", "dataset_name": dataset.source, "dataset_split": "validation"}
    results = [EvalResult("other", metric_type=key, metric_value=value, **source) for key, value in scores.items()]
    return ModelCardData(
        library_name="diffusers", pipeline_tag="other", tags=TAGS, model_name=name, eval_results=results, **facts
    )


def _summary(pipe, teacher):
    if teacher is not None:
        return f"A decoder for few steps, distilled from that of `{teacher}`: LCTG"
    if pipe.dale is None:
        return "Force that a finger feels while it slides, encoded to latents and decoded again: LCTG"
    return "Force that a finger feels while it slides, from perceptual ratings: LCTG and DALE"


def _usage(pipe, dataset, place, teacher=None, decoder=None):
    """Python that runs as it is printed, in the folder around the checkpoint's."""
    names, lines, arguments = ["TactileTexturePipeline"], [], [json.dumps(place, ensure_ascii=False)]
    if decoder is not None:
        arguments.append(f'decoder="{decoder}"')
    if teacher is not None:
        names.insert(0, "LCTGModel")
        lines.append(f'lctg = LCTGModel.from_pretrained({arguments[0]}, subfolder="{DISTILLED}")')
        arguments = [json.dumps(teacher, ensure_ascii=False), "lctg=lctg"]
    imports = f"from tactile_diffusers import {', '.join(names)}\n"
    lines = [imports, *lines, f"pipe = TactileTexturePipeline.from_pretrained({', '.join(arguments)})"]
    if pipe.dale is not None:
        rated, axes = np.isfinite(dataset.ratings.mean).any(), ", ".join(pipe.dale.config.rating_axes)
        use = GENERATE.format(ratings="[[1.5, 0.0, -1.0]]" if rated else "None", axes=axes if rated else "unrated")
        return "\n".join([*lines, use])
    rate, extractor = pipe.feature_extractor.delivery_rate, pipe.feature_extractor
    samples = round(pipe.lctg.config.segment_samples * rate / extractor.sampling_rate)
    return "\n".join(["import numpy as np\n", *lines, RECONSTRUCT.format(samples=samples, rate=rate)])


def _data(dataset):
    """The rows of the table of the training data."""
    attributes = dataset.attributes
    seconds = dataset.segment_samples / dataset.sampling_rate
    splits = {split: dataset.splits.count(split) for split in SPLITS if split in dataset.splits}
    of_source = {
        key: value
        for key, value in attributes.items()
        if key not in _PREPARATION and isinstance(value, int | float) and not isinstance(value, bool)
    }
    low, high = dataset.band
    return {
        "source": dataset.source,
        "licence": attributes.get("licence", "none stated"),
        "settings of the source": ", ".join(
            f"{key} {value:g}" if isinstance(value, float) else f"{key} {value}" for key, value in of_source.items()
        ),
        "surfaces": ", ".join(f"{split} {count}" for split, count in splits.items()),
        "trained on": f"{len(dataset)} segments of {seconds:.4g} s, of {len(set(dataset.surface_ids))} surfaces",
        "explorers": dataset.explorers,
        "ratings": _ratings(dataset),
        "unit of force": "N" if dataset.unit == "N" else "1: uncalibrated, so levels are relative to one count",
        "limits of segments": _limits(attributes["limits"]) if dataset.subset == "filtered" else "none",
        "friction coefficient": "unknown: no normal force" if np.isnan(dataset.friction_coefficients).all() else "",
        "band-pass": f"{low:g}–{high:g} Hz, order {attributes['filter_order']}, passes {attributes['filter_passes']}",
        "turnarounds": attributes["turnarounds"],
        "prepared by": f"`examples/prepare_data.py`, as `{Path(dataset.path).name}`",
    }


def _limits(limits):
    channels = (("normal force", limits["normal_force"], "N"), ("speed", limits["speed"], "mm/s"))
    words = [
        f"any {name}" if bounds is None else f"{name} {bounds[0]:g}–{bounds[1]:g} {unit}"
        for name, bounds, unit in channels
    ]
    words += [f"deviations up to {limits['longest_excursion']:g} s bridged", f"segments of {limits['seconds']:g} s"]
    return ", ".join([*words, f"{100 * limits['overlap']:.0f} % overlap"])


def _ratings(dataset):
    rated, raters = np.isfinite(dataset.ratings.mean).any(axis=-1).sum(), dataset.ratings.single
    if not rated:
        return "none"
    words = f"of {rated} surfaces" + ("" if raters is None else f" by {len(raters)} raters")
    if dataset.ratings.reliability is None:
        return words
    pairs = zip(dataset.ratings.reliability.axes, dataset.ratings.reliability.alpha, strict=True)
    alphas = ", ".join(f"{axis} {alpha:.2f}" for axis, alpha in pairs if np.isfinite(alpha))
    return f"{words}; Cronbach's alpha: {alphas}" if alphas else words


def _configuration(pipe):
    """The rows of the table of the models."""
    config, dale, extractor = pipe.lctg.config, pipe.dale, pipe.feature_extractor
    networks = {"LCTG": pipe.lctg, "DALE": dale, "rating estimator": pipe.rating_estimator}
    sizes = [f"{name} {part.num_parameters() / 1e6:.3g} million" for name, part in networks.items() if part is not None]
    samplers = {"LCTG": pipe.scheduler} | ({} if dale is None else {"DALE": pipe.dale_scheduler})
    orders = {name: part.config.get("multistep_order") for name, part in samplers.items()}
    rows = {
        "parameters": ", ".join(sizes),
        "latents": f"{config.latent_channels} channels, of which DALE generates {pipe.lctg.base_channels}",
        "frames": f"{config.segment_samples // config.latent_hop} a segment, of {config.latent_hop} samples each",
        "default steps": ", ".join(f"{name} {n}" for name, n in zip(samplers, pipe.resolve_steps(), strict=False)),
        "samplers": ", ".join(
            f"{name} {type(part).__name__}" + (f" of order {orders[name]}" if orders[name] is not None else "")
            for name, part in samplers.items()
        ),
        "sampling rates": f"{extractor.sampling_rate} Hz inside, {extractor.delivery_rate} Hz delivered",
        "band": "{:g}–{:g} Hz".format(*extractor.band),
    }
    if dale is not None:
        speed = dale.config.reference_speed
        rows["reference speed"] = "unknown" if speed is None else f"{speed:.0f} mm/s"
    return rows


def _ranges(pipe):
    if pipe.dale is None:
        return ""
    statistics = RatingStatistics.from_config(pipe.dale.config)
    pairs = zip(pipe.dale.config.rating_axes, statistics.range or [], strict=False)
    return ", ".join(f"{axis} {low:.1f} to {high:.1f}" for axis, (low, high) in pairs) or "not recorded"


def _commands(name, dataset, runs, teacher):
    """Shell commands that evaluate and publish the checkpoint; a distilled decoder is not published alone."""
    place, data = shlex.quote(name.rsplit("/", 1)[-1]), shlex.quote(Path(dataset.path).name)  # of a copy, if on the Hub
    if teacher is not None:
        command = f"python examples/benchmarks/decoder.py --checkpoint {shlex.quote(teacher)} --data {data}"
        return f"{command} --decoders distilled={place} --output report", ""
    runs = " ".join(shlex.quote(Path(run).resolve().name) for run in runs)
    publish = f"python examples/publish.py --checkpoint {place} --runs {runs} --data {data} --report report"
    evaluate = f"python examples/evaluate.py --checkpoint {place} --data {data} --output report"
    return evaluate, f"{publish} --output published"


# --- trainings


def describe_run(run, folder, number):
    """What the card says of one training, from `training.json` and `log.jsonl`.

    Args:
        run (`Path`): its output folder.
        folder (`Path`): of the card; the loss curve is copied into it.
        number (`int`): of the training, for the name of that copy.

    Returns:
        `dict`: "name", "command", "segments", "steps", "time", "machine", "versions", "loss", "validation", "scores"
            (of the last validation, by name) and "picture"; empty where nothing is known.

    Raises:
        ValueError: if `training.json` is damaged or lacks something.
    """
    with reading(run / "training.json", "the record of a training", "Copy it again from where it was written."):
        record, losses = read_record(run), read_losses(run)
        words = [f"accelerate launch {record['script']}", *_options(record["changed"])]
        versions = ", ".join(f"{name} {version}" for name, version in record["versions"].items())
        machine, processes = record["machine"], record["processes"]
        facts = {"segments": record["segments"], "steps": record["steps"], "versions": versions}
    seconds = losses[-1].get("seconds") if losses else None
    validations = [entry for entry in read_log(run) if any(key.startswith("validation/") for key in entry)]
    last = validations[-1] if validations else {}
    scores = {key.split("/")[1]: value for key, value in last.items() if key.startswith("validation/")}
    return facts | {
        "name": run.resolve().name,
        "command": " \\\n    ".join(words),
        "time": "an unknown time" if seconds is None else _duration(seconds),
        "machine": machine + (f", {processes} processes" if processes > 1 else ""),
        "loss": f"{losses[-1]['train/loss']:.4f}" if losses else "",
        "validation": ", ".join(f"{name} {value:.3f}" for name, value in scores.items()),
        "scores": scores,
        "picture": _copy_curve(run, folder, number),
    }


def _duration(seconds):
    return f"{seconds:.0f} s" if seconds < 120 else f"{seconds / 60:.0f} minutes"


def _options(arguments):
    """Options of a command, without those that have no effect on the result, and without this machine's folders."""
    for name, value in arguments.items():
        # a command without a tracker needs no extra package
        if name in _WITHOUT_EFFECT or (name == "report_to" and value != "none"):
            continue
        if isinstance(value, bool):
            yield f"--{name}" if value else f"--no-{name}"
            continue
        values = value if isinstance(value, list | tuple) else [value]
        yield " ".join([f"--{name}", *(shlex.quote(Path(str(v)).name if "/" in str(v) else str(v)) for v in values)])


def _copy_curve(run, folder, number):
    """The name of the loss curve of a training in the folder of the card; empty if there is none."""
    curve, name = run / "loss.png", f"loss_{number}.png"
    if not curve.is_file():
        return ""
    if run.resolve() == folder.resolve():
        return curve.name  # it is there already
    with atomic_path(folder / name) as temporary:
        shutil.copyfile(curve, temporary)
    return name

"""Speed against error: reconstructions of held-out segments by models trained on the same data, at several steps."""

from functools import partial

import numpy as np
import torch
from peers import ANCHOR, BFLOAT16, OURS, STEPS, load
from speed import seconds_of

from tactile_diffusers.evaluation.metrics.statistics import leaf
from tactile_diffusers.evaluation.sampling import reconstruct
from tactile_diffusers.evaluation.tables import markdown_table, title
from tactile_diffusers.models import LCTGModel
from tactile_diffusers.pipelines import TactileTexturePipeline, find_decoders
from tactile_diffusers.pipelines.recorded import DEFAULT_STEPS
from tactile_diffusers.signal import band_edges, nine_band_error_db

DISTILLED = "ours, distilled"
#: Steps of each model.
SWEEP = {OURS: (1, 2, 3, 5, 10, 25), BFLOAT16: (5,), DISTILLED: (1, 2), ANCHOR: (1, 2, 3, 5, 10, 25, 50)}
_MARKERS = {OURS: "o", BFLOAT16: "^", DISTILLED: "*", ANCHOR: "s"}


def models(arguments, pipe, checkpoint):
    """Pipelines to compare: name -> pipeline."""
    made = {OURS: pipe, BFLOAT16: load(checkpoint, torch.bfloat16)}
    folder = arguments.distilled or find_decoders(checkpoint).get("distilled")
    if folder is not None:
        made[DISTILLED] = TactileTexturePipeline.from_pipe(pipe, lctg=LCTGModel.from_pretrained(str(folder)))
    if arguments.anchor is not None:
        made[ANCHOR] = load(arguments.anchor)
    return made


def measure(arguments, pipe, checkpoint):
    """Nine-band errors and seconds of every model and number of steps.

    Args:
        arguments (`argparse.Namespace`): "data" (`Path`), "segments", "seed", "repeats", "quiet", "anchor" and
            "distilled" (`Path` or `None`).
        pipe (`TactileTexturePipeline`): ours, from `checkpoint`.
        checkpoint (`str`): its folder.

    Returns:
        `dict`: "about" (`str`) and "models", name -> steps -> {"nine_band_db" (leaf over surfaces), "seconds"}.
    """
    from tactile_diffusers.data import PreparedDataset
    from tactile_diffusers.evaluation.held_out import check_fit

    held_out, compared = PreparedDataset(arguments.data, "test"), models(arguments, pipe, checkpoint)
    for name, one in compared.items():
        check_fit(one, held_out, name)
    rows = held_out.non_overlapping(1, arguments.seed)[: arguments.segments]
    real, surfaces = held_out.textures(rows), held_out.surface_ids[rows]
    rate, edges = held_out.sampling_rate, band_edges(9, held_out.band)
    runs, found = {}, {name: {} for name in compared}
    for name, one in compared.items():
        made = one.encode(real[:1], rate)
        for steps in SWEEP[name]:
            textures = reconstruct(one, real, rate, steps, arguments.seed, quiet=arguments.quiet)
            error = leaf(nine_band_error_db(textures, real, rate, edges), surfaces)
            found[name][str(steps)] = {"nine_band_db": error}
            runs[name, str(steps)] = partial(one.decode, made.latents, made.level, num_inference_steps=steps)
    for (name, steps), seconds in seconds_of(runs, arguments.repeats).items():
        found[name][steps]["seconds"] = seconds
    about = (
        f"{len(real)} segments of {len(np.unique(surfaces))} test surfaces of `{held_out.source}`, encoded and decoded "
        "by models trained on the same data. Seconds are those of decoding one segment, batch 1."
    )
    return {"about": about, "models": found}


def markdown(found):
    """Table of `measure`, with the times as fast as the paper's configuration: at 10 steps, and at its least error."""
    anchor, references = found["models"].get(ANCHOR), {}
    if anchor:
        best = min(anchor, key=lambda steps: anchor[steps]["nine_band_db"]["mean"])
        references = {f"{steps} steps": anchor[steps] for steps in dict.fromkeys((str(STEPS), best)) if steps in anchor}
    rows = {}
    for name, by_steps in found["models"].items():
        for steps, entry in by_steps.items():
            row = {"nine-band error, dB": entry["nine_band_db"], "s": entry["seconds"]}
            for label, reference in references.items():
                error = reference["nine_band_db"]["mean"]
                row[f"times as fast as the {ANCHOR}, {label} ({error:.2f} dB)"] = (
                    reference["seconds"] / entry["seconds"]
                )
            rows[f"{name}, {steps} steps"] = row
    labels = {key: (key, 1) for row in rows.values() for key in row}
    labels |= {"nine-band error, dB": ("nine-band error, dB", 3), "s": ("s", 4)}
    table = markdown_table(rows, labels=labels, interval=True)
    return f"{title('Speed against error', 4)}{found['about']}\n\n{table}\n"


def front(found):
    """(seconds, error) of all that nothing else beats in both, by rising seconds."""
    points = sorted(
        (entry["seconds"], entry["nine_band_db"]["mean"])
        for by_steps in found["models"].values()
        for entry in by_steps.values()
    )
    kept = []
    for seconds, error in points:
        if not kept or error < kept[-1][1]:
            kept.append((seconds, error))
    return kept


def plot(found, output_path):
    """Error against seconds, one line a model, points labelled by their steps, above the front of what is best."""
    from matplotlib.ticker import StrMethodFormatter

    from tactile_diffusers.evaluation.report_figures import figure_panels

    with figure_panels(output_path, 1, 1, (8, 4.6)) as panels:
        panel = panels[0, 0]
        panel.step(*zip(*front(found), strict=True), where="post", color="grey", alpha=0.3, linewidth=6, label="front")
        for index, (name, by_steps) in enumerate(found["models"].items()):
            seconds = [entry["seconds"] for entry in by_steps.values()]
            errors = [entry["nine_band_db"]["mean"] for entry in by_steps.values()]
            size = 13 if name == DISTILLED else 6
            panel.plot(seconds, errors, marker=_MARKERS[name], markersize=size, color=f"C{index}", label=name)
            for steps, x, y in zip(by_steps, seconds, errors, strict=True):
                default = name == OURS and steps == str(DEFAULT_STEPS)
                panel.annotate(
                    f"{steps} (default)" if default else steps,
                    (x, y),
                    (0, -16 if name in (DISTILLED, BFLOAT16) else 8),
                    textcoords="offset points",
                    ha="center",
                    fontsize=8,
                    color=f"C{index}",
                )
        panel.set(xscale="log", yscale="log", xlabel="s per segment of 1.64 s, batch 1", ylabel="nine-band error, dB")
        for axis in (panel.xaxis, panel.yaxis):
            axis.set_major_formatter(StrMethodFormatter("{x:g}"))
        panel.margins(x=0.08, y=0.15)
        panel.grid(alpha=0.3, which="both")
        panel.legend(loc=(0.4, 0.24), fontsize=9, title="numbers: steps of LCTG")

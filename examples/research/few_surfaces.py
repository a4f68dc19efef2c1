#!/usr/bin/env python
"""How many surfaces does adapting need? Errors on unseen surfaces of a world, against the number of its surfaces.

    python examples/research/other_world.py --surfaces 260 other.h5
    python examples/prepare_data.py --source recordings --recordings other.h5 --prepared other_prepared.h5 \
        --validation 10 --test 50
    python examples/prepare_data.py --source virtual --surfaces 260 --seconds 20 --seed 50 --impulsiveness 1.6 \
        --agreement 0.7 --rating_correlation 0.2 -0.7 0.0 --validation 10 --test 50 --output settings.h5 \
        --prepared settings_prepared.h5
    python examples/research/few_surfaces.py "another world"=other_prepared.h5 \
        "recipe 3, other settings"=settings_prepared.h5 --output examples/results/adaptation

Writes `figures.json` and `curve.png` into the output folder, and the page beside it, `<output>.md`.
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from accelerate.state import AcceleratorState, GradientState
from sklearn.linear_model import Ridge

from tactile_diffusers import LCTGModel, TactileTexturePipeline, bundled_checkpoint
from tactile_diffusers.data import PreparedDataset
from tactile_diffusers.evaluation.envelopes import surface_means
from tactile_diffusers.evaluation.held_out import open_held_out
from tactile_diffusers.evaluation.metrics.statistics import leaf
from tactile_diffusers.evaluation.sampling import generate, noise_seeds
from tactile_diffusers.signal import band_levels_db
from tactile_diffusers.training.adapting import adapt

sys.path.append(str(Path(__file__).parents[1]))  # examples, for `report`

from report.sections.generation import surface_correlation, unseen_errors
from report.sections.regression import best_polynomial

COUNTS = (3, 5, 10, 20, 50, 100, 200)
#: Of them also with the decoder trained, and by a DALE that is trained anew.
TRAINED, ANEW = (50, 200), (50,)
#: Updates of a DALE that is trained anew, behind the bundled LCTG.
ANEW_STEPS = 1000
TRAIN_DALE = Path(__file__).parents[1] / "train_dale.py"
PER_SURFACE = 4
INTRO = """# How many surfaces does adapting need?

The bundled checkpoint was trained on simulated surfaces. What does it do on surfaces of another world, as it is,
recalibrated in closed form, and, where it knows their textures less well than its own, with its decoder trained further
(`tactile-diffusers adapt`), against a DALE trained anew and regressions on the same surfaces?
All judge by {surfaces} unseen surfaces: the error of the mean spectrum of {takes} takes from a surface's ratings (nine
bands, dB), the kernel distance (KTD) over that of real textures, and the correlation of log friction. Intervals are
over surfaces (95 %); "over ridge" is paired. A row is one draw of surfaces; the decoder takes one step, a DALE trained
anew ({anew} updates behind the bundled LCTG, from {few} surfaces) its default number.

    python examples/research/few_surfaces.py {words} --output {output}
"""


def measure(pipe, data, takes, seed):
    """Errors per surface (surfaces,), and leaves of KTD over real and of log friction."""
    ids = np.unique(data.surfaces)
    groups = np.repeat(ids, takes)
    ratings = data.dataset.ratings.mean[groups]
    made = generate(pipe, ratings, noise_seeds(seed, len(groups)), data.rate, data.dataset.segment_samples, steps=None)
    few = np.concatenate([np.flatnonzero(groups == one)[:PER_SURFACE] for one in ids])  # as many as there are real ones
    points = data.reference.embed(made.textures[few])
    distances = data.reference.distances(points, groups[few], (data.points, data.surfaces))
    friction = surface_correlation(np.log(made.friction_coefficients), groups, np.log(data.frictions), data.surfaces)
    return unseen_errors(data, made.textures, groups), distances["ktd_excess"], friction


def regressions(data, count):
    """Errors per surface of regressions on the mean levels of so many training surfaces."""
    train = PreparedDataset(data.train.path, "train", max_surfaces=count)
    rows = train.non_overlapping(data.per_surface, data.seed)
    ids = train.surface_ids[rows]
    ratings = train.ratings.mean[np.unique(ids)]
    targets = surface_means(band_levels_db(train.textures(rows), data.rate, data.edges), ids)
    wanted, real = data.dataset.ratings.mean[np.unique(data.surfaces)], surface_means(data.bands, data.surfaces)
    predicted = {
        "mean spectrum": np.tile(targets.mean(0), (len(real), 1)),
        "ridge": Ridge(1.0).fit(ratings, targets).predict(wanted),
        "best polynomial": best_polynomial(ratings, targets, data.seed)[0](wanted),
    }
    return {name: np.abs(values - real).mean(-1) for name, values in predicted.items()}


def adapted(path, count, fine_tuning):
    """The bundled pipeline, adapted to so many training surfaces; `None` if "auto" leaves its decoder as it is."""
    pipe = TactileTexturePipeline.from_pretrained(bundled_checkpoint())
    pipe.set_progress_bar_config(disable=True)
    if count:
        AcceleratorState._reset_state(reset_partial_state=True)
        GradientState._reset_state()
        dataset = PreparedDataset(path, "train", "filtered", pipe.feature_extractor.sampling_rate, max_surfaces=count)
        with TemporaryDirectory() as folder:
            given = pipe.lctg_distilled
            adapt(pipe, dataset, folder, fine_tuning=fine_tuning)
            if fine_tuning == "auto" and pipe.lctg_distilled is given:
                return None
    return pipe


def trained_anew(path, count):
    """The bundled pipeline with a DALE that knows nothing but so many training surfaces."""
    with TemporaryDirectory() as folder:
        words = ["--train_data_dir", path, "--pretrained_model_name_or_path", "bundled", "--output_dir", folder]
        words += ["--max_train_surfaces", str(count), "--max_train_steps", str(ANEW_STEPS), "--validation_samples", "0"]
        quiet = ["--report_to", "none", "--quiet", "--overwrite_output_dir"]
        subprocess.run([sys.executable, str(TRAIN_DALE), *words, *quiet], check=True)
        student = LCTGModel.from_pretrained(bundled_checkpoint(), subfolder="lctg_distilled")
        pipe = TactileTexturePipeline.from_pretrained(folder, lctg_distilled=student)
    pipe.set_progress_bar_config(disable=True)
    return pipe


def rows_of(path, args):
    """One row for each count and method: dicts of "surfaces", "method", leaves."""
    data, found = open_held_out(path, "test", PER_SURFACE, args.seed), []
    zero = measure(adapted(path, 0, "no"), data, args.takes, args.seed)
    for count in args.counts:
        fits = regressions(data, count)
        methods = {"zero-shot": zero, "recalibrated": measure(adapted(path, count, "no"), data, args.takes, args.seed)}
        if count in TRAINED and (pipe := adapted(path, count, "auto")) is not None:
            methods["and the decoder trained"] = measure(pipe, data, args.takes, args.seed)
        if count in ANEW:
            methods["trained anew"] = measure(trained_anew(path, count), data, args.takes, args.seed)
        methods |= {name: (errors, None, None) for name, errors in fits.items()}
        for name, (errors, distance, friction) in methods.items():
            row = {"surfaces": count, "method": name, "nine_band_db": leaf(errors), "ktd_over_real": distance}
            found.append(row | {"over_ridge_db": leaf(errors - fits["ridge"]), "log_friction_r": friction})
            print(count, name, *(round(row[key]["mean"], 2) for key in list(row)[2:] if row[key]), flush=True)
    return found


def cell(entry):
    """A leaf as text: mean and interval."""
    if entry is None or entry["mean"] is None:
        return "–"
    interval = "" if entry["interval"] is None else " [{:.2f}, {:.2f}]".format(*entry["interval"])
    return f"{entry['mean']:.2f}{interval}"


def table(rows):
    """The rows of a world as Markdown."""
    keys = ["nine_band_db", "over_ridge_db", "ktd_over_real", "log_friction_r"]
    lines = [
        "| surfaces | method | unseen surfaces, dB | over ridge, dB | KTD over real | log friction, r |",
        "|---" * 6 + "|",
    ]
    lines += [f"| {r['surfaces']} | {r['method']} | " + " | ".join(cell(r[key]) for key in keys) + " |" for r in rows]
    return "\n".join(lines)


def plot(worlds, path):
    """Error of unseen surfaces, and KTD, against the number of surfaces: a column of panels for each world."""
    from matplotlib.figure import Figure

    figure = Figure((5 * len(worlds) + 1.5, 6.4), layout="constrained")
    keys = {"nine_band_db": "error of mean spectra, dB", "ktd_over_real": "KTD over real"}
    methods = dict.fromkeys(row["method"] for rows in worlds.values() for row in rows)
    for axes, (key, label) in zip(figure.subplots(2, len(worlds), squeeze=False), keys.items(), strict=True):
        for axis, (name, rows) in zip(axes, worlds.items(), strict=True):
            for number, method in enumerate(methods):
                own = [row for row in rows if row["method"] == method and row[key] is not None]
                means = [row[key]["mean"] for row in own]
                axis.plot([row["surfaces"] for row in own], means, f"C{number}o-", label=method)
            axis.set(xscale="log", title=name, xlabel="surfaces", ylabel=label)
            axis.minorticks_off()
            counts = sorted({row["surfaces"] for row in rows})
            axis.set_xticks(counts, list(map(str, counts)))
            axis.grid(alpha=0.3)
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside right upper", fontsize=8)
    figure.savefig(path, dpi=120)


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("worlds", nargs="+", metavar="NAME=PREPARED.h5", help="with test surfaces, best 50")
    parser.add_argument("--counts", type=int, nargs="+", default=list(COUNTS), help="training surfaces")
    parser.add_argument("--takes", type=int, default=16, help="textures of each unseen surface")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--output", type=Path, required=True, help="folder; the page lies beside it")
    args = parser.parse_args(argv)
    worlds = dict(word.rsplit("=", 1) for word in args.worlds)
    args.output.mkdir(parents=True, exist_ok=True)
    found = {}
    for name, path in worlds.items():
        found[name] = rows_of(path, args)
        write(found, worlds, args)


def write(found, worlds, args):
    """The figures, the picture and the page of the worlds so far."""
    (args.output / "figures.json").write_text(json.dumps(found, indent=1) + "\n")
    plot(found, args.output / "curve.png")
    words = " ".join(f'"{name}"={Path(path).name}' for name, path in worlds.items())
    surfaces = "/".join(str(rows[0]["nine_band_db"]["n"]) for rows in found.values())
    page = INTRO.format(
        surfaces=surfaces,
        takes=args.takes,
        words=words,
        output=args.output.name,
        anew=ANEW_STEPS,
        few=" and ".join(map(str, ANEW)),
    )
    page += f"\n![errors over the number of surfaces]({args.output.name}/curve.png)\n"
    page += "".join(f"\n## {name}\n\n{table(rows)}\n" for name, rows in found.items())
    args.output.with_suffix(".md").write_text(page)


if __name__ == "__main__":
    main()

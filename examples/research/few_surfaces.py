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

Writes `figures.json`, `figures.md` and `curve.png` into the output folder, and the page beside it, `<output>.md`.
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from accelerate.state import AcceleratorState, GradientState
from sklearn.dummy import DummyRegressor
from sklearn.linear_model import Ridge

from tactile_diffusers import LCTGModel, TactileTexturePipeline, bundled_checkpoint
from tactile_diffusers.data import PreparedDataset
from tactile_diffusers.evaluation.metrics.statistics import leaf
from tactile_diffusers.evaluation.truth import LEAST_EFFECTIVE_SIZE
from tactile_diffusers.signal import band_levels_db, level
from tactile_diffusers.training.adapting import adapt

sys.path.append(str(Path(__file__).parents[1]))  # examples, for `report`

from report.changes import against_real, comparisons, counted
from report.envelopes import surface_means
from report.held_out import open_held_out
from report.sampling import generate, noise_seeds
from report.sections.generation import surface_correlation, unseen_errors
from report.sections.regression import best_polynomial
from report.virtual_truth import truth_of

from tactile_diffusers.evaluation.metrics.rating_effects import texture_measures

REGRESSIONS = ("ridge", "best polynomial")
COUNTS = (3, 5, 10, 20, 50, 100, 200)
#: Of them also with networks trained further, and by a DALE that is trained anew; those whose rows the page shows.
TRAINED, ANEW, SHOWN = (50, 200), (50,), 50
#: Updates of a DALE that is trained anew, behind the bundled LCTG.
ANEW_STEPS = 1000
TRAIN_DALE = Path(__file__).parents[1] / "train_dale.py"
PER_SURFACE = 4
#: Control: one rating alone at these values, so many textures each; fresh surfaces of a world that can be continued.
VALUES, CONTROL_TAKES, TRUTH_SURFACES = (-1.0, 1.0), 200, 600
INTRO = """# How many surfaces does adapting need?

The bundled checkpoint was trained on simulated surfaces. What does it do on surfaces of another world, as it is,
recalibrated in closed form, and with networks trained further (`tactile-diffusers adapt`: DALE's U-Net, and the decoder
where it knows their textures less well than its own), against a DALE trained anew and regressions on the same surfaces?
All judge by {surfaces} unseen surfaces: the error of the mean spectrum of {takes} takes from a surface's ratings (nine
bands, dB), the kernel distance (KTD) over that of real textures, and the correlation of log friction. "Changes right"
counts what a rating of −1 or +1 alone, the others open, does to level, shape and log friction, against surfaces of the
world with such ratings: right within 20 % or their 95 % interval, direction included. Intervals are over surfaces
(95 %). In another world the lab's surfaces are among those with such ratings, for no fresh ones can be had: that
favours what is fitted to them. Ratings are z-scores over all 200 training surfaces of a world; a lab of three has a
coarser scale. A row is one draw of surfaces; the decoder takes one step, a DALE trained anew ({anew} updates behind the
bundled LCTG, from {few} surfaces) its default number.

    python examples/research/few_surfaces.py {words} --output {output}
"""


class Control:
    """What one rating alone does, beside what it is between surfaces of a world, `HeldOutData` of it in `data`."""

    def __init__(self, data):
        self.data, self.axes = data, data.dataset.ratings.axes
        self.requests = {
            (axis, value): np.array([value if name == axis else np.nan for name in self.axes])
            for axis in self.axes
            for value in VALUES
        }
        self.truth = truth_of(
            PreparedDataset(data.dataset.path, "all"), list(self.requests.values()), self.measures,
            surfaces=TRUTH_SURFACES, seed=data.seed,
        )  # fmt: skip

    def measures(self, textures, levels, frictions):
        """Level, shape and log friction of textures (n, samples)."""
        return texture_measures(textures, levels, frictions, self.data.rate, self.data.edges)

    def counted(self, change):
        """Leaf of how many changes are right; `change` takes an axis' index and ratings (n, axes) of one rating."""
        found = {axis: {} for axis in self.axes}
        for (axis, value), request in self.requests.items():
            ratings = self.truth.draw_ratings(request, CONTROL_TAKES)
            found[axis][str(value)] = against_real(change(self.axes.index(axis), ratings), self.truth, request)
        return counted(comparisons(found, LEAST_EFFECTIVE_SIZE))["changes"]

    def of_pipeline(self, pipe, seed):
        """The count of a pipeline's textures; each condition starts from the same noise as nothing rated."""

        def mean(ratings):
            seeds = noise_seeds(seed, len(ratings))
            made = generate(pipe, ratings, seeds, self.data.rate, self.data.dataset.segment_samples, steps=None)
            measured = self.measures(made.textures, made.levels, made.friction_coefficients)
            return {name: values.mean(0) for name, values in measured.items()}

        base = mean(np.full((CONTROL_TAKES, len(self.axes)), np.nan))
        return self.counted(lambda axis, ratings: {name: v - base[name] for name, v in mean(ratings).items()})

    def of_regression(self, fit, ratings, measured):
        """The count of `fit(points, targets)`, a function of one rating for each measure of surfaces."""
        middle = {name: values.mean(0) for name, values in measured.items()}

        def change(axis, requested):
            fits = {
                name: fit(ratings[:, [axis]], values.reshape(len(ratings), -1)) for name, values in measured.items()
            }
            means = {name: np.squeeze(one(requested[:, [axis]]).mean(0)) for name, one in fits.items()}
            return {name: value - middle[name] for name, value in means.items()}

        return self.counted(change)


def measure(pipe, control, takes, seed):
    """Errors per surface (surfaces,), and leaves of KTD over real, of log friction and of the changes right."""
    data = control.data
    ids = np.unique(data.surfaces)
    groups = np.repeat(ids, takes)
    ratings = data.dataset.ratings.mean[groups]
    made = generate(pipe, ratings, noise_seeds(seed, len(groups)), data.rate, data.dataset.segment_samples, steps=None)
    few = np.concatenate([np.flatnonzero(groups == one)[:PER_SURFACE] for one in ids])  # as many as there are real ones
    points = data.reference.embed(made.textures[few])
    distances = data.reference.distances(points, groups[few], (data.points, data.surfaces))
    friction = surface_correlation(np.log(made.friction_coefficients), groups, np.log(data.frictions), data.surfaces)
    right = control.of_pipeline(pipe, seed)
    return unseen_errors(data, made.textures, groups), distances["ktd_excess"], friction, right


def regressions(control, count):
    """The same of regressions on the means of so many training surfaces: no textures, so no KTD."""
    data = control.data
    train = PreparedDataset(data.train.path, "train", max_surfaces=count)
    rows = train.non_overlapping(data.per_surface, data.seed)
    ids = train.surface_ids[rows]
    ratings = train.ratings.mean[np.unique(ids)]
    textures = train.textures(rows)
    targets = surface_means(band_levels_db(textures, data.rate, data.edges), ids)
    measured = control.measures(textures, level(textures), train.friction_coefficients[rows])
    measured = {name: surface_means(values, ids) for name, values in measured.items()}
    wanted, real = data.dataset.ratings.mean[np.unique(data.surfaces)], surface_means(data.bands, data.surfaces)
    methods = {
        "mean spectrum": lambda points, values: DummyRegressor().fit(points, values).predict,
        "ridge": lambda points, values: Ridge(1.0).fit(points, values).predict,
        "best polynomial": lambda points, values: best_polynomial(points, values, data.seed)[0],
    }
    return {
        name: (
            np.abs(fit(ratings, targets)(wanted) - real).mean(-1), None, None,
            control.of_regression(fit, ratings, measured),
        )
        for name, fit in methods.items()
    }  # fmt: skip


def adapted(path, count, fine_tuning):
    """The bundled pipeline, adapted to so many training surfaces; 0 = as it is."""
    pipe = TactileTexturePipeline.from_pretrained(bundled_checkpoint())
    pipe.set_progress_bar_config(disable=True)
    if count:
        AcceleratorState._reset_state(reset_partial_state=True)
        GradientState._reset_state()
        dataset = PreparedDataset(path, "train", "filtered", pipe.feature_extractor.sampling_rate, max_surfaces=count)
        with TemporaryDirectory() as folder:
            adapt(pipe, dataset, folder, fine_tuning=fine_tuning)
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
    control, found = Control(open_held_out(path, "test", PER_SURFACE, args.seed)), []

    def measured(pipe):
        return measure(pipe, control, args.takes, args.seed)

    zero = measured(adapted(path, 0, "no"))
    for count in args.counts:
        fits = regressions(control, count)
        methods = {"zero-shot": zero, "recalibrated": measured(adapted(path, count, "no"))}
        if count in TRAINED:
            methods["and networks trained"] = measured(adapted(path, count, "auto"))
        if count in ANEW:
            methods["trained anew"] = measured(trained_anew(path, count))
        for name, (errors, distance, friction, right) in (methods | fits).items():
            row = {"surfaces": count, "method": name, "nine_band_db": leaf(errors), "ktd_over_real": distance}
            row |= {"over_ridge_db": leaf(errors - fits["ridge"][0]), "log_friction_r": friction}
            found.append(row | {"changes_right": right})
            print(count, name, *(round(leaf["mean"], 2) for leaf in list(found[-1].values())[2:] if leaf), flush=True)
    return found


def cell(key, entry):
    """A leaf as text: mean and interval; of a count, of how many."""
    if entry is None or entry["mean"] is None:
        return "–"
    if key == "changes_right":
        return f"{entry['mean']:.0f} of {entry['n']}"
    interval = "" if entry["interval"] is None else " [{:.2f}, {:.2f}]".format(*entry["interval"])
    return f"{entry['mean']:.2f}{interval}"


def table(rows):
    """The rows of a world as Markdown."""
    keys = ["nine_band_db", "over_ridge_db", "ktd_over_real", "log_friction_r", "changes_right"]
    lines = [
        "| surfaces | method | unseen surfaces, dB | over ridge, dB | KTD over real | friction, r | changes right |",
        "|---" * 7 + "|",
    ]
    cells = [" | ".join(cell(key, row[key]) for key in keys) for row in rows]
    lines += [f"| {row['surfaces']} | {row['method']} | {text} |" for row, text in zip(rows, cells, strict=True)]
    return "\n".join(lines)


def side_by_side(worlds):
    """A line for each method, of the worlds (name -> rows) beside one another, as Markdown."""
    keys = {"nine_band_db": "unseen surfaces, dB", "ktd_over_real": "KTD over real", "changes_right": "changes right"}
    lines = ["| | " + " | ".join(f"{name}: {label}" for name in worlds for label in keys.values()) + " |"]
    lines.append("|---" * (len(worlds) * len(keys) + 1) + "|")
    for rows in zip(*worlds.values(), strict=True):
        cells = [cell(key, row[key]) for row in rows for key in keys]
        lines.append(f"| {rows[0]['method']} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def plot(worlds, path):
    """Error of unseen surfaces, and KTD, against the number of surfaces: a column of panels for each world."""
    from matplotlib.figure import Figure

    figure = Figure((5 * len(worlds) + 1.5, 9), layout="constrained")
    keys = {"nine_band_db": "error of mean spectra, dB", "ktd_over_real": "KTD over real"}
    keys["changes_right"] = "changes right"
    methods = dict.fromkeys(row["method"] for rows in worlds.values() for row in rows)
    for axes, (key, label) in zip(figure.subplots(3, len(worlds), squeeze=False), keys.items(), strict=True):
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


def _ahead(name, rows):
    """At how many numbers of surfaces recalibrating is nearer to unseen surfaces than regressions are: a sentence."""
    errors = {(row["method"], row["surfaces"]): row["nine_band_db"]["mean"] for row in rows}
    counts = sorted({row["surfaces"] for row in rows})
    won = {other: sum(errors["recalibrated", n] < errors[other, n] for n in counts) for other in REGRESSIONS}
    words = " and ".join(f"{other} at {number} of {len(counts)}" for other, number in won.items())
    return f"In {name}, recalibrating is nearer to unseen surfaces than {words} numbers of surfaces."


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
    page += f"\n{' '.join(_ahead(name, rows) for name, rows in found.items())}\n"
    page += f"\n![errors over the number of surfaces]({args.output.name}/curve.png)\n"
    whole = "".join(f"\n## {name}\n\n{table(rows)}\n" for name, rows in found.items())
    (args.output / "figures.md").write_text(f"# All figures of [How many surfaces?](../{args.output.name}.md)\n{whole}")
    shown = {name: [row for row in rows if row["surfaces"] == SHOWN] or rows for name, rows in found.items()}
    page += f"\n{side_by_side(shown)}\n"
    page += f"\nThe table is of {SHOWN} surfaces. The other numbers, differences to ridge, paired, and friction: "
    page += f"[all figures]({args.output.name}/figures.md).\n"
    args.output.with_suffix(".md").write_text(page)


if __name__ == "__main__":
    main()

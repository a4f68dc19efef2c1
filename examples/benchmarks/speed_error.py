"""What does a second buy? Seconds of a texture over its distance from real ones, by model and number of steps.

`python examples/benchmarks/speed_error.py --data prepared.h5 --anchor runs/dale_paper --output report`
"""

import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from benchmarking import finish, machine, make_parser, parse, timed_columns, timed_table, timings
from peers import ANCHOR
from speed import RATINGS
from tqdm.auto import tqdm

from tactile_diffusers.cli.program import existing_file, existing_folder, load_pipeline, refuse
from tactile_diffusers.pipelines import TactileTexturePipeline

sys.path.append(str(Path(__file__).parents[1]))  # examples, for `report`

from report.baselines import BaselineRequest
from report.figures import figure_panels, leaf_mean
from report.sampling import generate
from report.sections.context import FULL, QUICK, make_context
from report.sections.generation import matching_rows
from report.sections.second_judge import Takes
from report.tables import title

#: Steps of a model that is not distilled.
STEPS, ANCHOR_STEPS = (1, 2, 3, 5, 10), (1, 2, 3, 5, 10, 25, 50)
REPEATS = 9
KTD, TOLD = "KTD over real", "told from real"
TAKE, BLEND = "another take", "blend of training textures"


def pipelines(pipe, anchor=None):
    """Rows: model -> (pipeline, numbers of steps); `None` = the default call."""
    rows = {"ours, default": (pipe, (None,))}
    if pipe.lctg_distilled is not None:
        rows["ours, teacher of LCTG"] = TactileTexturePipeline.from_pipe(pipe, lctg_distilled=None), STEPS
    return rows | ({} if anchor is None else {ANCHOR: (anchor, ANCHOR_STEPS)})


class Quality:
    """KTD over real, of the textures that evaluate.py generates, and the second judge's share of right answers."""

    def __init__(self, context):
        self.context, self.takes = context, Takes(context)
        ratings, owners = context.requests
        first = np.concatenate([np.flatnonzero(owners == one)[: self.takes.each] for one in self.takes.surfaces])
        rows = np.union1d(matching_rows(context), first)
        self.ratings, self.seeds, owners = ratings[rows], context.seeds(1, len(ratings))[rows], owners[rows]
        # KTD is that of evaluate.py; the judge is given as many takes of its surfaces as there are real ones
        self.counted, self.judged = np.isin(rows, matching_rows(context)), np.searchsorted(rows, first)
        self.owners, self.request = owners[self.counted], BaselineRequest(self.ratings)
        self.real = context.data.points, context.data.surfaces

    def of(self, textures, judged=None):
        """A row of the table, with 95 % intervals over surfaces; `judged` in place of those among the textures."""
        reference = self.context.data.reference
        counted = textures if judged is not None else textures[self.counted]
        ktd = reference.distances(reference.embed(counted), self.owners, self.real)["ktd_excess"]
        judged = textures[self.judged] if judged is None else judged
        _, _, judge, _ = next(self.takes.judge(judged))  # features of the signal, two takes alone
        return {KTD: ktd, TOLD: judge["all"]}

    def model(self, pipe, steps):
        """The row of a pipeline in a number of steps."""
        data, steps = self.context.data, steps or pipe.resolve_steps()[0]
        grid = (data.rate, data.dataset.segment_samples, steps)
        return self.of(generate(pipe, self.ratings, self.seeds, *grid).textures)

    def take(self):
        """The row of other takes of the held-out segments, and of real takes in the place of real ones."""
        return self.of(self.context.baseline_textures["other_take"], self.takes.textures)

    def blend(self):
        """The row of a blend of the training textures with the nearest ratings."""
        return self.of(self.context.baselines["knn_blend"].sample(self.request, self.context.rng("knn_blend")))


def summary(rows):
    """How much faster the fastest row of ours is that is as good as the anchor's best, in both distances."""
    name, best = min(
        ((n, row) for n, row in rows.items() if n.startswith(ANCHOR)), key=lambda item: leaf_mean(item[1][KTD])
    )
    able = [
        n
        for n, r in rows.items()
        if n.startswith("ours") and all(leaf_mean(r[m]) <= leaf_mean(best[m]) for m in (KTD, TOLD))
    ]
    if not able:
        return f"Best in KTD of its rows is {name}; no row of ours is as good in both."
    fastest = min(able, key=lambda n: rows[n]["s"])
    ratio = best["s"] / rows[fastest]["s"]
    return f"Best in KTD of its rows is {name}; {fastest}, is as good or better in both and {ratio:.0f} times as fast."


def plot(rows, path):
    """Both distances over seconds, a line for each model."""
    with figure_panels(path, 1, 2, (11, 4)) as panels:
        for panel, measure in zip(panels[0], (KTD, TOLD), strict=True):
            for model in dict.fromkeys(row["model"] for row in rows.values() if "model" in row):
                own = [
                    (row["s"], leaf_mean(row[measure]), row["steps"])
                    for row in rows.values()
                    if row.get("model") == model
                ]
                panel.plot(*np.transpose([place[:2] for place in own]), "o-", label=model)
                for *place, steps in own:
                    panel.annotate(steps, place, (3, 3), textcoords="offset points", size=7)
            for name, style in ((TAKE, ":"), (BLEND, "--")):
                panel.axhline(leaf_mean(rows[name][measure]), color="grey", linestyle=style, label=name)
            panel.set(xscale="log", xlabel="seconds of a texture, batch 1", ylabel=measure)
        panels[0, 0].set_yscale("symlog", linthresh=1)
        panels[0, 0].set_ylim(bottom=-0.5)
        panels[0, 1].legend(fontsize=7)


def main(argv=None):
    """Measures and writes speed_error.json, speed_error.md and speed_error.png."""
    parser = make_parser("speed_error.py", "Seconds of a texture over its distance from real ones.")
    add = parser.add_argument
    add("--data", type=existing_file, required=True, metavar="PREPARED.h5", help="from examples/prepare_data.py")
    add("--anchor", type=existing_folder, metavar="FOLDER", help="checkpoint of the paper's configuration, with a DALE")
    add("--few", action="store_true", help="measure as few textures as evaluate.py --quick")
    arguments = parse(parser, argv)
    pipe = load_pipeline(arguments.checkpoint)
    anchor = None if arguments.anchor is None else load_pipeline(arguments.anchor)
    try:
        settings = replace(QUICK if arguments.few else FULL, judge_takes=1)
        context = make_context(pipe, arguments.data, "test", settings, arguments.seed, arguments.output)
    except ValueError as error:
        return refuse("speed_error.py", error)
    quality, runs = Quality(context), {}
    rows = {TAKE: quality.take(), BLEND: quality.blend()}
    for model, (one, counts) in pipelines(pipe, anchor).items():
        for steps in tqdm(counts, desc=model, disable=arguments.quiet):
            name = model if steps is None else f"{model}, {steps} step{'s' * (steps > 1)}"
            rows[name] = quality.model(one, steps) | {"model": model, "steps": steps or "1 + 1"}
            runs[name] = partial(one, [RATINGS], num_inference_steps=steps)
    for name, values in timings(runs, REPEATS).items():
        rows[name] |= timed_columns(values)
    arguments.output.mkdir(parents=True, exist_ok=True)
    plot(rows, arguments.output / "speed_error.png")
    found = [] if anchor is None else [summary(rows)]
    labels = {"s": ("s", 3), "spread, %": ("spread, %", 0), KTD: KTD, TOLD: TOLD}
    table = timed_table(rows, labels=labels, interval=True)
    about = (
        f"{len(quality.owners)} textures from the ratings of {len(quality.takes.surfaces)} test surfaces. Told from "
        "real: the second judge's share of right answers, 0.5 is chance. Seconds from ratings to a texture, batch 1, "
        f"medians of {REPEATS} in turn, spread: half the distance of the quartiles over the median. {machine()}."
    )
    text = "\n\n".join([title("Speed against error", 4) + about, table, *found]) + "\n"
    return finish(arguments, "speed_error", {"machine": machine(), "rows": rows, "found": found}, text)


if __name__ == "__main__":
    sys.exit(main())

#!/usr/bin/env python
"""Does an axis that the bundled pipeline does not know work after fifty surfaces?

    python examples/prepare_data.py --source virtual --surfaces 250 --seconds 20 --seed 11 \
        --further_axes regularity fineness warmth --validation 0 --test 50 --output axes_r.h5 --prepared axes.h5
    python examples/research/new_axis.py axes.h5 --output examples/results/new_axis

Adapts to 50 surfaces that raters judged on six axes, and compares what each axis does to the mean spectrum with what it
does among fresh surfaces of the same world: the truth (`evaluation.truth`). Nothing of a friction force tells how warm
a surface is. Writes figures.json, figures.md and responses.png.
"""

import argparse
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import torch

from tactile_diffusers import TactileTexturePipeline, bundled_checkpoint
from tactile_diffusers.data import PreparedDataset
from tactile_diffusers.signal import band_levels_db
from tactile_diffusers.training.adapting import adapt

sys.path.append(str(Path(__file__).parents[1]))  # examples, for `report`

from report.figures import figure_panels
from report.result_files import conditions, stamp, write_results
from report.sampling import generate, noise_seeds
from report.tables import markdown_table
from report.virtual_truth import virtual_truth

VALUES = (-1.0, 1.0)
SURFACES, TAKES, TRUTH_SURFACES, HALVES = 50, 400, 1200, 20


def adapted(path, axes, seed):
    """The bundled pipeline adapted to 50 surfaces of a data set, on these axes alone, and what it said of them."""
    pipe = TactileTexturePipeline.from_pretrained(bundled_checkpoint())
    pipe.set_progress_bar_config(disable=True)
    rate = pipe.feature_extractor.sampling_rate
    dataset = PreparedDataset(path, "train", "filtered", rate, max_surfaces=SURFACES)
    dataset.rating_axes = axes  # as if nobody had asked about the others
    with TemporaryDirectory() as folder:
        adapt(pipe, dataset, folder, fine_tuning="no", seed=seed)  # which changes no slope
        card = (Path(folder) / "README.md").read_text()
    return pipe, [line for line in card.splitlines() if " is new: " in line]


def request(axes, axis=None, value=None):
    return np.array([value if name == axis else np.nan for name in axes], dtype=np.float64)


def measure(textures, levels, frictions):
    """What an axis may change: levels of nine bands, dB, and log friction in the same unit."""
    del levels
    rate = 10_000
    return {"bands": band_levels_db(textures, rate), "friction": 20 * np.log10(np.maximum(frictions, 1e-3))[:, None]}


def changes(pipe, truth, axes, seed):
    """Change of the bands at each request: axis -> (values, bands), with the same noise as an open request."""
    seeds, found = noise_seeds(seed, TAKES), {}

    def mean(one):
        ratings = truth.draw_ratings(one, TAKES)
        made = generate(pipe, ratings, seeds, 10_000, 16384, steps=None)
        return band_levels_db(made.textures, 10_000).mean(0)

    base = mean(request(axes))
    for axis in axes:
        found[axis] = np.stack([mean(request(axes, axis, value)) for value in VALUES]) - base
    return found


def response(found, wanted):
    """How much of a wanted change there is (1 = all): along it, over its size, both as (values, bands)."""
    return float((found * wanted).sum() / np.square(wanted).sum())


def true_changes(truth, axes):
    """The change among real surfaces: axis -> (values, bands)."""
    return {axis: np.stack([truth.change("bands", request(axes, axis, value))[0] for value in VALUES]) for axis in axes}


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path, metavar="PREPARED.h5")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--output", type=Path, required=True)
    args = parser.parse_args(argv)
    dataset = PreparedDataset(args.data, "test").set_axes()
    axes, known = dataset.rating_axes, dataset.rating_axes[:3]
    about = conditions(bundled_checkpoint(), dataset)
    requests = [request(axes), *(request(axes, axis, value) for axis in axes for value in VALUES)]
    truth = virtual_truth(dataset, requests, measure, surfaces=TRUTH_SURFACES, seed=args.seed)
    wanted, rng = true_changes(truth, axes), np.random.default_rng(args.seed)
    pairs = [truth.halves(rng) for _ in range(HALVES)]
    pipe, words = adapted(args.data, axes, args.seed)
    plain, _ = adapted(args.data, known, args.seed)
    found = changes(pipe, truth, axes, args.seed)
    three = changes(plain, _first(truth), known, args.seed)
    rows = {}
    for axis in axes:
        halves = [response(*(true_changes(half, axes)[axis] for half in pair)) for pair in pairs]
        rows[axis] = {
            "size of the true change, dB": float(np.sqrt(np.square(wanted[axis]).mean())),
            "response": response(found[axis], wanted[axis]),
            "without the new axes": response(three[axis], wanted[axis]) if axis in known else None,
            "half over half": float(np.mean(halves)),
            "its spread": float(np.std(halves)),
        }
    one, other = ([[0.5, np.nan, -1.0, *[np.nan] * extra]] for extra in (len(axes) - 3, 0))
    textures = [p(r, generator=torch.Generator().manual_seed(0)).textures for p, r in ((pipe, one), (plain, other))]
    apart = float(np.abs(textures[0] - textures[1]).max() / textures[0].std())
    report = {"conditions": about, "rows": rows, "words": words, "open": apart}
    args.output.mkdir(parents=True, exist_ok=True)
    plot(rows, args.output / "responses.png")
    write_results(args.output, "figures", report, page(report))
    print(page(report))


def page(report):
    """The figures as a table, and what the adapted checkpoint says of its new axes."""
    parts = [markdown_table(report["rows"]), *report["words"], stamp(report["conditions"])]
    return "\n\n".join(parts) + "\n"


def plot(rows, path):
    """Response of each axis, without the new ones too, over what halves of the real surfaces give one another."""
    places = np.arange(len(rows))

    def column(name):
        return np.array([np.nan if row[name] is None else row[name] for row in rows.values()])

    with figure_panels(path, 1, 1, (8, 3.6)) as panels:
        panel, (half, spread) = panels[0, 0], (column("half over half"), column("its spread"))
        panel.bar(places - 0.2, column("response"), 0.4, label="adapted on six axes")
        panel.bar(places + 0.2, column("without the new axes"), 0.4, label="adapted on the first three")
        panel.errorbar(places, half, 2 * spread, fmt="_k", markersize=20, capsize=4, label="half of the real ones")
        panel.axhline(1, color="0.6", linewidth=1)
        panel.set_xticks(places, list(rows))
        panel.set(ylabel="share of the real change")
        panel.legend(fontsize=8)


def _first(truth):
    """The truth as those see it who know the first three axes."""
    from dataclasses import replace

    return replace(truth, ratings=truth.ratings[:, :3])


if __name__ == "__main__":
    main()

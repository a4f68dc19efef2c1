"""`python sensitivity.py`: what a user gets from the sliders if the simulated world's assumptions were others.

Nobody has measured how raters judge the surfaces that a lab will use. So a short DALE is trained on each of several
worlds that differ in one assumption, and its sliders are moved. Beside each stands the world's own data: the regression
of the same measures on the ratings of its training surfaces.
"""

import argparse
import json
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from tqdm.auto import tqdm

from tactile_diffusers import TactileTexturePipeline, VDDIMScheduler
from tactile_diffusers.cli.program import Parser, add_output_argument, program
from tactile_diffusers.data import PreparedDataset, prepare_recordings
from tactile_diffusers.io.argument_types import count
from tactile_diffusers.io.files import atomic_path, write_text
from tactile_diffusers.schedulers import RECOMMENDED
from tactile_diffusers.signal import BAND_HZ, DEVICE_RATE
from tactile_diffusers.training.dale_data import build_dale, encode_dataset, training_states
from tactile_diffusers.training.steps import BatchNoise, DALETrainingStep
from tactile_diffusers.virtual import RATING_CORRELATION, RECIPE_VERSION, generate_recordings

sys.path.append(str(Path(__file__).parents[1]))  # examples, for `report`

from report.tables import markdown_table

#: The assumptions: settings of `generate_recordings`, and the value that stands on the page.
CORRELATIONS = {0.0: (0.4, 0.0, 0.0), -0.5: RATING_CORRELATION, -0.9: (0.4, -0.9, -0.36)}
ASSUMPTIONS = {
    "r(rough, slippery)": {value: {"rating_correlation": pairs} for value, pairs in CORRELATIONS.items()},
    "agreement of raters": {value: {"agreement": value} for value in (0.5, 1.0, 2.0)},
    "impulsiveness": {value: {"impulsiveness": value} for value in (0.0, 1.0, 2.0)},
}
AXES = ("roughness", "bumpiness", "slipperiness")
#: Measures of a texture, and their units.
MEASURES = {"level": "dB", "centroid": "octaves", "friction": "log", "kurtosis": "log"}
SLIDER = (-1.5, -0.75, 0.0, 0.75, 1.5)
#: A DALE of a tenth of the bundled one's size.
SMALL = {"widths": (64, 64, 64), "embedding_dim": 96, "rating_dim": 64}


@dataclass(frozen=True)
class Size:
    """How much is simulated, trained and generated for one world."""

    surfaces: int = 200
    seconds: float = 12.0
    steps: int = 2000
    takes: int = 24


def measure(textures, friction):
    """Level, centre of the spectrum, friction and kurtosis of textures: (n, 4)."""
    textures = np.asarray(textures, dtype=np.float64)
    square = np.mean(textures**2, axis=-1)
    frequency = np.fft.rfftfreq(textures.shape[-1], 1 / DEVICE_RATE)
    power = np.abs(np.fft.rfft(textures)) ** 2 * ((frequency >= BAND_HZ[0]) & (frequency <= BAND_HZ[1]))
    octaves = np.log2(np.maximum(frequency, 1))
    kurtosis = np.mean(textures**4, axis=-1) / square**2
    columns = 10 * np.log10(square), power @ octaves / power.sum(-1), np.log(friction), np.log(kurtosis)
    return np.stack(columns, axis=-1)


def train(pipe, dataset, size, seed):
    """A small DALE, trained on a data set with the training script's own losses; returns the whole pipeline."""
    torch.manual_seed(seed)
    latents = encode_dataset(pipe, dataset, quiet=True)
    dale = build_dale(pipe.lctg, dataset, latents, **SMALL)
    scheduler = VDDIMScheduler(**RECOMMENDED)
    states = training_states(dale, dataset, latents)
    step = DALETrainingStep(dale, scheduler, None, conditioning_weight=0)
    random = BatchNoise(torch.Generator().manual_seed(seed), torch.device("cpu"))
    rows = torch.Generator().manual_seed(seed)
    optimiser = torch.optim.AdamW(dale.parameters(), lr=2e-3, betas=(0.9, 0.99))
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, 2e-3, total_steps=size.steps, pct_start=0.1)
    dale.train()
    for _ in range(size.steps):
        chosen = torch.randint(len(states["state"]), (64,), generator=rows)
        loss, _ = step({name: values[chosen] for name, values in states.items()}, random)
        optimiser.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(dale.parameters(), 1.0)
        optimiser.step()
        schedule.step()
    trained = TactileTexturePipeline(
        **pipe.components | {"dale": dale.eval(), "dale_scheduler": scheduler, "rating_estimator": None}
    )
    trained.set_progress_bar_config(disable=True)
    return trained


def sliders(pipe, takes, seed):
    """Measures of generated textures, (axes, slider positions, takes, measures): one axis moved, the others at 0."""
    found = np.empty((len(AXES), len(SLIDER), takes, len(MEASURES)))
    for axis in range(len(AXES)):
        for place, value in enumerate(SLIDER):
            ratings = np.zeros(len(AXES))
            ratings[axis] = value
            generator = torch.Generator().manual_seed(seed)  # the same noise at every position
            out = pipe([ratings.tolist()], num_textures_per_rating=takes, generator=generator)
            found[axis, place] = measure(out.textures, out.friction_coefficient)
    return found


def regression(dataset):
    """Slopes of the measures over the ratings of the training surfaces, together: (axes, measures)."""
    measured = measure(dataset.textures(np.arange(len(dataset))), dataset.friction_coefficients)
    names = np.unique(dataset.surface_ids)
    means = np.stack([measured[dataset.surface_ids == name].mean(0) for name in names])
    ratings = np.column_stack([dataset.ratings.mean[names], np.ones(len(names))])
    return np.linalg.lstsq(ratings, means, rcond=None)[0][: len(AXES)]


def study(settings, size, seed, folder, pipe):
    """One world: generated, learned, and its sliders moved. A dict that JSON can hold."""
    recordings, prepared = folder / "recordings.h5", folder / "prepared.h5"
    generate_recordings(recordings, size.surfaces, size.seconds, seed=7, quiet=True, **settings)
    prepare_recordings(recordings, prepared, validation=2, test=2, quiet=True)
    dataset = PreparedDataset(prepared, "train")
    found = sliders(train(pipe, dataset, size, seed), size.takes, seed)
    recordings.unlink()
    return {
        "segments": len(dataset),
        "correlation": np.corrcoef(dataset.ratings.mean[np.unique(dataset.surface_ids)].T).tolist(),
        "mean": found.mean(2).tolist(),
        "error": (found.std(2, ddof=1) / np.sqrt(size.takes)).tolist(),
        "slope": np.moveaxis(
            np.polyfit(SLIDER, np.moveaxis(found, 1, 0).reshape(len(SLIDER), -1), 1)[0].reshape(
                len(AXES), size.takes, len(MEASURES)
            ),
            1,
            0,
        ).tolist(),
        "data": regression(dataset).tolist(),
    }


def worlds():
    """{key: (settings, seed)}: every world once, and the recipe's with a second seed."""
    found = {}
    for values in ASSUMPTIONS.values():
        for settings in values.values():
            found[json.dumps({**BASE, **settings})] = ({**BASE, **settings}, 0)
    return found | {"second seed": (BASE, 1)}


BASE = {"rating_correlation": RATING_CORRELATION, "agreement": 1.0, "impulsiveness": 1.0}


def tables(results):
    """A table for each assumption: a row for each slider and measure, a column for each world."""
    parts = []
    for name, values in ASSUMPTIONS.items():
        columns = {
            f"{value:g}": _column(results[json.dumps({**BASE, **settings})]) for value, settings in values.items()
        }
        columns["the recipe, second seed"] = _column(results["second seed"])
        rows = {
            row: {title: column[row] for title, column in columns.items()} for row in columns["the recipe, second seed"]
        }
        parts.append(f"## {name}\n\n{markdown_table(rows)}")
    return "\n\n".join(parts)


def _column(result):
    """Slope of every measure over every slider: generated, and in brackets of the world's data."""
    slopes, data = np.array(result["slope"]), np.array(result["data"])
    column = {}
    for axis, axis_name in enumerate(AXES):
        for number, (name, unit) in enumerate(MEASURES.items()):
            takes = slopes[:, axis, number]
            half = 1.96 * takes.std(ddof=1) / np.sqrt(len(takes))
            column[f"{axis_name}: {name}, {unit}"] = f"{takes.mean():.2f} ± {half:.2f} ({data[axis, number]:.2f})"
    return column


def draw(results, path):
    """Slope of each measure over each slider as curves over each assumption."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 10), dpi=75, layout="constrained")
    panels = figure.subplots(len(MEASURES), len(ASSUMPTIONS), squeeze=False, sharey="row")
    for column, (assumption, values) in enumerate(ASSUMPTIONS.items()):
        found = [results[json.dumps({**BASE, **settings})] for settings in values.values()]
        for row, (name, unit) in enumerate(MEASURES.items()):
            panel = panels[row][column]
            for axis, axis_name in enumerate(AXES):
                slopes = np.array([np.array(one["slope"])[:, axis, row] for one in found])
                half = 1.96 * slopes.std(1, ddof=1) / np.sqrt(slopes.shape[1])
                panel.errorbar(list(values), slopes.mean(1), half, color=f"C{axis}", marker="o", label=axis_name)
                data = [np.array(one["data"])[axis, row] for one in found]
                panel.plot(list(values), data, color=f"C{axis}", linestyle=":")
            panel.axhline(0, color="black", linewidth=0.6)
            panel.set_xlabel(assumption)
            if column == 0:
                panel.set_ylabel(f"{name}, {unit} per sd of the slider")
    handles, labels = panels[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, title="slider moved; dotted: the world's data", ncols=3, loc="outside upper center")
    with atomic_path(path) as temporary:
        FigureCanvasAgg(figure).print_png(temporary)


def page(results, size):
    """The Markdown page."""
    return (
        "# All figures of [What would the sliders do in another world?](../sensitivity.md), recipe "
        f"{RECIPE_VERSION}\n\n"
        f"A short DALE ({size.steps} steps, a tenth of the bundled size) was trained on each world: {size.surfaces} "
        f"surfaces, two fingers, {size.seconds:g} s each, behind the bundled LCTG. One slider moves from {SLIDER[0]:g} "
        f"to {SLIDER[-1]:g} while the others stay at 0. Each cell: change per standard deviation of the slider, with a "
        f"95 % interval over {size.takes} takes, and in brackets the regression of the same measure on the ratings of "
        "the world's own training surfaces. A second seed of the training shows what chance does.\n\n"
        "    python examples/research/sensitivity.py --output examples/results/sensitivity\n\n"
        f"![Slopes over assumptions](sensitivity.png)\n\n{tables(results)}\n"
    )


def main(argv=None):
    """Runs or resumes the study: a world that is already in sensitivity.json is not trained again."""
    parser = Parser(prog=program("sensitivity.py"), description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    add_output_argument(parser, "sensitivity.json, sensitivity.md and sensitivity.png")
    for name, value in vars(Size()).items():
        parser.add_argument(f"--{name}", type=count if isinstance(value, int) else float, default=value, metavar="N")
    arguments = parser.parse_args(argv)
    size = Size(*(getattr(arguments, name) for name in vars(Size())))
    output = Path(arguments.output)
    output.mkdir(parents=True, exist_ok=True)
    stored = output / "sensitivity.json"
    head = {"recipe_version": RECIPE_VERSION, "size": vars(size)}
    results = json.loads(stored.read_text()) if stored.exists() else {**head, "worlds": {}}
    if {name: results[name] for name in head} != head:
        parser.error(f"argument --output: {stored} holds another study; give another folder")
    from tactile_diffusers import bundled_checkpoint

    pipe = TactileTexturePipeline.from_pretrained(bundled_checkpoint())
    for key, (settings, seed) in tqdm(worlds().items(), desc="worlds", unit="world"):
        if key not in results["worlds"]:
            results["worlds"][key] = study(settings, size, seed, output, pipe)
            write_text(stored, json.dumps(results) + "\n")
    (output / "prepared.h5").unlink(missing_ok=True)
    draw(results["worlds"], output / "sensitivity.png")
    write_text(output / "sensitivity.md", page(results["worlds"], size))
    print(f"wrote {output / 'sensitivity.md'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())

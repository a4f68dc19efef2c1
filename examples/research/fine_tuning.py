#!/usr/bin/env python
"""What does further training of DALE add to its recalibration on 50 surfaces? Whole, by adapters, by its conditions.

    python examples/research/fine_tuning.py "another world"=other.h5 --own prepared.h5 \
        --output examples/results/fine_tuning

The data sets are those of `few_surfaces.py`; `--own` is of the bundled checkpoint's world, for rehearsal. Writes
`figures.json`, `figures.md` and `ways.png` into the output folder, and the page beside it, `<output>.md`.
"""

import argparse
import json
from pathlib import Path

import numpy as np
import torch
from few_surfaces import PER_SURFACE, Control, adapted, measure, side_by_side, table
from peft import LoraConfig
from report.figures import figure_panels
from report.held_out import open_held_out

from tactile_diffusers.data import PreparedDataset
from tactile_diffusers.evaluation.metrics.statistics import leaf
from tactile_diffusers.training.dale_data import encode_dataset, training_states
from tactile_diffusers.training.further_training import descend
from tactile_diffusers.training.one_step import LatentStep
from tactile_diffusers.training.steps import BatchNoise

SURFACES, UPDATES, BATCH, SEED = 50, 300, 32, 0
#: Segments of the checkpoint's own world in rehearsal.
REHEARSED = 2000
#: Way of training -> learning rate, and share of each batch that is of the checkpoint's own world.
WAYS = {
    "all weights": (2e-4, 0.0),
    "all weights, half of each batch rehearsed": (2e-4, 0.5),
    "LoRA of rank 8": (1e-3, 0.0),
    "conditioning layers alone": (1e-3, 0.0),
}
PAGE = """# Does training DALE further help a lab?

DALE is recalibrated in closed form to {surfaces} surfaces of a world, then trained for {updates} updates on them
(energy scores, {batch} textures an update): all its weights, LoRA adapters on its convolutions, or the layers alone
through which ratings and times enter. The columns are those of [How many surfaces?](adaptation.md); the decoder stays
the bundled one.

![KTD of each way, and error of unseen surfaces over the recalibrated one's]({output}/ways.png)

    python examples/research/fine_tuning.py {words} --own {own} --output {output}
"""


def states_of(pipe, path, **selection):
    """Rows for `LatentStep` of a world's training surfaces."""
    dataset = PreparedDataset(path, "train", "filtered", pipe.feature_extractor.sampling_rate, **selection)
    dataset.set_axes(pipe.dale.config.rating_axes)
    return training_states(pipe.dale, dataset, encode_dataset(pipe, dataset, quiet=True))


def trainable(dale, way):
    """The parameters of a way of training."""
    if way.startswith("LoRA"):
        dale.add_adapter(LoraConfig(r=8, lora_alpha=8, target_modules=["conv1", "conv2", "time_proj"]))
        return [weights for name, weights in dale.named_parameters() if "lora_" in name]
    parts = ("rating_", "time_", "time_proj", "attn") if way.startswith("conditioning") else ("",)
    chosen = [(name, weights) for name, weights in dale.named_parameters() if not name.startswith("scalar_network")]
    return [weights for name, weights in chosen if any(part in name for part in parts)]


def train(pipe, way, lab, own):
    """Trains the pipeline's DALE in one of `WAYS` on rows of the lab's and of the checkpoint's own world."""
    (rate, share), rng = WAYS[way], np.random.default_rng(SEED)
    dale = pipe.dale.train().requires_grad_(False)
    weights = trainable(dale, way)
    for one in weights:
        one.requires_grad_(True)
    step, random = (
        LatentStep(dale, pipe.dale_scheduler, lab["state"]),
        BatchNoise(torch.Generator().manual_seed(SEED), "cpu"),
    )

    def loss():
        counts = (lab, BATCH - round(share * BATCH)), (own, round(share * BATCH))
        parts = [(rows, torch.from_numpy(rng.integers(len(rows["state"]), size=count))) for rows, count in counts]
        return step({name: torch.cat([rows[name][chosen] for rows, chosen in parts]) for name in lab}, random)[0]

    descend(weights, loss, UPDATES, rate, way)
    dale.eval()


def rows_of(path, args):
    """One row for each way: dicts as `few_surfaces.table` reads them."""
    control, found, base = Control(open_held_out(path, "test", PER_SURFACE, SEED)), [], None
    for way in (None, *WAYS):
        pipe = adapted(path, SURFACES, "no")
        if way is not None:
            own = states_of(pipe, args.own, max_samples=REHEARSED)
            train(pipe, way, states_of(pipe, path, max_surfaces=SURFACES), own)
        errors, distance, friction, right = measure(pipe, control, args.takes, SEED)
        base = errors if base is None else base
        row = {"surfaces": SURFACES, "method": f"and {way}" if way else "recalibrated", "nine_band_db": leaf(errors)}
        row |= {"over_ridge_db": leaf(errors - base), "ktd_over_real": distance, "log_friction_r": friction}
        found.append(row | {"changes_right": right})
        print(found[-1]["method"], *(round(leaf["mean"], 2) for leaf in list(found[-1].values())[2:]), flush=True)
    return found


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("worlds", nargs="+", metavar="NAME=PREPARED.h5", help="with test surfaces, best 50")
    parser.add_argument("--own", required=True, metavar="PREPARED.h5", help="of the bundled checkpoint's world")
    parser.add_argument("--takes", type=int, default=16, help="textures of each unseen surface")
    parser.add_argument("--output", type=Path, required=True, help="folder; the page lies beside it")
    args = parser.parse_args(argv)
    worlds, found = dict(word.rsplit("=", 1) for word in args.worlds), {}
    args.output.mkdir(parents=True, exist_ok=True)
    words = " ".join(f'"{name}"={Path(path).name}' for name, path in worlds.items())
    page = PAGE.format(
        surfaces=SURFACES, updates=UPDATES, batch=BATCH, words=words, own=Path(args.own).name, output=args.output.name
    )
    for name, path in worlds.items():
        found[name] = rows_of(path, args)
        (args.output / "figures.json").write_text(json.dumps(found, indent=1) + "\n")
    write(found, page, args.output)


def write(found, page, output):
    """The picture, the page and all figures beside it."""
    plot(found, output / "ways.png")
    whole = "".join(f"\n## {name}\n\n{table(rows)}\n" for name, rows in found.items())
    whole = whole.replace("over ridge", "over recalibrated, paired")
    (output / "figures.md").write_text(f"# All figures of [fine tuning](../{output.name}.md)\n{whole}")
    best = {name: min(row["over_ridge_db"]["mean"] for row in rows[1:]) for name, rows in found.items()}
    words = " and ".join(f"{max(0.0, -value):.2f} dB in {name}" for name, value in best.items())
    page += f"\nNo way lowers the error by more than {words}. What changes is KTD.\n"
    page += f"\n{side_by_side(found)}\n\nDifferences, paired, and friction: [all figures]({output.name}/figures.md).\n"
    output.with_suffix(".md").write_text(page)


def plot(found, path):
    """KTD over real, and the paired difference of errors, of each way (line) and world (colour)."""
    with figure_panels(path, 1, 2, (12, 3.6)) as panels:
        for panel, (key, label) in zip(
            panels[0],
            {"ktd_over_real": "KTD over real", "over_ridge_db": "error over recalibrated, dB"}.items(),
            strict=True,
        ):
            for number, (name, rows) in enumerate(found.items()):
                means = np.array([row[key]["mean"] for row in rows])
                bounds = np.array([row[key]["interval"] for row in rows]).T
                places = np.arange(len(rows)) + 0.2 * number
                panel.errorbar(means, places, xerr=np.abs(bounds - means), fmt="o", capsize=3, label=name)
            panel.set_yticks(range(len(rows)), [row["method"] for row in rows])
            panel.invert_yaxis()
            panel.set_xlabel(label)
        panels[0, 1].set_yticklabels([])
        panels[0, 1].legend(fontsize=8, loc="upper left")


if __name__ == "__main__":
    main()

"""What do few steps of LCTG cost in accuracy, distilled or not?

`python examples/benchmarks/decoder.py --data prepared.h5 --output report`
"""

import sys
from pathlib import Path

import torch
from benchmarking import finish, machine, make_parser, parse
from tqdm.auto import tqdm

from tactile_diffusers.cli.program import existing_file, load_pipeline, refuse
from tactile_diffusers.evaluation.metrics.statistics import leaf
from tactile_diffusers.pipelines import TactileTexturePipeline
from tactile_diffusers.signal import nine_band_error_db

sys.path.append(str(Path(__file__).parents[1]))  # examples, for `report`

from report.sampling import generate, reconstruct
from report.sections.context import FULL, QUICK, make_context
from report.sections.generation import matching_rows
from report.stand_ins import used_channels
from report.tables import markdown_table, title

#: Steps of the checkpoint's own LCTG.
STEPS = (1, 2, 3, 5, 10)


def main(argv=None):
    """Measures and writes decoder.json and decoder.md."""
    parser = make_parser("decoder.py", "Accuracy of few steps of LCTG, by its own decoder and by the distilled one.")
    add = parser.add_argument
    add("--data", type=existing_file, required=True, metavar="PREPARED.h5", help="from examples/prepare_data.py")
    add("--few", action="store_true", help="measure as few textures as evaluate.py --quick")
    arguments = parse(parser, argv)
    pipe = load_pipeline(arguments.checkpoint)
    try:
        settings = QUICK if arguments.few else FULL
        context = make_context(pipe, arguments.data, "test", settings, arguments.seed, arguments.output)
    except ValueError as error:
        return refuse("decoder.py", error)
    teacher, rows = TactileTexturePipeline.from_pipe(pipe, lctg_distilled=None), {}
    decoders = {"as trained": (teacher, STEPS)}
    if pipe.lctg_distilled is not None:
        decoders["distilled"] = pipe, range(1, pipe.lctg_distilled.config.distilled_steps + 1)
    for name, (one, counts) in decoders.items():
        for steps in tqdm(counts, disable=arguments.quiet, desc=name):
            rows[f"{name}, {steps} step{'s' * (steps > 1)}"] = measure(context, one, steps)
    text = (
        f"{title('Few steps', 4)}{len(context.data.real)} segments of {len(set(context.data.surfaces))} test surfaces "
        f"of `{arguments.data.name}`, those of evaluate.py, and its noise. Reconstructed: with the detail layer; from "
        "the base layer: decoded from what DALE would generate alone; generated: from ratings, DALE in its default "
        f"steps.\n\n{markdown_table(rows, 2, interval=True)}\n"
    )
    return finish(arguments, "decoder", {"machine": machine(), "rows": rows}, text)


def measure(context, pipe, steps):
    """Nine-band error, dB, and KTD over real segments of each kind of texture, as evaluate.py measures them."""
    data, row, base = context.data, {}, used_channels(pipe.lctg, "base_layer")
    chosen, (ratings, owners) = matching_rows(context), context.requests
    seeds = context.seeds(1, len(ratings))[chosen]
    grid = (data.rate, data.dataset.segment_samples, steps)

    def without_detail(latents):
        kept = torch.zeros_like(latents)
        kept[:, base] = latents[:, base]
        return kept

    made = {
        "reconstructed": reconstruct(pipe, data.real, data.rate, steps, context.seed),
        "from the base layer": reconstruct(pipe, data.real, data.rate, steps, context.seed, change=without_detail),
        "generated": generate(pipe, ratings[chosen], seeds, *grid).textures,
    }
    for name, textures in made.items():
        groups = owners[chosen] if name == "generated" else data.surfaces
        if name != "generated":
            errors = nine_band_error_db(textures, data.real, data.rate, data.edges)
            row[f"{name}: nine-band error, dB"] = leaf(errors, data.surfaces)
        points = data.reference.embed(textures)
        distances = data.reference.distances(points, groups, (data.points, data.surfaces))
        row[f"{name}: KTD over real"] = distances["ktd_excess"]
    return row


if __name__ == "__main__":
    sys.exit(main())

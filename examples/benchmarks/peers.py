"""How fast are other packages' models? `python examples/benchmarks/peers.py --output report`"""

import sys
from functools import partial
from pathlib import Path

import torch
from benchmarking import LONG_RUN, finish, machine, make_parser, parse, seconds_of, timed_columns, timed_table, timings
from peer_models import INSTALL, SIZE_TOLERANCE, audio_diffusion, size, unet_1d
from speed import RATINGS
from torch.utils.flop_counter import FlopCounterMode, sdpa_flop_count

from tactile_diffusers.cli.program import existing_folder, load_pipeline
from tactile_diffusers.io.argument_types import count
from tactile_diffusers.signal import SEGMENT_SECONDS

sys.path.append(str(Path(__file__).parents[1]))  # examples, for `report`

from report.tables import markdown_table, title

#: Steps of both stages at which all are compared.
STEPS = 10
#: What would take longer than this, s, by its time at the batch before, is left out.
LONGEST_RUN = 60.0
DEFAULT, OURS, ANCHOR = "ours, default call", "ours", "paper's configuration"
_ABOUT = (
    "Throughput only: other packages' models have random weights. Ratings to latents to 1.6384 s of waveform, in turn "
    f"in one run, {STEPS} steps where a row does not say otherwise; a distilled model takes "
    "those it was made for. audio-diffusion-pytorch: its README's "
    "autoencoder, cut to seven levels, at 10 kHz, after the fourth to sixth level of its conditional U-Net, over those "
    "latents. UNet1DModel: a waveform at 10 kHz without ratings, its default widths continued to seven levels. At our "
    f"size: all widths are scaled until parameters are within {SIZE_TOLERANCE:.0%} of ours. Ours does all: both "
    "stages, band levels, resampling to 10 kHz. Parameters are those that generating runs. What takes longer than "
    f"{LONG_RUN:g} s is run once."
)


def ours(checkpoint, steps=None):
    """One of our pipelines: the networks that generating runs, and a function of the batch size."""
    pipe = load_pipeline(checkpoint)
    decoder = pipe.decoder_of(steps or pipe.resolve_steps()[0])

    def generate(number):
        generator = torch.Generator("cpu").manual_seed(0)
        return pipe([RATINGS] * number, num_inference_steps=steps, generator=generator).textures

    return [decoder.decoder, decoder.time_embedder, pipe.dale], generate


def other(peer):
    """Likewise another package's model."""
    return [peer.module], lambda number: peer.generate(number, STEPS)


def competitors(checkpoint, anchor=None):
    """Rows of the comparison, name -> (networks, generate), and sentences on what is missing."""
    rows, notes = {DEFAULT: ours(checkpoint), OURS: ours(checkpoint, STEPS)}, []
    if anchor is not None:
        rows[ANCHOR] = ours(anchor, STEPS)
    parameters = sum(map(size, rows[OURS][0]))
    # nobody publishes a configuration of UNet1DModel for such signals
    models = {"audio-diffusion-pytorch": (audio_diffusion, "as published"), "UNet1DModel": (unet_1d, "18 M")}
    for name, (model, whole) in models.items():
        try:
            rows |= {f"{name}, {whole}": other(model()), f"{name}, at our size": other(model(parameters))}
        except ImportError as error:
            notes.append(f"{name}: not installed ({error}): {INSTALL}.")
    return rows, notes


def multiply_adds(generate):
    """Multiplications with additions of all convolutions and matrix products that a call runs."""
    attention = torch.ops.aten._scaled_dot_product_flash_attention_for_cpu  # torch's counter has no CPU's
    mapping = {attention: lambda q, k, v, *_, **__: sdpa_flop_count(q, k, v)}
    with FlopCounterMode(display=False, custom_mapping=mapping) as counter:
        generate(1)
    return counter.get_total_flops() // 2


def peak_rate(size=2048):
    """Multiply-adds a second of a large float32 matrix product, what this machine can do at most."""
    a, b = torch.randn(2, size, size)
    return size**3 / seconds_of({"": lambda: a @ b}, 5)[""]


def times(rows, batches, repeats, work, peak):
    """Seconds of segments: batch -> row -> columns.

    `work` are the multiply-adds of a segment by row, `peak` those that the machine can do in a second. Spread is half
    the distance of the quartiles over the median.
    """
    found, last = {}, {}
    for number in batches:
        able = {name: row for name, row in rows.items() if last.get(name, 0.0) * number <= LONGEST_RUN}
        taken = timings({name: partial(generate, number) for name, (_, generate) in able.items()}, repeats)
        columns = {name: timed_columns(values) for name, values in taken.items()}
        last |= {name: row["s"] / number for name, row in columns.items()}
        found[f"Batch {number}"] = {
            name: row
            | {
                "real-time factor": row["s"] / (number * SEGMENT_SECONDS),
                "share of the peak, %": 100 * number * work[name] / (row["s"] * peak),
                "default call is faster by": row["s"] / columns[DEFAULT]["s"],
            }
            for name, row in columns.items()
        }
    return found


def main(argv=None):
    """Measures and writes peers.json and peers.md."""
    parser = make_parser("peers.py", "Speed of our models and of other packages' side by side.")
    add = parser.add_argument
    add("--repeats", type=count, default=5, metavar="N", help="the median counts; default: 5")
    add("--batches", type=count, nargs="+", default=[1, 4, 16, 64], metavar="N", help="textures at once; default: 1 4 "
        "16 64")  # fmt: skip
    add("--anchor", type=existing_folder, metavar="FOLDER", help="checkpoint of the paper's configuration, with a DALE")
    arguments = parse(parser, argv)
    rows, notes = competitors(arguments.checkpoint, arguments.anchor)
    models = {
        name: {
            "parameters, M": sum(map(size, networks)) / 1e6,
            "multiply-adds of a segment, G": multiply_adds(generate) / 1e9,
        }
        for name, (networks, generate) in rows.items()
    }
    work, peak = {name: 1e9 * row["multiply-adds of a segment, G"] for name, row in models.items()}, peak_rate()
    found, where = times(rows, sorted(set(arguments.batches)), arguments.repeats, work, peak), machine()
    peak_text = f"A float32 matrix product of 2048 x 2048, the peak, runs at {peak / 1e9:.0f} G multiply-adds a second."
    parts = [title("Beside other models", 4) + _ABOUT, " ".join([peak_text, *notes]), markdown_table(models, 2)]
    parts += [f"{name}\n\n{timed_table(table)}" for name, table in found.items()]
    report = {"machine": where, "peak": peak, "notes": notes, "models": models, "batches": found}
    return finish(arguments, "peers", report, "\n\n".join(parts) + "\n")


if __name__ == "__main__":
    sys.exit(main())

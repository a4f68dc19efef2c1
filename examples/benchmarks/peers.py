"""`benchmark.py --suite speed --peers`: our forms and other packages' models side by side."""

import json
import time
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch
from peer_models import SIZE_TOLERANCE, audio_diffusion, audio_diffusion_version, size, unet_1d
from speed import DURATIONS, LONG_RUN, RATINGS, peak_memory, seconds_of
from torch.utils.flop_counter import FlopCounterMode, sdpa_flop_count

from tactile_diffusers.evaluation.tables import markdown_table, title
from tactile_diffusers.models import LCTGModel
from tactile_diffusers.pipelines import TactileTexturePipeline, find_decoders
from tactile_diffusers.pipelines.recorded import DEFAULT_STEPS
from tactile_diffusers.signal import SEGMENT_SECONDS

#: Steps of both stages at which all are compared.
STEPS = 10
#: Steps of a distilled LCTG.
DISTILLED_STEPS = (2, 1)
#: What would take longer than this, s, is left out.
LONGEST_RUN = 60.0
#: Compiled and plain textures count as equal up to this share of the plain ones' RMS.
EQUAL = 1e-3
OURS, COMPILED, BFLOAT16 = "ours", "ours, compiled", "ours, bfloat16"
ANCHOR = "paper's configuration"
# rows that ratios are formed to
_AUDIO, _UNET = "audio-diffusion-pytorch", "UNet1DModel"
_GENERATE_ONCE = """
import json, sys, torch
from peers import competitor
request = json.loads(sys.argv[1])
torch.set_num_threads(request["threads"])
competitor(request, sys.argv[2]).generate(1)
"""
_MATRIX = 2048
_FASTER = "times as fast as "
_EXPLANATION = (
    "Throughput only: other packages' models have random weights. Ratings to latents to 1.6384 s of waveform, in "
    f"turn in one run on one machine, {STEPS} + {STEPS} steps where a row does not say otherwise. "
    "audio-diffusion-pytorch: its README's autoencoder, cut to seven levels, at 10 kHz, after the fourth to sixth "
    "level of its conditional U-Net, over those latents. UNet1DModel: a waveform at 10 kHz without ratings, its "
    "default widths continued to seven levels. At our size: all widths are scaled until parameters are within "
    f"{SIZE_TOLERANCE:.0%} of ours. Ours does all: both stages, band levels, resampling to 10 kHz. Parameters are "
    f"those that generating runs (no encoder). What takes longer than {LONG_RUN:g} s is run once, what "
    f"would take longer than {LONGEST_RUN:g} s is left out. × means times as fast as."
)


@dataclass
class Competitor:
    """A form of ours, or another package's model.

    Attributes:
        modules (`list`): the networks that are run.
        generate (`Callable`): (count, seconds=None) -> textures, anything that has rows.
        durations (`bool`): whether it is timed at other durations than a segment.
    """

    modules: list
    generate: object
    durations: bool = True


def forms(request):
    """Rows of the comparison: name -> a function without arguments that makes the `Competitor`.

    Args:
        request (`dict`): JSON, because child processes get it: "checkpoint" (`str`), "distilled" and "anchor" (`str` or
            `None`), "parameters" of ours, "peers" (`list[str]`, the packages that are there), "threads".
    """
    made = {
        OURS: lambda: _ours(request),
        COMPILED: lambda: _ours(request, compiled=True),
        BFLOAT16: lambda: _ours(request, dtype=torch.bfloat16),
        f"{OURS}, {DEFAULT_STEPS} + {DEFAULT_STEPS} steps": lambda: _ours(request, (DEFAULT_STEPS, DEFAULT_STEPS)),
    }
    if request["distilled"]:
        for count in DISTILLED_STEPS:
            steps = (DEFAULT_STEPS, count)
            made[f"{OURS}, distilled, {steps[0]} + {steps[1]} steps"] = lambda steps=steps: _ours(
                request, steps, distilled=True
            )
    if request["anchor"]:
        made[ANCHOR] = lambda: _anchor(request)
    # nobody publishes a configuration of UNet1DModel for such signals
    for name, model, whole in ((_AUDIO, audio_diffusion, "as published"), (_UNET, unet_1d, "18 M")):
        sizes = {whole: None, "at our size": request["parameters"]}
        for label, parameters in sizes.items() if name in request["peers"] else ():
            made[f"{name}, {label}"] = lambda m=model, p=parameters, n=name: _peer(m(p), n == _AUDIO)
    return made


def competitor(request, name):
    """One row of the comparison, made."""
    return forms(request)[name]()


def load(folder, dtype=torch.float32):
    """The pipeline of a checkpoint, without progress bars."""
    pipe = TactileTexturePipeline.from_pretrained(str(folder), dtype=dtype)
    pipe.set_progress_bar_config(disable=True)
    return pipe


def generating_modules(pipe):
    """The networks that generating runs: LCTG without its encoder, and DALE."""
    return [pipe.lctg.decoder, pipe.lctg.time_embedder, *([pipe.dale] if pipe.dale is not None else [])]


def _ours(request, steps=(STEPS, STEPS), compiled=False, dtype=torch.float32, distilled=False):
    pipe = load(request["checkpoint"], dtype)
    if distilled:
        pipe = TactileTexturePipeline.from_pipe(pipe, lctg=LCTGModel.from_pretrained(request["distilled"]))
    modules = generating_modules(pipe)
    if compiled:  # for each shape anew, as fast as can be
        for network in (pipe.lctg, pipe.dale):
            network.compile(dynamic=False)
    return Competitor(modules, _generator(pipe, steps), not compiled)


def _anchor(request):
    pipe = load(request["anchor"])
    return Competitor(generating_modules(pipe), _generator(pipe, (STEPS, STEPS)))


def _generator(pipe, steps):
    def generate(count, seconds=None, seed=0):
        common = dict(num_latent_inference_steps=steps[0], num_inference_steps=steps[1], duration_s=seconds)
        return pipe([RATINGS] * count, generator=torch.Generator("cpu").manual_seed(seed), **common).textures

    return generate


def _peer(peer, durations):
    return Competitor([peer.module], lambda count, seconds=None: peer.generate(count, STEPS, seconds), durations)


def matrix_peak(repeats=5):
    """The machine's fastest float32 matrix multiplication with torch's threads, operations (of 2) a second."""
    a, b = torch.randn(2, _MATRIX, _MATRIX)
    return max(2 * _MATRIX**3 / seconds_of({"matmul": lambda: a @ b}, 1)["matmul"] for _ in range(repeats))


def multiply_adds(generate):
    """Multiplications with additions of all convolutions and matrix products that a call runs."""
    attention = torch.ops.aten._scaled_dot_product_flash_attention_for_cpu  # torch's counter has no CPU's
    counter = FlopCounterMode(
        display=False, custom_mapping={attention: lambda q, k, v, *_, **__: sdpa_flop_count(q, k, v)}
    )
    with counter:
        generate()
    return counter.get_total_flops() // 2


def compare(arguments, pipe, checkpoint):
    """Measures all rows.

    Args:
        arguments (`argparse.Namespace`): "anchor" and "distilled" (`Path` or `None`), "repeats", "batches".
        pipe (`TactileTexturePipeline`): ours, from `checkpoint`.
        checkpoint (`str`): its folder.

    Returns:
        `dict`: "models" and "durations" (row -> measurements), "batches" (batch -> row -> measurements), "notes"
        (`list[str]`), "peak" (operations a second of a matrix product), "compiled differs by" (`float` or `None`).
    """
    notes, peers = [], [_UNET]
    try:
        notes.append(f"audio-diffusion-pytorch {audio_diffusion_version()}.")
        peers.insert(0, _AUDIO)
    except ImportError as error:
        notes.append(f"audio-diffusion-pytorch: {error}.")
    anchor, distilled = arguments.anchor, arguments.distilled or find_decoders(checkpoint).get("distilled")
    if anchor is not None and load(anchor).dale is None:
        notes.append(f"{ANCHOR}: no DALE in {anchor.name}, so it only reconstructs and is left out here.")
        anchor = None
    if distilled is None:
        notes.append("distilled: none in the checkpoint; give --distilled.")
    request = {
        "checkpoint": str(checkpoint),
        "distilled": distilled and str(distilled),
        "anchor": anchor and str(anchor),
        "parameters": sum(map(size, generating_modules(pipe))),
        "peers": peers,
        "threads": torch.get_num_threads(),
    }
    rows, compiling = {name: make() for name, make in forms(request).items()}, None
    try:
        compiling = _seconds_to_compile(rows[COMPILED])
    except Exception as error:  # no C++ compiler, for one
        notes.append(f"compiled: {type(error).__name__}: {str(error).splitlines()[0]}")
        del rows[COMPILED]
    models, peak = _models(rows, request), matrix_peak()
    if COMPILED in rows:
        models[COMPILED]["compiling, s"] = compiling
    return {
        "notes": notes,
        "peak": peak,
        "models": models,
        "batches": _batches(rows, arguments.batches, arguments.repeats, peak, models),
        "durations": _durations(rows, max(1, arguments.repeats // 2)),
        "compiled differs by": difference(rows[OURS], rows[COMPILED]) if COMPILED in rows else None,
    }


def _seconds_to_compile(row):
    begin = time.perf_counter()
    row.generate(1)
    first = time.perf_counter() - begin
    return max(0.0, first - seconds_of({"": lambda: row.generate(1)}, 1)[""])


def _models(rows, request):
    """Parameters, multiply-adds of a segment and peak memory."""
    found = {}
    for name, row in rows.items():
        counted = rows[OURS] if name == COMPILED else row  # the counter sees no compiled code
        found[name] = {
            "parameters, M": sum(map(size, row.modules)) / 1e6,
            "multiply-adds of a segment, G": multiply_adds(partial(counted.generate, 1)) / 1e9,
            "peak MiB": peak_memory(_GENERATE_ONCE, json.dumps(request), name),
        }
    return found


def _batches(rows, counts, repeats, peak, models):
    """Times of a segment: batch -> row -> seconds, real-time factor, share of the peak, and ratios to others.

    What would take longer than `LONGEST_RUN`, by its time at the batch before, is left out.
    """
    found, last = {}, {}
    for count in counts:
        able = {name: row for name, row in rows.items() if last.get(name, 0.0) * count <= LONGEST_RUN}
        if COMPILED in able:
            rows[COMPILED].generate(count)  # compiles for this shape
        times = seconds_of({name: partial(row.generate, count) for name, row in able.items()}, repeats)
        last = {name: seconds / count for name, seconds in times.items()} | {
            name: seconds for name, seconds in last.items() if name not in times
        }
        found[str(count)] = {
            name: {
                "s": seconds,
                "real-time factor": seconds / (count * SEGMENT_SECONDS),
                "share of the peak, %": 2e11 * models[name]["multiply-adds of a segment, G"] * count / seconds / peak,
            }
            | _ratios(times, name)
            for name, seconds in times.items()
        }
    return found


def _ratios(times, name):
    """Times as fast as each reference: another package's model, or the paper's configuration."""
    references = [other for other in times if other == ANCHOR or other.startswith((_AUDIO, _UNET))]
    return {f"{_FASTER}{other}": times[other] / times[name] for other in references}


def _durations(rows, repeats):
    """Seconds at several durations, of rows that can."""
    able = {name: row for name, row in rows.items() if row.durations}
    found = {name: {} for name in able}
    for duration in DURATIONS:
        times = seconds_of({name: partial(row.generate, 1, duration) for name, row in able.items()}, repeats)
        for name, seconds in times.items():
            found[name][f"{duration:g} s"] = seconds
    return found


def difference(plain, other):
    """The largest difference of two forms' textures, as a share of the RMS of the first's.

    Args:
        plain, other (`Competitor`): both of ours, of the same noise.
    """
    ours, theirs = (np.asarray(row.generate(2), dtype=np.float64) for row in (plain, other))
    return float((np.abs(ours - theirs) / np.sqrt(np.mean(ours**2, axis=-1, keepdims=True))).max())


def markdown(found):
    """The tables of `compare`."""
    notes = "; ".join(note.rstrip(".") for note in found["notes"])
    parts = [title("Beside other models", 4) + _EXPLANATION, f"{notes}. {_measured(found)}"]
    parts.append(markdown_table(found["models"], 2))
    for count, rows in found["batches"].items():
        labels = {key: (key.replace(_FASTER, "× "), 1) for row in rows.values() for key in row}
        labels |= {"s": ("s", 3), "real-time factor": ("real-time factor", 4)}
        parts.append(f"Batch {count}\n\n{markdown_table(rows, labels=labels)}")
    parts.append(f"Seconds by duration, batch 1\n\n{markdown_table(found['durations'], 3)}")
    return "\n\n".join(parts) + "\n"


def _measured(found):
    peak = f"A float32 matrix product of {_MATRIX} x {_MATRIX} runs at {found['peak'] / 1e9:.0f} GFLOP/s, the peak."
    apart = found["compiled differs by"]
    if apart is None:
        return peak
    verdict = "equal" if apart <= EQUAL else "NOT equal"
    return f"{peak} Compiled textures are {verdict} to plain ones within {EQUAL:g} of their RMS: {apart:.1g} at most."

"""Generate many textures: `accelerate launch examples/generate_dataset.py --num_textures 1000 --output out`."""

import argparse
import hashlib
import logging
import sys
import time
from contextlib import contextmanager
from datetime import timedelta

import numpy as np

from tactile_diffusers.cli.program import (
    Parser,
    add_checkpoint_argument,
    add_generation_arguments,
    add_output_argument,
    add_seed_argument,
    checkpoint_folder,
    checkpoint_name,
    existing_file,
    load_pipeline,
    refuse,
)
from tactile_diffusers.io.argument_types import count

EPILOG = """\
Run the same command again after it was stopped: it goes on with the missing shards. All machines must see OUTPUT.
Textures depend on the checkpoint, the ratings, the options of generation and --seed; the number of processes changes
nothing. Another --batch_size or another kind of processor changes them by rounding. On a CPU each process uses one
thread, so start one process per core: `torchrun --nproc_per_node 8 examples/generate_dataset.py ...` (accelerate
launches several processes on GPUs only). Read the textures with `datasets.load_dataset(OUTPUT)`, or as one array with
`tactile_diffusers.export.read_generated(OUTPUT)`.
"""


def parse_arguments(argv=None):
    """Arguments of the command."""
    parser = Parser(
        prog="generate_dataset.py",
        description="Generate many textures as Parquet shards, in as many processes as accelerate or torchrun starts.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("--num_textures", type=count, required=True, metavar="N", help="in all")
    add_output_argument(parser, "folder of the data set: data/*.parquet and its card, README.md")
    add("--ratings_file", type=existing_file, metavar="FILE", help="rows of z-scores, .csv with axes as columns, .json "
        "or .npy; empty = not specified; rows are used in turn. Default: drawn as the training surfaces' "
        "ratings")  # fmt: skip
    add_checkpoint_argument(parser)
    add_generation_arguments(parser)
    add_seed_argument(parser)
    add("--batch_size", type=count, default=32, metavar="B", help="textures at once in a process; default: 32")
    add("--textures_per_shard", type=count, default=256, metavar="K", help="default: 256; best a multiple of B")
    add("--quiet", action="store_true", help="print errors only")
    return parser.parse_args(argv)


def main(argv=None):
    """Runs the command in one of its processes; a refusal is one line on stderr from each machine."""
    arguments = parse_arguments(argv)
    from accelerate import PartialState

    from tactile_diffusers.io.locks import unlock_folder
    from tactile_diffusers.training.launch import on_cpu

    # processes that are done wait for the last one, however long its shards take
    state = PartialState(on_cpu(), timeout=timedelta(weeks=1))
    try:
        job = _prepare(arguments, state)
    except (ValueError, OSError) as error:
        if state.is_local_main_process:
            refuse("generate_dataset.py", error)
        state.destroy_process_group()
        return 2
    from report.sampling import one_thread

    with one_thread(state.device), _novelty_warned_once():
        _run(arguments, state, **job)
    unlock_folder(arguments.output)
    state.destroy_process_group()
    return 0


def texture_seeds(seed, count):
    """One seed for each texture: (count,) int64, all different.

    PyTorch's generator on the CPU reads 32 bits of a seed, so random 64-bit seeds would give some of 100,000 textures
    the same noise. These count up from a random place.
    """
    first = int(np.random.SeedSequence(seed, spawn_key=(0,)).generate_state(1)[0])
    return (first + np.arange(count, dtype=np.int64)) % 2**32


def _prepare(arguments, state):
    """Everything that can be refused: checkpoint, ratings, settings, folder. The same in every process."""
    import torch
    from dataset.card import licence_of
    from dataset.ratings import draw_ratings, read_ratings_file
    from dataset.shards import open_folder

    from tactile_diffusers.io.locks import lock_folder
    from tactile_diffusers.io.reading import import_pyarrow
    from tactile_diffusers.pipelines.inputs import warn_of_novel_ratings

    import_pyarrow(f"--output {arguments.output}")
    folder = checkpoint_folder(arguments.checkpoint)
    pipe = load_pipeline(folder, arguments.quiet or not state.is_main_process)
    pipe = pipe.to(state.device)
    pipe.set_progress_bar_config(disable=True)
    steps, latent_steps = pipe.resolve_steps(arguments.num_inference_steps, arguments.num_latent_inference_steps)
    options = {
        "num_inference_steps": steps,
        "num_latent_inference_steps": latent_steps,
        "guidance_scale": arguments.guidance_scale,
        "duration_s": arguments.duration_s,
    }
    pipe.check_inputs(duration_s=arguments.duration_s, guidance_scale=arguments.guidance_scale)
    _align_weights(pipe)
    config, source = pipe.dale.config, arguments.ratings_file
    if source is None:
        ratings = draw_ratings(config, arguments.num_textures, arguments.seed)
    else:
        ratings = read_ratings_file(source, config, arguments.num_textures)
    settings = _settings(arguments, pipe, folder, ratings, options)
    about = {
        "checkpoint": checkpoint_name(arguments.checkpoint),
        "ratings": "drawn as the training surfaces'" if source is None else source.name,
        "rating_axes": list(config.rating_axes),
        "device": str(state.device.type),
        "batch_size": arguments.batch_size,
        **licence_of(folder),
    }
    if state.is_main_process and not arguments.quiet:
        warn_of_novel_ratings(torch.from_numpy(ratings), config)

    def claim():
        arguments.output.mkdir(parents=True, exist_ok=True)
        lock_folder(arguments.output, "--output")
        return open_folder(arguments.output, settings)

    missing = _from_main_process(state, claim)
    if not arguments.output.is_dir():
        raise ValueError(f"--output {arguments.output} is not seen by process {state.process_index}: share the folder.")
    facts = {"settings": settings, "about": about}
    return {"pipe": pipe, "ratings": ratings, "options": options, "facts": facts, "missing": missing}


def _settings(arguments, pipe, folder, ratings, options):
    """All that decides what the textures are: a later call must agree with it."""
    import diffusers
    import torch

    from tactile_diffusers.pipelines.folders import folder_digest
    from tactile_diffusers.version import __version__

    return {
        "num_textures": arguments.num_textures,
        "textures_per_shard": arguments.textures_per_shard,
        "seed": arguments.seed,
        "checkpoint_sha256": folder_digest(folder),
        "ratings_sha256": hashlib.sha256(ratings.tobytes()).hexdigest(),
        **options,
        "sampling_rate": pipe.feature_extractor.delivery_rate,
        "reference_speed": pipe.dale.config.reference_speed,
        "tactile_diffusers": __version__,
        "torch": str(torch.__version__),  # a class of its own, which compares as versions
        "diffusers": diffusers.__version__,
    }


def _align_weights(pipe):
    """Copies weights to memory that PyTorch aligned.

    Mapped from a file they lie anywhere, and sums are rounded by where: textures would not be the same bit for bit in
    one process, whose device is "cpu", and in several, which copy to "cpu:0".
    """
    for module in filter(None, (pipe.lctg, pipe.lctg_distilled, pipe.dale)):
        for tensor in [*module.parameters(), *module.buffers()]:
            tensor.data = tensor.data.clone()


def _from_main_process(state, function):
    """What `function` returns in the main process, for all; what it raises there is raised in all."""
    from accelerate.utils import broadcast_object_list

    answer = [None, None]
    if state.is_main_process:
        try:
            answer[0] = function()
        except (ValueError, OSError) as error:
            answer[1] = error
    broadcast_object_list(answer)
    if answer[1] is not None:
        raise answer[1]
    return answer[0]


def _run(arguments, state, pipe, ratings, options, facts, missing):
    """Generates this process's share of the missing shards; the main process prints how fast they were."""
    from accelerate.utils import gather_object
    from dataset.card import write_card
    from dataset.shards import write_shard
    from tqdm.auto import tqdm

    mine = missing[state.process_index :: state.num_processes]
    number = sum(shard["count"] for shard in mine)
    seeds = texture_seeds(arguments.seed, arguments.num_textures)
    quiet = arguments.quiet or not state.is_main_process
    start = time.perf_counter()
    with tqdm(total=number, desc=f"process 0 of {state.num_processes}", unit="texture", disable=quiet) as bar:
        for shard in mine:
            rows = slice(shard["first"], shard["first"] + shard["count"])
            batches = _batches(pipe, ratings[rows], seeds[rows], options, arguments.batch_size, bar)
            write_shard(arguments.output / shard["file"], shard["count"], batches=batches, **facts)
    done = gather_object([(number, time.perf_counter() - start)])
    if state.is_main_process:
        write_card(arguments.output, **facts)
    if quiet:
        return
    generated, seconds = sum(part[0] for part in done), max(part[1] for part in done)
    print(f"{arguments.output}: {arguments.num_textures} textures, {generated} of them generated now")
    if generated:
        rate = generated / seconds
        print(
            f"{generated} textures in {seconds:.1f} s by {state.num_processes} process(es): {rate:.2f} a second; "
            f"100,000 would take {1e5 / rate / 3600:.2f} hours"
        )


def _batches(pipe, ratings, seeds, options, batch_size, bar):
    """Columns of a shard, batch by batch; each texture has noise of its own seed."""
    import torch

    for start in range(0, len(ratings), batch_size):
        rows = slice(start, start + batch_size)
        generators = [torch.Generator("cpu").manual_seed(int(seed)) for seed in seeds[rows]]
        out = pipe(ratings[rows], generator=generators, **options)
        yield {
            "texture": out.textures,
            **dict(zip(pipe.dale.config.rating_axes, ratings[rows].T, strict=True)),
            "level": out.level,
            "friction_coefficient": out.friction_coefficient,
            "seed": seeds[rows],
        }
        bar.update(len(generators))


@contextmanager
def _novelty_warned_once():
    """Keeps the pipeline from warning of unusual ratings in every batch: the command warns of all of them at once."""
    logger = logging.getLogger("tactile_diffusers.pipelines.inputs")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.setLevel(level)


if __name__ == "__main__":
    sys.exit(main())

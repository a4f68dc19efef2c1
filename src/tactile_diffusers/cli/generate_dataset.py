"""`accelerate launch examples/generate_dataset.py`: many textures, by several processes, in one folder."""

import argparse
import hashlib
import logging
import time
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path

import numpy as np

from ..io.reading import read_json
from .program import Parser, check_seed, program, refuse

EPILOG = """\
Run it again after it was stopped: whole shards are kept, the others are made. All machines must see OUTPUT, and one
call at a time may write there: a second is refused. Textures depend on the checkpoint, the ratings, the options above
and --seed. Files are the same bit for bit for any number of processes on processors of one kind. Another --batch_size
changes samples by rounding (on a CPU by 3e-6 of the RMS), another kind of processor or GPU by more. On a CPU each
process computes on one thread, so give as many processes as cores: `torchrun --nproc_per_node 8
examples/generate_dataset.py ...` (accelerate 1.15 launches several processes on GPUs only).
`tactile_diffusers.export.read_generated(OUTPUT)` reads the shards as one array.
"""


def parse_arguments(argv=None):
    """Arguments of the command.

    Raises:
        SystemExit: on bad arguments, with exit code 2 and a line that says what is wrong.
    """
    parser = Parser(
        prog=program("generate_dataset.py"),
        description="Generate many textures into shards (HDF5), in as many processes as accelerate or torchrun starts.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("--num_textures", type=int, required=True, metavar="N")
    add("--output", type=Path, required=True, metavar="FOLDER", help="shards and manifest.json")
    add("--ratings_file", type=Path, metavar="FILE", help="rows of z-scores, .csv with axes as columns, .json or .npy; "
        "empty = not specified; rows are used in turn. Default: drawn as the training surfaces' ratings")  # fmt: skip
    add("--checkpoint", type=Path, metavar="FOLDER", help="default: the bundled checkpoint")
    add("--num_inference_steps", type=int, metavar="N", help="diffusion steps of the texture generator")
    add("--num_latent_inference_steps", type=int, metavar="N", help="in latent space; default: the same")
    add("--guidance_scale", type=float, default=1.0, metavar="W", help="weight of the ratings; default: 1, off")
    add("--duration_s", type=float, metavar="SECONDS", help="of each texture; default: one segment")
    add("--seed", type=int, default=0, help="default: 0")
    add("--batch_size", type=int, default=32, metavar="B", help="textures at once in a process; default: 32")
    add("--textures_per_shard", type=int, default=256, metavar="K", help="default: 256; best a multiple of B")
    add("--quiet", action="store_true", help="print nothing but errors")
    arguments = parser.parse_args(argv)
    for name in ("num_textures", "batch_size", "textures_per_shard"):
        if getattr(arguments, name) < 1:
            parser.error(f"argument --{name}: must be at least 1, got {getattr(arguments, name)}")
    check_seed(parser, arguments.seed)
    if arguments.checkpoint is not None and not arguments.checkpoint.is_dir():
        parser.error(f"argument --checkpoint: {arguments.checkpoint} is not a folder; give a local checkpoint")
    if arguments.ratings_file is not None and not arguments.ratings_file.is_file():
        parser.error(f"argument --ratings_file: {arguments.ratings_file} is not a file")
    if arguments.output.exists() and not arguments.output.is_dir():
        parser.error(f"argument --output: {arguments.output} is not a folder")
    return arguments


def main(argv=None):
    """Runs the command in one of its processes.

    Returns:
        `int`: 0, or 2 if the request was refused (one line on stderr from each machine, and nothing written).
    """
    arguments = parse_arguments(argv)
    from accelerate import PartialState

    from ..io.locks import unlock_folder
    from ..training.processes import on_cpu

    # processes that are done wait for the last one, however long its shards take
    state = PartialState(on_cpu(), timeout=timedelta(weeks=1))
    try:
        job = _prepare(arguments, state)
    except (ValueError, OSError) as error:
        if state.is_local_main_process:
            refuse("generate_dataset.py", error)
        state.destroy_process_group()
        return 2
    with _one_thread(state.device), _novelty_said_once():
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


def checkpoint_digest(folder):
    """SHA-256 of a checkpoint's configs and weights, so that a copy or another path is the same checkpoint."""
    folder, digest = Path(folder), hashlib.sha256()
    components = sorted(path for path in folder.iterdir() if path.name in _components(folder) and path.is_dir())
    for path in [folder / "model_index.json", *(file for part in components for file in sorted(part.rglob("*")))]:
        if path.suffix in (".json", ".safetensors"):
            digest.update(f"{path.relative_to(folder).as_posix()} {path.stat().st_size}\n".encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()


def _components(folder):
    return {
        name for name in read_json(folder / "model_index.json", "the index of a checkpoint") if not name.startswith("_")
    }


def _prepare(arguments, state):
    """Everything that can be refused: checkpoint, ratings, settings, folder. The same in every process."""
    import diffusers
    import torch
    from diffusers.utils import logging as diffusers_logging

    from tactile_diffusers import TactileTexturePipeline, bundled_checkpoint

    from ..export.generated import open_folder
    from ..io.locks import lock_folder
    from ..pipelines.inputs import warn_of_novel_ratings
    from ..version import __version__
    from .dataset_ratings import draw_ratings, read_ratings_file

    if arguments.quiet or not state.is_main_process:
        diffusers_logging.disable_progress_bar()
    checkpoint = Path(arguments.checkpoint or bundled_checkpoint())
    pipe = TactileTexturePipeline.from_pretrained(str(checkpoint)).to(state.device)
    pipe.set_progress_bar_config(disable=True)
    steps, latent_steps = pipe.resolve_steps(arguments.num_inference_steps, arguments.num_latent_inference_steps)
    options = {
        "num_inference_steps": steps,
        "num_latent_inference_steps": latent_steps,
        "guidance_scale": arguments.guidance_scale,
        "duration_s": arguments.duration_s,
    }
    pipe.check_inputs(**options, num_textures_per_rating=1, output_type="np", callback_on_step_end_tensor_inputs=[])
    _align_weights(pipe)
    config, count = pipe.dale.config, arguments.num_textures
    if arguments.ratings_file is not None:
        ratings = read_ratings_file(arguments.ratings_file, config, count)
    else:
        ratings = draw_ratings(config, count, arguments.seed)
    settings = {
        "num_textures": count,
        "textures_per_shard": arguments.textures_per_shard,
        "seed": arguments.seed,
        "checkpoint_sha256": checkpoint_digest(checkpoint),
        "ratings_sha256": hashlib.sha256(ratings.tobytes()).hexdigest(),
        **options,
        "sampling_rate": pipe.feature_extractor.delivery_rate,
        "reference_speed": config.reference_speed,
        "tactile_diffusers": __version__,
        "torch": str(torch.__version__),  # a class of its own, which HDF5 does not take
        "diffusers": diffusers.__version__,
    }
    source = "drawn as the training surfaces'" if arguments.ratings_file is None else arguments.ratings_file.name
    about = {"checkpoint": checkpoint.resolve().name, "ratings": source, "rating_axes": list(config.rating_axes)}
    if state.is_main_process and not arguments.quiet:
        warn_of_novel_ratings(torch.from_numpy(ratings), config)

    def claim():
        arguments.output.mkdir(parents=True, exist_ok=True)
        lock_folder(arguments.output, "--output")
        return open_folder(arguments.output, settings, about)

    missing = _from_main_process(state, claim)
    if not arguments.output.is_dir():
        raise ValueError(f"--output {arguments.output} is not seen by process {state.process_index}: share the folder.")
    attributes = settings | {"checkpoint": about["checkpoint"], "rating_axes": ", ".join(config.rating_axes)}
    return {"pipe": pipe, "ratings": ratings, "options": options, "attributes": attributes, "missing": missing}


def _align_weights(pipe):
    """Copies weights to memory that PyTorch aligned.

    Mapped from a file they lie anywhere, and sums are rounded by where: textures would not be the same bit for bit in
    one process, whose device is "cpu", and in several, which copy to "cpu:0".
    """
    for module in (pipe.lctg, pipe.dale):
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


def _run(arguments, state, pipe, ratings, options, attributes, missing):
    """Makes this process's share of the missing shards; the main process says how fast they were."""
    from accelerate.utils import gather_object
    from tqdm.auto import tqdm

    from ..export.generated import write_shard

    mine = missing[state.process_index :: state.num_processes]
    count = sum(shard["count"] for shard in mine)
    seeds = texture_seeds(arguments.seed, arguments.num_textures)
    attributes = attributes | {"device": str(state.device.type), "batch_size": arguments.batch_size}
    quiet = arguments.quiet or not state.is_main_process
    start = time.perf_counter()
    with tqdm(total=count, desc=f"process 0 of {state.num_processes}", unit="texture", disable=quiet) as bar:
        for shard in mine:
            rows = slice(shard["first"], shard["first"] + shard["count"])
            batches = _batches(pipe, ratings[rows], seeds[rows], options, arguments.batch_size, bar)
            write_shard(arguments.output / shard["file"], shard["count"], attributes, batches)
    done = gather_object([(count, time.perf_counter() - start)])
    if quiet:
        return
    made, seconds = sum(part[0] for part in done), max(part[1] for part in done)
    print(f"{arguments.output}: {arguments.num_textures} textures, {made} of them made now")
    if made:
        rate = made / seconds
        print(
            f"{made} textures in {seconds:.1f} s by {state.num_processes} process(es): {rate:.2f} a second; 100,000 "
            f"would take {1e5 / rate / 3600:.2f} hours"
        )


def _batches(pipe, ratings, seeds, options, batch_size, bar):
    """Columns of a shard, batch by batch; each texture has noise of its own seed."""
    import torch

    for start in range(0, len(ratings), batch_size):
        rows = slice(start, start + batch_size)
        generators = [torch.Generator("cpu").manual_seed(int(seed)) for seed in seeds[rows]]
        out = pipe(ratings[rows], generator=generators, **options)
        yield {
            "textures": out.textures,
            "level": out.level,
            "friction_coefficient": out.friction_coefficient,
            "ratings": ratings[rows],
            "seed": seeds[rows],
        }
        bar.update(len(generators))


@contextmanager
def _one_thread(device):
    """One thread on a CPU: sums over threads are rounded otherwise, and processes use the cores better."""
    import torch

    threads = torch.get_num_threads()
    if device.type == "cpu":
        torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


@contextmanager
def _novelty_said_once():
    """Keeps the pipeline from warning of unusual ratings in every batch: it was said of all of them at the start."""
    logger = logging.getLogger("tactile_diffusers.pipelines.inputs")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.setLevel(level)

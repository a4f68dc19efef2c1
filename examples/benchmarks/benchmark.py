"""`benchmark.py`: arguments and choice of the suite."""

import importlib
import sys
from pathlib import Path

from tactile_diffusers.checkpoints import DISTILLED
from tactile_diffusers.cli.program import Parser, program

#: each measured by `run(arguments, pipe)` of its module: text, or text and how many bounds failed
SUITES = ("speed", "scheduler", "data", "stream", "scene", "dataset", "decoder", "stability", "training")
#: modules that are not called like their suite
MODULES = {"scheduler": "sampler", "data": "data_loading", "dataset": "many_textures", "training": "training_time"}


def parse_arguments(argv=None):
    """Arguments of the command."""
    parser = Parser(prog=program("benchmark.py"), description="Measure speed, memory and accuracy.")
    parser.add_argument("--checkpoint", metavar="FOLDER", help="default: the bundled checkpoint")
    parser.add_argument("--suite", choices=SUITES, default="speed", help="default %(default)s")
    parser.add_argument("--output", type=Path, required=True, metavar="FOLDER", help="JSON and Markdown")
    parser.add_argument("--threads", type=int, help="of torch; default: its own choice")
    parser.add_argument("--repeats", type=int, default=5, help="the median counts")
    compared = parser.add_argument_group("suites beside speed")
    compared.add_argument(
        "--data",
        type=Path,
        metavar="PREPARED.h5",
        help="scheduler, speed: compare on trained models, too; data: load this",
    )
    compared.add_argument("--recordings", type=Path, metavar="R.h5", help="data: prepare these; default: virtual ones")
    compared.add_argument("--segments", type=int, default=60, help="scheduler, speed: held-out segments, one a surface")
    compared.add_argument("--surfaces", type=int, help="stream, training: virtual ones, default 60; scene: 100")
    compared.add_argument(
        "--decoders",
        nargs="+",
        default=[],
        metavar="NAME=FOLDER",
        help="decoder: output folders of examples/distill_lctg.py; default: what the checkpoint brings",
    )
    compared.add_argument("--textures", type=int, default=2000, help="dataset: that are generated")
    compared.add_argument("--minutes", type=float, default=10.0, help="stream, stability: of random motion")
    compared.add_argument("--quick", action="store_true", help="stability: the same cases, fewer steps and repetitions")
    compared.add_argument("--seed", type=int, default=0)
    compared.add_argument("--quiet", action="store_true", help="no progress bars")
    _add_comparison(parser)
    arguments = parser.parse_args(argv)
    if arguments.surfaces is None:
        arguments.surfaces = 100 if arguments.suite == "scene" else 60
    if arguments.repeats < 1 or (arguments.threads is not None and arguments.threads < 1):
        parser.error("arguments --repeats and --threads must be at least 1")
    if arguments.segments < 3 or arguments.seed < 0:
        parser.error("arguments --segments and --seed must be at least 3 and 0")
    if arguments.surfaces < 1 or not 0 < arguments.minutes < 1e4:
        parser.error("arguments --surfaces and --minutes must be at least 1 and above 0")
    for word in arguments.decoders:
        name, _, folder = word.partition("=")
        if not name or not (Path(folder) / DISTILLED).is_dir():
            parser.error(f"argument --decoders: must be NAME=FOLDER with {folder or 'FOLDER'}/{DISTILLED}, got {word}")
    if arguments.suite == "decoder" and arguments.data is None:
        parser.error("argument --data: --suite decoder needs a prepared data set; see examples/prepare_data.py")
    if arguments.textures < 1000:
        parser.error(f"argument --textures: must be at least 1000, got {arguments.textures}")
    if arguments.data is not None and not arguments.data.is_file():
        parser.error(f"argument --data: {arguments.data} is not a file; write one with examples/prepare_data.py")
    if arguments.recordings is not None and not arguments.recordings.is_file():
        parser.error(f"argument --recordings: {arguments.recordings} is not a file")
    _check_comparison(parser, arguments)
    return arguments


def _add_comparison(parser):
    speed = parser.add_argument_group("suite speed")
    speed.add_argument(
        "--peers",
        action="store_true",
        help="beside other packages' models, where installed, and beside our own other forms; with --data also the "
        "error of held-out textures against time",
    )
    speed.add_argument(
        "--batches", type=int, nargs="+", default=[1, 4, 16, 64], help="--peers: textures at once; default 1 4 16 64"
    )
    speed.add_argument("--anchor", type=Path, metavar="FOLDER", help="--peers: checkpoint of the paper's configuration")
    speed.add_argument(
        "--distilled", type=Path, metavar="FOLDER", help="--peers: distilled LCTG; default: the checkpoint's, if any"
    )


def _check_comparison(parser, arguments):
    """Refuses what belongs to the comparison without it, and folders that hold no model."""
    for name, file in (("anchor", "model_index.json"), ("distilled", "config.json")):
        folder = getattr(arguments, name)
        if folder is not None and not (arguments.peers and arguments.suite == "speed"):
            parser.error(f"argument --{name}: needs --suite speed --peers, which it is compared by")
        if folder is not None and not (folder / file).is_file():
            parser.error(f"argument --{name}: {folder} has no {file}; give a folder of save_pretrained")
    if min(arguments.batches) < 1:
        parser.error(f"argument --batches: must be at least 1, got {arguments.batches}")
    arguments.batches = sorted(set(arguments.batches))
    if arguments.peers and arguments.suite != "speed":
        parser.error(f"argument --peers: belongs to --suite speed, got --suite {arguments.suite}")


def main(argv=None):
    """Runs the command."""
    arguments = parse_arguments(argv)
    import torch

    from tactile_diffusers import TactileTexturePipeline, bundled_checkpoint

    arguments.scripts = Path(__file__).parents[1]
    if arguments.threads:
        torch.set_num_threads(arguments.threads)
    arguments.checkpoint = str(arguments.checkpoint or bundled_checkpoint())
    pipe = TactileTexturePipeline.from_pretrained(arguments.checkpoint)
    pipe.set_progress_bar_config(disable=True)
    made = importlib.import_module(MODULES.get(arguments.suite, arguments.suite)).run(arguments, pipe)
    text, failed = made if isinstance(made, tuple) else (made, 0)  # a suite with bounds also counts what misses them
    print(text)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())

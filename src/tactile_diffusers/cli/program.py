"""What the commands share: spelling of options, common arguments and their checks, refusals."""

import argparse
import functools
import math
import re
import sys
import tempfile
from pathlib import Path

from ..checkpoints import bundled_checkpoint
from ..io.argument_types import count, seed
from ..signal.constants import RATING_AXES

#: The console command.
NAME = "tactile-diffusers"
#: `--checkpoint bundled`: the checkpoint that comes with the package.
BUNDLED = "bundled"
_HUB_ID = re.compile(r"[A-Za-z0-9][\w.-]*/[\w.-]+")


def program(script):
    """The name for usage and errors: `script`, or `tactile-diffusers COMMAND` if the command was started that way."""
    return sys.argv[0] if sys.argv[0].startswith(f"{NAME} ") else script


class Parser(argparse.ArgumentParser):
    """An `ArgumentParser` that accepts hyphens and underscores alike in the names of options."""

    def parse_known_args(self, args=None, namespace=None):
        words = sys.argv[1:] if args is None else args
        return super().parse_known_args([self._as_declared(word) for word in words], namespace)

    def _as_declared(self, word):
        name, equals, value = word.partition("=")
        if not name.startswith("--"):
            return word
        others = ("--" + name[2:].replace("-", "_"), "--" + name[2:].replace("_", "-"))
        return next((other for other in (name, *others) if other in self._option_string_actions), name) + equals + value


def refuse(script, error, one_line=True):
    """Prints on stderr why a command stops; returns its exit code, 2."""
    text = " ".join(str(error).split()) if one_line else str(error)
    print(f"{program(script)}: error: {text}", file=sys.stderr)
    return 2


def command(script, one_line=True):
    """Decorates `main(argv)` of a command: what it raises over its input is refused, None is exit code 0.

    Bad arguments end the process with exit code 2 and a line that names the argument (`SystemExit` of argparse).
    """

    def decorate(function):
        @functools.wraps(function)
        def main(argv=None):
            try:
                return function(argv) or 0
            except (ValueError, OSError, FloatingPointError) as error:  # the last: guidance that makes levels explode
                return refuse(script, error, one_line)

        return main

    return decorate


def warn(script, text):
    """Prints a warning of a command on stderr."""
    print(f"{program(script)}: warning: {text}", file=sys.stderr)


def existing_file(word):
    """The path of a file."""
    if not (path := Path(word)).is_file():
        raise argparse.ArgumentTypeError(f"{path} is not a file")
    return path


def existing_folder(word):
    """The path of a folder."""
    if not (path := Path(word)).is_dir():
        raise argparse.ArgumentTypeError(f"{path} is not a folder")
    return path


def output_folder(word):
    """The path of a folder, or of a new one, in which files can be written."""
    path = Path(word)
    if path.exists() and not path.is_dir():
        raise argparse.ArgumentTypeError(f"{path} is not a folder")
    existing = next(folder for folder in (path, *path.absolute().parents) if folder.is_dir())
    try:
        with tempfile.TemporaryFile(dir=existing):
            return path
    except OSError as error:
        raise argparse.ArgumentTypeError(f"{existing} cannot be written: {error.strerror}") from error


def checkpoint(word):
    """What `TactileTexturePipeline.from_pretrained` takes: the path of a folder, or a Hub id."""
    if word == BUNDLED:
        return bundled_checkpoint()
    if not Path(word).is_dir() and not _HUB_ID.fullmatch(word):
        raise argparse.ArgumentTypeError(f"{word} is neither a folder, nor a Hub id (user/name), nor {BUNDLED!r}")
    return word


def add_checkpoint_argument(parser):
    """Adds `--checkpoint`: a folder, a Hub id, or `bundled`. The parsed value is a folder's path or a Hub id."""
    parser.add_argument(
        "--checkpoint",
        type=checkpoint,
        default=BUNDLED,
        metavar="CHECKPOINT",
        help=f"a folder, a Hub id (user/name), or {BUNDLED!r}; default: {BUNDLED}",
    )


def add_seed_argument(parser, purpose="seed of all noise"):
    """Adds `--seed`."""
    parser.add_argument("--seed", type=seed, default=0, help=f"{purpose}; default: 0")


def add_output_argument(parser, purpose):
    """Adds `--output`, a folder that is created if need be."""
    parser.add_argument("--output", type=output_folder, required=True, metavar="FOLDER", help=purpose)


def add_common_arguments(parser, output, seed="seed of all noise"):
    """Adds `--output` and `--seed`, for the purposes given, `--checkpoint` and `--quiet`."""
    add_output_argument(parser, output)
    add_checkpoint_argument(parser)
    add_seed_argument(parser, seed)
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors")


def rating(word):
    """A rating of the command line: a number, or NaN for `none`."""
    try:
        return math.nan if word.lower() == "none" else float(word)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"must be a number, or none = not specified, got {word!r}") from error


def add_axis_arguments(parser, left_out):
    """Adds `--roughness` and so on, and `--rating` for further axes; `left_out` says what becomes of the others."""
    for axis in RATING_AXES:
        parser.add_argument(f"--{axis}", type=float, metavar="VALUE", help=f"{axis} alone; {left_out}")
    parser.add_argument("--rating", nargs=2, action="append", default=[], metavar=("AXIS", "VALUE"), help="an axis by "
        "its name, such as one that an adapted checkpoint knows besides; may be given several times")  # fmt: skip


def ratings_by_axis(parser, arguments):
    """What `add_axis_arguments` added, as a dict of the axes that were given."""
    given = {axis: getattr(arguments, axis) for axis in RATING_AXES if getattr(arguments, axis) is not None}
    try:
        return given | {name: rating(value) for name, value in arguments.rating}
    except argparse.ArgumentTypeError as error:
        parser.error(f"argument --rating: {error}")


#: The arguments of `add_axis_arguments`, for errors.
AXIS_ARGUMENTS = ", ".join((*(f"--{axis}" for axis in RATING_AXES), "--rating"))


def add_generation_arguments(parser):
    """Adds how textures are generated: `--num_inference_steps` and so on; see `generation_options`."""
    add = parser.add_argument
    for name, stage in (("num_inference", "LCTG, the decoder"), ("num_latent_inference", "DALE, which makes latents")):
        add(f"--{name}_steps", type=count, metavar="N", help=f"diffusion steps of {stage}; default: the checkpoint's")
    add("--guidance_scale", type=float, default=1.0, metavar="W", help="weight of the ratings; default: 1, off")
    add("--duration_s", type=float, metavar="SECONDS", help="of a texture, s; default: one segment of 1.6384 s")


def generation_options(arguments):
    """Keywords for a call of the pipeline; those that were left out keep the pipeline's defaults."""
    names = ("num_inference_steps", "num_latent_inference_steps", "guidance_scale", "duration_s")
    found = {name: getattr(arguments, name) for name in names}
    return {name: value for name, value in found.items() if value is not None}


def checkpoint_folder(name):
    """The folder of a checkpoint; one on the Hub is downloaded, an `OSError` if that fails."""
    from ..pipelines import TactileTexturePipeline

    return Path(name if Path(name).is_dir() else TactileTexturePipeline.download(name))


def checkpoint_name(name):
    """What to call a checkpoint in files and reports: the name of its folder, or its Hub id."""
    return Path(name).resolve().name if Path(name).is_dir() else name


def load_pipeline(name, quiet=True, **options):
    """Loads the pipeline of a checkpoint.

    Args:
        name (`str` or `Path`): as `--checkpoint` was parsed.
        quiet (`bool`): no progress bars, of loading and of calls.
        options: of `TactileTexturePipeline.from_pretrained`, such as `dtype`; errors, too.
    """
    from diffusers.utils.logging import disable_progress_bar

    from tactile_diffusers import TactileTexturePipeline

    if quiet:
        disable_progress_bar()
    pipe = TactileTexturePipeline.from_pretrained(str(name), **options)
    pipe.set_progress_bar_config(disable=quiet)
    return pipe

"""`python examples/generate.py`: ratings in, files of a texture out."""

import argparse
import time
from pathlib import Path

from ..signal.constants import RATING_AXES
from .program import Parser, check_folders, check_seed, program, refuse


def rating(word):
    """A rating of the command line: a number, or NaN for `none`."""
    try:
        return float("nan") if word.lower() == "none" else float(word)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"must be a number, or none = not specified, got {word!r}") from error


def parse_arguments(argv=None):
    """Arguments of the command, with `ratings` as a list of three floats in the order of `RATING_AXES`.

    Raises:
        SystemExit: on bad arguments, with exit code 2 and a line that says what is wrong.
    """
    parser = Parser(
        prog=program("generate.py"),
        description="Generate a tactile texture from perceptual ratings and write it as .npz, .wav and .png.",
        epilog="Ratings are z-scores, about -2 to 2, unless --rating-scale says otherwise: larger is rougher, bumpier, "
        "more slippery. The files hold z-scores.",
    )
    parser.add_argument(
        "--ratings",
        nargs=len(RATING_AXES),
        type=rating,
        metavar=tuple(axis.upper() for axis in RATING_AXES),
        help="all three axes, in this order; none = not specified",
    )
    for axis in RATING_AXES:
        parser.add_argument(
            f"--{axis}", type=float, metavar="VALUE", help=f"{axis} alone; axes left out are not specified"
        )
    parser.add_argument(
        "--rating-scale",
        choices=("z", "raw", "percentile"),
        help="z: z-scores (default); raw: the typical rater's 0-8; percentile: 0-100 of the training surfaces",
    )
    parser.add_argument("--output", type=Path, required=True, metavar="FOLDER", help="where the files go")
    parser.add_argument("--checkpoint", type=Path, metavar="FOLDER", help="default: the bundled checkpoint")
    parser.add_argument(
        "--steps", type=int, metavar="N", help="diffusion steps of LCTG, which makes the texture; default: 5"
    )
    parser.add_argument(
        "--latent-steps",
        type=int,
        metavar="N",
        help="diffusion steps of DALE, which makes the latents; default: as --steps",
    )
    parser.add_argument("--guidance-scale", type=float, metavar="W", help="weight of the ratings; 1 = no guidance")
    parser.add_argument(
        "--duration",
        type=float,
        metavar="SECONDS",
        help="default: one segment; another duration is another take of the surface",
    )
    parser.add_argument("--seed", type=int, default=0, help="take k of several is made with seed + k; default: 0")
    parser.add_argument("--takes", type=int, default=1, metavar="N", help="number of textures; default: 1")
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors")
    arguments = parser.parse_args(argv)

    single = [getattr(arguments, axis) for axis in RATING_AXES]
    given = any(value is not None for value in single)
    if given == (arguments.ratings is not None):
        parser.error(f"give either --ratings or one or more of {', '.join('--' + axis for axis in RATING_AXES)}")
    if given:
        arguments.ratings = [float("nan") if value is None else value for value in single]
    if arguments.takes < 1:
        parser.error(f"argument --takes: must be at least 1, got {arguments.takes}")
    check_seed(parser, arguments.seed, arguments.takes)
    check_folders(parser, arguments)
    return arguments


def main(argv=None):
    """Runs the command.

    Args:
        argv (`list[str]`, *optional*): arguments; the process's own by default.

    Returns:
        `int`: 0, or 2 if the pipeline refused the request (one line on stderr, nothing written).
    """
    arguments = parse_arguments(argv)
    try:
        _generate(arguments)
    except (ValueError, OSError, FloatingPointError) as error:  # the last: guidance that makes levels explode
        return refuse("generate.py", error)
    return 0


def _generate(arguments):
    """Makes the textures, then writes them."""
    import torch
    from diffusers.utils.logging import disable_progress_bar

    from tactile_diffusers import TactileTexturePipeline, bundled_checkpoint

    from ..export import write_figure, write_npz, write_wav
    from ..pipelines.inputs import parse_ratings
    from ..signal import rms

    say = (lambda text: None) if arguments.quiet else print
    checkpoint = Path(arguments.checkpoint or bundled_checkpoint())
    if arguments.quiet:
        disable_progress_bar()  # of loading
    pipe = TactileTexturePipeline.from_pretrained(str(checkpoint))
    pipe.set_progress_bar_config(disable=arguments.quiet)

    # options that were not given keep the pipeline's own defaults
    options = {
        "rating_scale": arguments.rating_scale,
        "num_inference_steps": arguments.steps,
        "num_latent_inference_steps": arguments.latent_steps,
        "guidance_scale": arguments.guidance_scale,
        "duration_s": arguments.duration,
    }
    # a generator for each take, so that the seed in each file alone makes that take again
    seeds = [arguments.seed + take for take in range(arguments.takes)]
    generators = [torch.Generator("cpu").manual_seed(seed) for seed in seeds]
    start = time.perf_counter()
    out = pipe(
        arguments.ratings,
        num_textures_per_rating=arguments.takes,
        generator=generators if arguments.takes > 1 else generators[0],
        **{name: value for name, value in options.items() if value is not None},
    )
    elapsed = time.perf_counter() - start
    ratings = arguments.ratings
    if arguments.rating_scale is not None:
        ratings = parse_ratings(ratings, pipe.dale.config, arguments.rating_scale)[0].tolist()
        say(f"ratings in z-scores: {', '.join(f'{a} {z:.2f}' for a, z in zip(RATING_AXES, ratings, strict=True))}")
    seconds = out.textures.shape[-1] / out.sampling_rate
    say(f"{arguments.takes} x {seconds:.2f} s of texture at {out.sampling_rate} Hz generated in {elapsed:.2f} s")

    arguments.output.mkdir(parents=True, exist_ok=True)
    for take, (texture, friction_coefficient, seed) in enumerate(
        zip(out.textures, out.friction_coefficient, seeds, strict=True)
    ):
        stem = "texture" if arguments.takes == 1 else f"texture_{take:03d}"
        common = {
            "sampling_rate": out.sampling_rate,
            "friction_coefficient": float(friction_coefficient),
            "ratings": ratings,
        }
        made = {"seed": seed, "reference_speed": out.reference_speed, "checkpoint": checkpoint.resolve().name}
        npz, wav, png = (arguments.output / f"{stem}{suffix}" for suffix in (".npz", ".wav", ".png"))
        write_npz(npz, texture, **made, **common)
        write_wav(wav, texture, **made, **common)
        write_figure(png, texture, **common)
        say(f"{npz}, {wav}, {png}: RMS {1e3 * rms(texture):.2f} mN, friction coefficient {friction_coefficient:.2f}")

"""`tactile-diffusers generate`: textures of ratings, as files."""

import argparse
import math
import time

from ..pipelines.presets import PRESETS
from ..signal.constants import RATING_AXES
from .program import (
    Parser,
    add_checkpoint_argument,
    add_generation_arguments,
    add_output_argument,
    add_seed_argument,
    checkpoint_name,
    command,
    count,
    generation_options,
    load_pipeline,
    program,
)


def rating(word):
    """A rating of the command line: a number, or NaN for `none`."""
    try:
        return math.nan if word.lower() == "none" else float(word)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"must be a number, or none = not specified, got {word!r}") from error


def parse_arguments(argv=None):
    """Arguments of the command, with `ratings` in the order of `RATING_AXES`, or by name."""
    parser = Parser(
        prog=program("generate.py"),
        description="Generate tactile textures from perceptual ratings and write them as .npz, .wav and .png.",
        epilog="Ratings are z-scores, about -2 to 2, unless --rating_scale says otherwise; larger is rougher, bumpier, "
        "more slippery. The files hold z-scores.",
    )
    add = parser.add_argument
    add("--ratings", nargs=len(RATING_AXES), type=rating, metavar=tuple(axis.upper() for axis in RATING_AXES),
        help="all three ratings, in this order; none = not specified")  # fmt: skip
    for axis in RATING_AXES:
        add(f"--{axis}", type=float, metavar="VALUE", help=f"{axis} alone; axes left out are not specified")
    add("--rating", nargs=2, action="append", default=[], metavar=("AXIS", "VALUE"), help="an axis by its name, such "
        "as one that an adapted checkpoint has beside the three; may be given several times")  # fmt: skip
    add("--preset", choices=PRESETS, metavar="NAME", help=f"ratings by name, one of: {'; '.join(PRESETS)}")
    add("--rating_scale", choices=("z", "raw", "percentile"), default="z", help="z: z-scores (default); raw: a typical "
        "rater's 0-8; percentile: 0-100 of the training surfaces")  # fmt: skip
    add("--num_textures_per_rating", type=count, default=1, metavar="N", help="textures of these ratings; texture k "
        "has the seed --seed + k; default: 1")  # fmt: skip
    add_generation_arguments(parser)
    add_output_argument(parser, "folder of the files; of several textures, the first gets a picture")
    add_checkpoint_argument(parser)
    add_seed_argument(parser)
    add("--quiet", action="store_true", help="print errors only")
    arguments = parser.parse_args(argv)

    single = {axis: getattr(arguments, axis) for axis in RATING_AXES if getattr(arguments, axis) is not None}
    try:
        single |= {name: rating(value) for name, value in arguments.rating}
    except argparse.ArgumentTypeError as error:
        parser.error(f"argument --rating: {error}")
    by_axis = bool(single)
    if by_axis + (arguments.ratings is not None) + (arguments.preset is not None) != 1:
        axes = ", ".join(f"--{axis}" for axis in RATING_AXES)
        parser.error(f"give either --ratings, or --preset, or one or more of {axes}, --rating")
    if arguments.preset is not None and arguments.rating_scale != "z":
        parser.error("argument --rating_scale: leave it out, the ratings of a --preset are z-scores")
    if arguments.ratings is None:
        values = PRESETS[arguments.preset] if arguments.preset else [single.get(axis) for axis in RATING_AXES]
        by_name = single if arguments.rating else None
        arguments.ratings = by_name or [math.nan if value is None else value for value in values]
    if arguments.seed + arguments.num_textures_per_rating > 2**63:
        parser.error(f"argument --seed: must be smaller for so many textures, got {arguments.seed}")
    return arguments


@command("generate.py")
def main(argv=None):
    """Runs the command."""
    arguments = parse_arguments(argv)
    import torch

    from ..pipelines.inputs import parse_ratings

    say = (lambda text: None) if arguments.quiet else print
    number = arguments.num_textures_per_rating
    pipe = load_pipeline(arguments.checkpoint, arguments.quiet)
    # one generator per texture, so that the seed in its file reproduces it alone
    seeds = [arguments.seed + k for k in range(number)]
    generators = [torch.Generator("cpu").manual_seed(seed) for seed in seeds]
    start = time.perf_counter()
    out = pipe(
        arguments.ratings,
        rating_scale=arguments.rating_scale,
        num_textures_per_rating=number,
        generator=generators if number > 1 else generators[0],
        **generation_options(arguments),
    )
    elapsed = time.perf_counter() - start
    ratings = arguments.ratings
    if arguments.rating_scale != "z" or arguments.rating:
        axes = pipe.dale.config.rating_axes
        ratings = parse_ratings(ratings, pipe.dale.config, arguments.rating_scale)[0].tolist()
        say(f"ratings in z-scores: {', '.join(f'{a} {z:.2f}' for a, z in zip(axes, ratings, strict=True))}")
    seconds = out.textures.shape[-1] / out.sampling_rate
    say(f"{number} x {seconds:.2f} s of texture at {out.sampling_rate} Hz generated in {elapsed:.2f} s")
    _write(arguments, out, ratings, seeds, say)


def _write(arguments, out, ratings, seeds, say):
    """Writes .npz and .wav of each texture, and a picture of the first: a picture takes a second to draw."""
    from ..export import write_figure, write_npz, write_wav
    from ..signal import rms

    arguments.output.mkdir(parents=True, exist_ok=True)
    origin = {"reference_speed": out.reference_speed, "checkpoint": checkpoint_name(arguments.checkpoint)}
    for number, (texture, friction, seed) in enumerate(zip(out.textures, out.friction_coefficient, seeds, strict=True)):
        stem = "texture" if len(seeds) == 1 else f"texture_{number:03d}"
        npz, wav, png = files = [arguments.output / f"{stem}{suffix}" for suffix in (".npz", ".wav", ".png")]
        common = {"sampling_rate": out.sampling_rate, "friction_coefficient": float(friction), "ratings": ratings}
        write_npz(npz, texture, seed=seed, **origin, **common)
        write_wav(wav, texture, seed=seed, **origin, **common)
        if number == 0:
            write_figure(png, texture, **common)
        written = ", ".join(str(path) for path in (files if number == 0 else files[:2]))
        say(f"{written}: RMS {1e3 * rms(texture):.2f} mN, friction coefficient {friction:.2f}")

"""`tactile-diffusers generate`: textures of ratings, as files."""

import time

from ..io.argument_types import count
from ..pipelines import PRESETS
from ..signal.constants import RATING_AXES
from .program import (
    AXIS_ARGUMENTS,
    Parser,
    add_axis_arguments,
    add_common_arguments,
    add_generation_arguments,
    command,
    generation_options,
    load_pipeline,
    program,
    rating,
    ratings_by_axis,
)
from .recording_file import write_texture


def parse_arguments(argv=None):
    """Arguments of the command, with `ratings` by name: a checkpoint may have further axes."""
    parser = Parser(
        prog=program("generate.py"),
        description="Generate tactile textures from perceptual ratings and write them as .npz, .wav and .png.",
        epilog="Ratings are z-scores, about -2 to 2, unless --rating_scale says otherwise; larger is rougher, bumpier, "
        "more slippery. The files hold z-scores.",
    )
    add = parser.add_argument
    add("--ratings", nargs=len(RATING_AXES), type=rating, metavar=tuple(axis.upper() for axis in RATING_AXES),
        help="all three ratings, in this order; none = not specified")  # fmt: skip
    add_axis_arguments(parser, "axes left out are not specified")
    add("--preset", choices=PRESETS, metavar="NAME", help=f"ratings by name, one of: {'; '.join(PRESETS)}")
    add("--rating_scale", choices=("z", "raw", "percentile"), default="z", help="z: z-scores (default); raw: a typical "
        "rater's 0-8; percentile: 0-100 of the training surfaces")  # fmt: skip
    add("--num_textures_per_rating", type=count, default=1, metavar="N", help="textures of these ratings; texture k "
        "has the seed --seed + k; default: 1")  # fmt: skip
    add_generation_arguments(parser)
    add_common_arguments(parser, "folder of the files; of several textures, the first gets a picture")
    arguments = parser.parse_args(argv)

    single = ratings_by_axis(parser, arguments)
    rows = [row for row in (arguments.ratings, PRESETS.get(arguments.preset)) if row is not None]
    if len(rows) + bool(set(single) & set(RATING_AXES)) > 1 or not (rows or single):
        ask = f"give either --ratings, or --preset, or one or more of {AXIS_ARGUMENTS}"
        parser.error(f"{ask}; beside the first two, --rating may name a further axis")
    if arguments.preset is not None and arguments.rating_scale != "z":
        parser.error("argument --rating_scale: leave it out, the ratings of a --preset are z-scores")
    arguments.ratings = dict(zip(RATING_AXES, *rows or [()], strict=False)) | single
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
    axes = pipe.dale.config.rating_axes
    ratings = [arguments.ratings.get(axis) for axis in axes]
    if arguments.rating_scale != "z" or arguments.rating:
        ratings = parse_ratings(arguments.ratings, pipe.dale.config, arguments.rating_scale)[0].tolist()
        say(f"ratings in z-scores: {', '.join(f'{a} {z:.2f}' for a, z in zip(axes, ratings, strict=True))}")
    seconds = out.textures.shape[-1] / out.sampling_rate
    say(f"{number} x {seconds:.2f} s of texture at {out.sampling_rate} Hz generated in {elapsed:.2f} s")
    for row, seed in enumerate(seeds):  # a picture takes a second to draw: the first one gets it
        name = "texture" if number == 1 else f"texture_{row:03d}"
        write_texture(arguments, name, out, ratings, row, seed=seed, picture=row == 0, axes=axes)

"""`tactile-diffusers edit`, `continue` and `loop`: a recording changed, longer, or closed."""

import math
from dataclasses import replace

import numpy as np

from ..io.argument_types import positive_number
from .program import (
    AXIS_ARGUMENTS,
    Parser,
    add_axis_arguments,
    add_common_arguments,
    command,
    load_pipeline,
    program,
    ratings_by_axis,
)
from .recording_file import OPEN, add_recording_arguments, read_recording_file, write_texture

#: What is made anew on either side of a saturated stretch, s: the band-pass smears it.
MARGIN_SECONDS = 0.01


def parse_arguments(argv=None):
    """Arguments of `edit`."""
    parser = _editing_parser("edit.py", "Change a recording of lateral force by ratings, or make stretches of it anew.")
    add = parser.add_argument
    add_axis_arguments(parser, "what is left out stays")
    add("--rating_scale", choices=("difference", "z", "raw", "percentile"), default="difference", help="difference: "
        "z-scores added to the recording's (default); else as of generate")  # fmt: skip
    add("--source_ratings", nargs="+", type=float, metavar="Z", help="the recording's own, z-scores in order of the "
        "checkpoint's axes; default: estimated")  # fmt: skip
    add("--strength", type=float, default=0.5, metavar="S", help="0: the recording, 1: a fresh take; default: 0.5")
    add("--mask", nargs=2, type=float, action="append", metavar=("START", "STOP"), help="s; what lies between is made "
        "anew; may be given several times")  # fmt: skip
    add("--repair", action="store_true", help="make anew where the force stays at an end of its range")
    arguments = parser.parse_args(argv)
    arguments.ratings = ratings_by_axis(parser, arguments)
    if bool(arguments.ratings) + bool(arguments.mask or arguments.repair) != 1:
        parser.error(f"give either --mask or --repair, or one or more of {AXIS_ARGUMENTS}")
    return arguments


@command("edit.py")
def main(argv=None):
    """Runs `edit`."""
    arguments = parse_arguments(argv)
    _run_edit("edit.py", "edited", arguments, _masked if arguments.mask or arguments.repair else _rated)


@command("lengthen.py")
def lengthen(argv=None):
    """Runs `continue`."""
    parser = _editing_parser("lengthen.py", "Continue a recording of lateral force, which itself stays as it is.")
    parser.add_argument("--seconds", type=positive_number, required=True, help="s to append")
    arguments = parser.parse_args(argv)
    options = {"continue_s": arguments.seconds}, OPEN
    _run_edit("lengthen.py", "continued", arguments, lambda *given: options)


@command("loop.py")
def loop(argv=None):
    """Runs `loop`."""
    parser = _editing_parser("loop.py", "Close a recording of lateral force: its end leads into its beginning.")
    parser.add_argument("--seconds", type=positive_number, help="s to append, from the end to the beginning; "
        "default: 0.1 s on either side of the seam are made anew")  # fmt: skip
    arguments = parser.parse_args(argv)
    options = {"loop": True, "continue_s": arguments.seconds}, OPEN
    _run_edit("loop.py", "loop", arguments, lambda *given: options)


def _masked(arguments, pipe, recording):
    """Options of a call that makes stretches anew; ratings stay open."""
    from ..data.force_checks import saturated
    from ..pipelines.filling import parse_mask
    from ..signal.masks import bridge_gaps

    mask = parse_mask(arguments.mask, len(recording.texture), recording.rate)
    if arguments.repair:
        margin = round(MARGIN_SECONDS * recording.rate)
        near = saturated(recording.force, recording.rate)
        near = np.convolve(near, np.ones(2 * margin + 1), mode="same") > 0.5
        mask |= bridge_gaps(near, margin)
        if not mask.any():
            raise ValueError(f"--repair: nothing of {arguments.recording_file} is saturated. Give --mask.")
    return {"mask": mask}, OPEN


def _rated(arguments, pipe, recording):
    """Options of a call that changes ratings, and the ratings that are reached for."""
    from ..pipelines.recordings import target_ratings

    axes, ratings, source = pipe.dale.config.rating_axes, arguments.ratings, arguments.source_ratings
    if source is None:
        source = pipe.estimate_ratings(recording.texture, recording.rate, recording.friction_coefficient)[0]
    if len(source) > len(axes):
        raise ValueError(
            f"--source_ratings: the checkpoint has {len(axes)} axes, {', '.join(axes)}; got {len(source)}."
        )
    source = np.pad(np.asarray(source, dtype=np.float32), (0, len(axes) - len(source)), constant_values=np.nan)
    if not arguments.quiet:
        print("ratings of the recording:", ", ".join(f"{a} {z:+.2f}" for a, z in zip(axes, source, strict=True)))
    import torch

    target = target_ratings(ratings, arguments.rating_scale, torch.from_numpy(source[None]), pipe.dale.config)
    options = {"ratings": ratings, "rating_scale": arguments.rating_scale, "source_ratings": source}
    return options | {"strength": arguments.strength}, target[0].tolist()


def _editing_parser(script, description):
    """The parser of a command that makes a texture of a recording."""
    parser = Parser(prog=program(script), description=description)
    add_recording_arguments(parser)
    parser.add_argument("--friction_coefficient", type=float, default=math.nan, metavar="MU", help="of the recording, "
        "mean lateral by mean normal force; default: that of a texture of this package, else unknown")  # fmt: skip
    add_common_arguments(parser, "folder of the texture's .npz, .wav and .png; created if need be")
    return parser


def _run_edit(script, name, arguments, options):
    """Reads the recording, calls the edit pipeline and writes NAME.npz, .wav and .png.

    `options` is called with the arguments, the pipeline and the recording; it returns the options of the call, and the
    ratings of what is made, z-scores.
    """
    import torch

    from ..pipelines import TactileTextureEditPipeline

    recording = read_recording_file(script, arguments, arguments.quiet)
    if not math.isnan(arguments.friction_coefficient):
        recording = replace(recording, friction_coefficient=arguments.friction_coefficient)
    pipe = TactileTextureEditPipeline.from_pipe(load_pipeline(arguments.checkpoint, arguments.quiet))
    settings, ratings = options(arguments, pipe, recording)
    generator = torch.Generator("cpu").manual_seed(arguments.seed)
    friction = recording.friction_coefficient
    out = pipe(recording.texture, recording.rate, friction_coefficient=friction, generator=generator, **settings)
    write_texture(arguments, name, out, ratings, axes=pipe.dale.config.rating_axes)

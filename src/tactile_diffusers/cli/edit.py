"""`tactile-diffusers edit`: a recording changed by ratings, or stretches of it made anew."""

import numpy as np

from .editing import editing_parser, run_edit
from .program import AXIS_ARGUMENTS, add_axis_arguments, command, ratings_by_axis
from .recording_file import OPEN

#: What is made anew on either side of a saturated stretch, s: the band-pass smears it.
MARGIN_SECONDS = 0.01


def parse_arguments(argv=None):
    """Arguments of the command."""
    parser = editing_parser("edit.py", "Change a recording of lateral force by ratings, or make stretches of it anew.")
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
    """Runs the command."""
    arguments = parse_arguments(argv)
    run_edit("edit.py", "edited", arguments, _masked if arguments.mask or arguments.repair else _rated)


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

"""What `edit`, `continue` and `loop` share: arguments, the pipeline, one call of it."""

import math
from dataclasses import replace

from .program import Parser, add_common_arguments, load_pipeline, program
from .recording_file import add_recording_arguments, read_recording_file, write_texture


def editing_parser(script, description):
    """The parser of a command that makes a texture of a recording."""
    parser = Parser(prog=program(script), description=description)
    add_recording_arguments(parser)
    parser.add_argument("--friction_coefficient", type=float, default=math.nan, metavar="MU", help="of the recording, "
        "mean lateral by mean normal force; default: that of a texture of this package, else unknown")  # fmt: skip
    add_common_arguments(parser, "folder of the texture's .npz, .wav and .png; created if need be")
    return parser


def run_edit(script, name, arguments, options):
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
    write_texture(arguments, name, out, ratings)

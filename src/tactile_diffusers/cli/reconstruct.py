"""`tactile-diffusers reconstruct`: a recording through LCTG's encoder and decoder, and how close it comes."""

import json

from ..io.argument_types import count
from .program import Parser, add_common_arguments, command, load_pipeline, program
from .recording_file import add_recording_arguments, read_recording_file, write_texture


def parse_arguments(argv=None):
    """Arguments of the command."""
    parser = Parser(
        prog=program("reconstruct.py"),
        description="Encode and decode a recording of lateral force, to see what the latents keep of it. It is "
        "band-passed to 20-1000 Hz first. Writes reconstruction.npz, .wav and .png.",
    )
    add_recording_arguments(parser)
    add_common_arguments(parser, "where the files go; created if need be", "seed of the decoder's noise")
    parser.add_argument(
        "--num_inference_steps", type=count, metavar="N", help="diffusion steps of LCTG; default: the checkpoint's"
    )
    parser.add_argument("--json", action="store_true", help="print metrics and files as JSON, and nothing else")
    return parser.parse_args(argv)


@command("reconstruct.py")
def main(argv=None):
    """Runs the command."""
    arguments = parse_arguments(argv)
    report = _reconstruct(arguments)
    if arguments.json:
        print(json.dumps(report, indent=2))
    elif not arguments.quiet:
        print(f"nine-band error {report['nine_band_error_db']:.2f} dB, SNR {report['snr_db']:.1f} dB")


def _reconstruct(arguments):
    import torch

    from ..evaluation.metrics.errors import snr_db
    from ..signal import nine_band_error_db, resample, rms

    arguments.quiet |= arguments.json
    recording = read_recording_file("reconstruct.py", arguments, arguments.quiet)
    pipe = load_pipeline(arguments.checkpoint, arguments.quiet)
    generator = torch.Generator("cpu").manual_seed(arguments.seed)
    out = pipe.reconstruct(recording.texture, recording.rate, arguments.num_inference_steps, generator)
    reconstructed = out.textures[0]
    reference = resample(recording.texture, recording.rate, out.sampling_rate)[: len(reconstructed)]
    files = write_texture(arguments, "reconstruction", out, original=reference)
    error = nine_band_error_db(reconstructed[None], reference[None], out.sampling_rate)
    return {
        "seconds": len(reconstructed) / out.sampling_rate,
        "nine_band_error_db": float(error[0]),
        "snr_db": float(snr_db(reconstructed[None], reference[None])[0]),
        "rms_mn": 1e3 * float(rms(reconstructed)),
        "notes": recording.notes,
        "files": [str(path) for path in files],
    }

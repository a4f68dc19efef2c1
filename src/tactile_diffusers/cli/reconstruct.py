"""`tactile-diffusers reconstruct`: a recording through LCTG's encoder and decoder, and how close it comes."""

import json

from .program import (
    Parser,
    add_checkpoint_argument,
    add_output_argument,
    add_seed_argument,
    command,
    count,
    load_pipeline,
    program,
)
from .recording_file import add_recording_arguments, read_texture


def parse_arguments(argv=None):
    """Arguments of the command."""
    parser = Parser(
        prog=program("reconstruct.py"),
        description="Encode and decode a recording of lateral force, to see what the latents keep of it. It is "
        "band-passed to 20-1000 Hz first. Writes reconstruction.npz, .wav and .png.",
    )
    add_recording_arguments(parser)
    add_output_argument(parser, "where the files go; created if need be")
    add_checkpoint_argument(parser)
    parser.add_argument(
        "--num_inference_steps", type=count, metavar="N", help="diffusion steps of LCTG; default: the checkpoint's"
    )
    add_seed_argument(parser, "seed of the decoder's noise")
    parser.add_argument("--json", action="store_true", help="print metrics and files as JSON, and nothing else")
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors")
    return parser.parse_args(argv)


@command("reconstruct.py")
def main(argv=None):
    """Runs the command."""
    arguments = parse_arguments(argv)
    report = _reconstruct(arguments)
    if arguments.json:
        print(json.dumps(report, indent=2))
    elif not arguments.quiet:
        print(
            f"{report['seconds']:.2f} s: nine-band error {report['nine_band_error_db']:.2f} dB, "
            f"SNR {report['snr_db']:.1f} dB, RMS {report['rms_mn']:.2f} mN\nwrote {', '.join(report['files'])}"
        )


def _reconstruct(arguments):
    import torch

    from ..evaluation.metrics.errors import snr_db
    from ..export import write_figure, write_npz, write_wav
    from ..signal import nine_band_error_db, resample, rms

    quiet = arguments.quiet or arguments.json
    texture, rate, notes = read_texture("reconstruct.py", arguments, quiet)
    pipe = load_pipeline(arguments.checkpoint, quiet)
    generator = torch.Generator("cpu").manual_seed(arguments.seed)
    out = pipe.reconstruct(texture, rate, arguments.num_inference_steps, generator)
    reconstructed = out.textures[0]
    reference = resample(texture, rate, out.sampling_rate)[: len(reconstructed)]
    common = {"sampling_rate": out.sampling_rate, "friction_coefficient": float("nan"), "ratings": [float("nan")] * 3}
    origin = {"seed": arguments.seed, "reference_speed": out.reference_speed}
    arguments.output.mkdir(parents=True, exist_ok=True)
    files = [arguments.output / f"reconstruction{suffix}" for suffix in (".npz", ".wav", ".png")]
    write_npz(files[0], reconstructed, **common, **origin)
    write_wav(files[1], reconstructed, **common, **origin)
    write_figure(files[2], reconstructed, **common, original=reference)
    error = nine_band_error_db(reconstructed[None], reference[None], out.sampling_rate)
    return {
        "seconds": len(reconstructed) / out.sampling_rate,
        "nine_band_error_db": float(error[0]),
        "snr_db": float(snr_db(reconstructed[None], reference[None])[0]),
        "rms_mn": 1e3 * float(rms(reconstructed)),
        "notes": notes,
        "files": [str(path) for path in files],
    }

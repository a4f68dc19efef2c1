"""`tactile-diffusers reconstruct`: a recording through LCTG's encoder and decoder, and how close it comes."""

import json
import sys
from pathlib import Path

from .program import (
    Parser,
    add_checkpoint_argument,
    add_output_argument,
    add_seed_argument,
    command,
    count,
    load_pipeline,
    positive_number,
    program,
    warn,
)


def parse_arguments(argv=None):
    """Arguments of the command."""
    parser = Parser(
        prog=program("reconstruct.py"),
        description="Encode and decode a recording of lateral force, to see what the latents keep of it. It is "
        "band-passed to 20-1000 Hz first. Writes reconstruction.npz, .wav and .png.",
    )
    kinds = "csv, xlsx, npy, npz, mat, hdf5, parquet or wav with the lateral force, or recordings.h5"
    parser.add_argument("recording_file", type=Path, metavar="FILE", help=kinds)
    parser.add_argument(
        "--column", metavar="NAME", help="of the force, by name or number from 0; default: the only possible one"
    )
    parser.add_argument(
        "--recording",
        metavar="NAME",
        help="in recordings.h5: surface/explorer/trial; in other files: the sheet, group or array; default: the first",
    )
    parser.add_argument(
        "--rate", type=float, metavar="HZ", help="sampling rate, Hz; default: the file's, or that of its time stamps"
    )
    parser.add_argument(
        "--newtons_per_unit",
        type=positive_number,
        metavar="N",
        help="N per unit of the numbers, or at full scale of a WAV; default: by the name of the column, as Fx_mN, or "
        "the sidecar of a WAV of this package; else 1",
    )
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


def _read(arguments):
    """Texture, rate and notes; a WAV file of this package with its sidecar comes back in newtons."""
    from ..data.folder import read_recording
    from ..export.wav import read_wav, sidecar_path
    from ..signal import band_pass

    path, scale = arguments.recording_file, arguments.newtons_per_unit
    if scale is None and path.suffix.lower() == ".wav" and sidecar_path(path).is_file():
        force, metadata = read_wav(path)
        rate, notes = metadata["sampling_rate"], []
    else:
        force, rate, notes = read_recording(path, arguments.column, arguments.rate, scale, arguments.recording)
    return band_pass(force - force.mean(), rate), rate, notes


def _reconstruct(arguments):
    import torch

    from ..data.folder.recording import LARGEST_RMS
    from ..evaluation.metrics.errors import snr_db
    from ..export import write_figure, write_npz, write_wav
    from ..signal import REFERENCE_FORCE, nine_band_error_db, resample, rms

    texture, rate, notes = _read(arguments)
    quiet = arguments.quiet or arguments.json
    for note in [] if quiet else notes:
        print(f"{program('reconstruct.py')}: note: {note}", file=sys.stderr)
    if rms(texture) > LARGEST_RMS:
        warn(
            "reconstruct.py",
            f"{arguments.recording_file}: RMS {1e3 * rms(texture):.0f} mN is more than textures have at a normal force "
            f"of {REFERENCE_FORCE} N. Give --newtons_per_unit if these are not newtons.",
        )
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

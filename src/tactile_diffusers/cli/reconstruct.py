"""`tactile-diffusers reconstruct`: a recording through LCTG's encoder and decoder, and how near it comes."""

import json
import math
import sys
from pathlib import Path

from .program import Parser, check_folders, check_seed, program, refuse


def parse_arguments(argv=None):
    """Arguments of the command.

    Raises:
        SystemExit: on bad arguments, with exit code 2 and a line that says what is wrong.
    """
    parser = Parser(
        prog=program("reconstruct.py"),
        description="Encode and decode a recording: what is left of it in the latents. It is band-passed to 20-1000 Hz "
        "first. Writes reconstruction.npz, .wav and .png.",
    )
    parser.add_argument("recording", type=Path, help="csv, xlsx, npy, npz, mat, hdf5, parquet or wav; lateral force")
    parser.add_argument(
        "--column", metavar="NAME", help="of the force, by name or number from 0; where there are several"
    )
    parser.add_argument(
        "--rate", type=float, metavar="HZ", help="sampling rate; default: the file's, or that of its column of time"
    )
    parser.add_argument(
        "--newtons_per_unit",
        type=float,
        metavar="N",
        help="of the numbers in the file, of full scale in a WAV; default: "
        "what the column's name says, as Fx_mN, or the sidecar of a WAV of this package; else 1",
    )
    parser.add_argument("--output", type=Path, required=True, metavar="FOLDER", help="where the files go")
    parser.add_argument("--checkpoint", type=Path, metavar="FOLDER", help="default: the bundled checkpoint")
    parser.add_argument("--steps", type=int, metavar="N", help="diffusion steps; default: the checkpoint's")
    parser.add_argument("--seed", type=int, default=0, help="of the decoder's noise; default: 0")
    parser.add_argument("--json", action="store_true", help="print figures and files as JSON, and nothing else")
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors")
    arguments = parser.parse_args(argv)
    if arguments.newtons_per_unit is not None and not 0 < arguments.newtons_per_unit < math.inf:
        parser.error(f"argument --newtons_per_unit: must be above zero, got {arguments.newtons_per_unit}")
    check_seed(parser, arguments.seed)
    check_folders(parser, arguments)
    return arguments


def main(argv=None):
    """Runs the command.

    Args:
        argv (`list[str]`, *optional*): arguments; the process's own by default.

    Returns:
        `int`: 0, or 2 if the recording or an option was refused (one line on stderr, nothing written).
    """
    arguments = parse_arguments(argv)
    try:
        report = _reconstruct(arguments)
    except (ValueError, OSError) as error:
        return refuse("reconstruct.py", error)
    if arguments.json:
        print(json.dumps(report, indent=2))
    elif not arguments.quiet:
        print(
            f"{report['seconds']:.2f} s: nine-band error {report['nine_band_error_db']:.2f} dB, "
            f"SNR {report['snr_db']:.1f} dB, RMS {report['rms_mn']:.2f} mN\nwrote {', '.join(report['files'])}"
        )
    return 0


def _reconstruct(arguments):
    import torch
    from diffusers.utils.logging import disable_progress_bar

    from tactile_diffusers import TactileTexturePipeline, bundled_checkpoint

    from ..evaluation.metrics.errors import snr_db
    from ..export import write_figure, write_npz, write_wav
    from ..signal import REFERENCE_FORCE, nine_band_error_db, resample, rms
    from .recording import LARGEST_RMS, read_recording

    texture, rate = read_recording(arguments.recording, arguments.column, arguments.rate, arguments.newtons_per_unit)
    if rms(texture) > LARGEST_RMS:
        print(
            f"{program('reconstruct.py')}: warning: {arguments.recording}: RMS {1e3 * rms(texture):.0f} mN is more "
            f"than textures have at a normal force of {REFERENCE_FORCE} N. Give --newtons_per_unit if these are not "
            "newtons.",
            file=sys.stderr,
        )
    if arguments.quiet or arguments.json:
        disable_progress_bar()  # of loading
    pipe = TactileTexturePipeline.from_pretrained(str(arguments.checkpoint or bundled_checkpoint()))
    pipe.set_progress_bar_config(disable=arguments.quiet or arguments.json)
    generator = torch.Generator("cpu").manual_seed(arguments.seed)
    out = pipe.reconstruct(texture, rate, arguments.steps, generator)
    made = out.textures[0]
    reference = resample(texture, rate, out.sampling_rate)[: len(made)]
    common = {"sampling_rate": out.sampling_rate, "friction_coefficient": float("nan"), "ratings": [float("nan")] * 3}
    origin = {"seed": arguments.seed, "reference_speed": out.reference_speed}
    arguments.output.mkdir(parents=True, exist_ok=True)
    files = [arguments.output / f"reconstruction{suffix}" for suffix in (".npz", ".wav", ".png")]
    write_npz(files[0], made, **common, **origin)
    write_wav(files[1], made, **common, **origin)
    write_figure(files[2], made, **common, original=reference)
    return {
        "seconds": len(made) / out.sampling_rate,
        "nine_band_error_db": float(nine_band_error_db(made[None], reference[None], out.sampling_rate)[0]),
        "snr_db": float(snr_db(made[None], reference[None])[0]),
        "rms_mn": 1e3 * float(rms(made)),
        "files": [str(path) for path in files],
    }

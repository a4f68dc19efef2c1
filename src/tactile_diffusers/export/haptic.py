"""Meta's `.haptic` 1.0 (facebook/meta-haptics-sdk, `resources/haptic-file-spec.md`): a lossy preview."""

import json

import numpy as np

from ..io.files import write_text
from ..io.reading import read_json, reading
from ..version import __version__
from .checks import check_file
from .envelopes import LOSSY, envelopes, from_unit, play, to_unit
from .metadata import METADATA_KEY, check_arguments, check_read, check_span, metadata_from_json, metadata_to_json

#: Hz at frequency 0 and 1 of Meta's controllers (`resources/acf/MetaQuest.acf` of the same repository).
FREQUENCY_HZ = (55.0, 200.0)
DECIMALS = 5


def write_haptic(
    path, texture, *, sampling_rate, friction_coefficient, reference_speed, ratings, seed, checkpoint=None
):
    """Writes a lossy preview: amplitude and frequency every 20 ms, for controllers that play one sine at a time.

    Amplitude is that of a sine of the texture's power, 1 = the largest (`newtons_per_full_scale`); frequency is the
    mean of the power spectrum, 0 = 55 Hz and 1 = 200 Hz as on Meta Quest controllers, cut beyond. Spectrum and waveform
    are lost. `metadata.description` says so; what belongs to the texture is in `metadata.tactile_diffusers`.

    Args:
        path (`str` or `Path`): the file; its folder must exist. An existing file is replaced as a whole.
        texture, sampling_rate, friction_coefficient, reference_speed, ratings, seed, checkpoint: as in `write_npz`.

    Raises:
        ValueError: on a bad argument, before anything is written.
    """
    texture, metadata = check_arguments(
        texture, sampling_rate, friction_coefficient, reference_speed, ratings, seed, checkpoint
    )
    times, amplitude, frequency = envelopes(texture, sampling_rate)
    scale = float(amplitude.max()) or 1.0  # silence: any scale will do
    metadata |= {"newtons_per_full_scale": scale, "samples": len(texture)}
    contents = {
        "version": {"major": 1, "minor": 0, "patch": 0},
        "metadata": {
            "editor": f"tactile_diffusers {__version__}",
            "description": LOSSY,
            METADATA_KEY: metadata_to_json(metadata),
        },
        "signals": {
            "continuous": {
                "envelopes": {
                    "amplitude": _points("amplitude", times, amplitude / scale),
                    "frequency": _points("frequency", times, to_unit(frequency, FREQUENCY_HZ)),
                }
            }
        },
    }
    write_text(path, json.dumps(contents, indent=1, allow_nan=False) + "\n")


def _points(name, times, values):
    rounded = zip(np.round(times, DECIMALS).tolist(), np.round(values, DECIMALS).tolist(), strict=True)
    return [{"time": time, name: value} for time, value in rounded]


def read_haptic(path):
    """Reads what `write_haptic` wrote and plays it: a sine of changing amplitude and frequency.

    Args:
        path (`str` or `Path`): the file.

    Returns:
        `tuple[np.ndarray, dict]`: the preview (samples,) float32 in N at the sampling rate of the texture, and what
        belongs to it as in `read_npz`; also `newtons_per_full_scale` and `samples`.

    Raises:
        FileNotFoundError: if there is no file.
        ValueError: if this package did not write it.
    """
    path = check_file(path)
    with reading(path, "a .haptic file that this package wrote", "Write the texture again."):
        contents = read_json(path, "JSON")
        found = contents["metadata"][METADATA_KEY]
        points = contents["signals"]["continuous"]["envelopes"]
        times, amplitude = (np.array([point[name] for point in points["amplitude"]]) for name in ("time", "amplitude"))
        frequency = np.array([point["frequency"] for point in points["frequency"]])
        metadata = metadata_from_json(found, path, ("newtons_per_full_scale", "samples"))
        check_span(times[-1], metadata)
        amplitude = amplitude * metadata["newtons_per_full_scale"]
        frequency = from_unit(frequency, FREQUENCY_HZ)
        texture = play(times, amplitude, frequency, metadata["sampling_rate"], metadata["samples"])
        return check_read(texture, metadata)

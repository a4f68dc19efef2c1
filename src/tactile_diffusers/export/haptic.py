"""Meta's `.haptic` 1.0 (facebook/meta-haptics-sdk, `resources/haptic-file-spec.md`): a lossy preview."""

import json

import numpy as np

from ..io.files import write_text
from ..version import __version__
from .metadata import METADATA_KEY
from .previews import DECIMALS, LOSSY, from_unit, preview, read_preview, to_unit

#: Hz at frequency 0 and 1 of Meta's controllers (`resources/acf/MetaQuest.acf` of the same repository).
FREQUENCY_HZ = (55.0, 200.0)


def write_haptic(path, texture, **about):
    """Writes a lossy preview: amplitude and frequency every 20 ms, for controllers that play one sine at a time.

    Amplitude is that of a sine of the texture's power, 1 = the largest (`newtons_per_full_scale`); frequency is the
    mean of the power spectrum, 0 = 55 Hz and 1 = 200 Hz as on Meta Quest controllers, cut beyond. Spectrum and waveform
    are lost. `metadata.description` says so; what belongs to the texture is in `metadata.tactile_diffusers`.

    Args:
        path (`str` or `Path`): the file; its folder must exist. An existing file is replaced as a whole.
        texture (`np.ndarray`): (samples,), N.
        **about: `sampling_rate`, `friction_coefficient`, `reference_speed`, `ratings`, `seed` and `checkpoint`, as for
            `write_npz`.

    Raises:
        ValueError: on a bad argument, before anything is written.
    """
    times, amplitude, frequency, stored = preview(texture, **about)
    envelopes = {
        "amplitude": _points("amplitude", times, amplitude),
        "frequency": _points("frequency", times, to_unit(frequency, FREQUENCY_HZ)),
    }
    contents = {
        "version": {"major": 1, "minor": 0, "patch": 0},
        "metadata": {"editor": f"tactile_diffusers {__version__}", "description": LOSSY, METADATA_KEY: stored},
        "signals": {"continuous": {"envelopes": envelopes}},
    }
    write_text(path, json.dumps(contents, indent=1, allow_nan=False) + "\n")


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
    return read_preview(path, "a .haptic file", _parse)


def _points(name, times, values):
    rounded = zip(np.round(times, DECIMALS).tolist(), np.round(values, DECIMALS).tolist(), strict=True)
    return [{"time": time, name: value} for time, value in rounded]


def _parse(contents):
    points = contents["signals"]["continuous"]["envelopes"]
    times, amplitude = (np.array([point[name] for point in points["amplitude"]]) for name in ("time", "amplitude"))
    frequency = from_unit(np.array([point["frequency"] for point in points["frequency"]]), FREQUENCY_HZ)
    return contents["metadata"][METADATA_KEY], times, amplitude, frequency

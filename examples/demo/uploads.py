"""What visitors upload: bytes of a CSV or WAV file become a texture. Nothing is written, no name is looked at."""

import io

import numpy as np

from tactile_diffusers.data.wav_header import check_wav
from tactile_diffusers.signal import BAND_HZ, band_pass

#: Seconds of a recording that are used, and that it must have at least (four periods of the lowest frequency).
LONGEST_SECONDS, SHORTEST_SECONDS = 10.0, 4 / BAND_HZ[0]
#: Sampling rates in Hz that are read: above twice the band, and no more than recorders have.
RATES = (2 * BAND_HZ[1] + 1, 200_000)
#: Channels of a WAV file: memory is taken for all of them.
MOST_CHANNELS = 8
#: Largest relative departure of a time step from the median: clocks are rounded in text files.
JITTER = 0.1


def read_upload(content, csv_rate, newtons_per_unit=1.0):
    """A recording as a texture: the first seconds of it, through the band-pass.

    Args:
        content (`bytes`): a WAV file (of several channels the first), or a table in text: lateral force in one column,
            or time in s and lateral force in the first two; comma, semicolon or tab between columns, a header or none.
        csv_rate (`float`): Hz, for a table of one column.
        newtons_per_unit (`float`): what the numbers in the file are multiplied by.

    Returns:
        `tuple[np.ndarray, int]`: (samples,) float64 in N, zero mean, and the sampling rate in Hz.

    Raises:
        ValueError: for what is neither kind of file, a rate or length out of bounds, gaps, or numbers that are not
            finite.
    """
    if not content:
        raise ValueError("The file is empty: choose a CSV or WAV file.")
    if not (np.isfinite(newtons_per_unit) and newtons_per_unit > 0):
        raise ValueError(f"Newtons per unit must be above 0, got {newtons_per_unit}.")
    force, rate = _read_wav(content) if content[:4] == b"RIFF" else _read_table(content, csv_rate)
    _check_rate(rate)
    rate = round(rate)
    if len(force) < SHORTEST_SECONDS * rate:
        raise ValueError(f"The recording must last {SHORTEST_SECONDS:g} s at least, got {len(force) / rate:.3f} s.")
    force = force[: int(LONGEST_SECONDS * rate)] * newtons_per_unit
    if not np.isfinite(force).all():
        raise ValueError("The recording has samples that are no finite numbers: repair or cut it first.")
    if not force.any() or np.ptp(force) == 0:
        raise ValueError("The recording is constant: there is no texture in it.")
    return band_pass(force, rate), rate


def _check_rate(rate):
    if not RATES[0] <= rate <= RATES[1]:
        raise ValueError(f"The sampling rate must be between {RATES[0]:g} and {RATES[1]:g} Hz, got {rate:g}.")


def _read_wav(content):
    import soundfile

    try:
        check_wav(io.BytesIO(content))
        with soundfile.SoundFile(io.BytesIO(content)) as file:
            rate = file.samplerate
            _check_rate(rate)
            if file.channels > MOST_CHANNELS:
                raise ValueError(f"{file.channels} channels; {MOST_CHANNELS} at most")
            samples = file.read(int(LONGEST_SECONDS * rate), dtype="float64", always_2d=True)
    except (soundfile.SoundFileError, ValueError, MemoryError) as error:
        raise ValueError(f"The file begins like WAV but cannot be read ({error}).") from error
    return samples[:, 0], rate


def _read_table(content, csv_rate):
    import pandas

    refusal = "The file is neither WAV nor a table of numbers in text (CSV)."
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(refusal) from error
    lines = text[:10_000].splitlines()
    delimiter = max("\t;,", key=lines[len(lines) // 2].count) if lines else ","
    rows = int(LONGEST_SECONDS * RATES[1])
    try:
        table = pandas.read_csv(
            io.StringIO(text),
            sep=delimiter,
            header=None,
            comment="#",
            nrows=rows,
            usecols=range(_columns(lines, delimiter)),
            dtype=str,
        )
    except (pandas.errors.ParserError, pandas.errors.EmptyDataError, ValueError) as error:
        raise ValueError(refusal) from error
    numbers = table.apply(pandas.to_numeric, errors="coerce").to_numpy(np.float64)
    begin = 0 if np.isfinite(numbers[0]).all() else 1  # names of the columns
    numbers = numbers[begin:]
    bad = np.flatnonzero(~np.isfinite(numbers).all(axis=1))
    if len(bad) or not len(numbers):
        where = f" Row {bad[0] + begin + 1} holds no number." if len(bad) else ""
        raise ValueError(refusal + where)
    if numbers.shape[1] == 1:
        return numbers[:, 0], csv_rate
    return numbers[:, 1], _rate_of(numbers[:, 0])


def _columns(lines, delimiter):
    """1 or 2: what is read of a table."""
    return 2 if lines and delimiter in lines[len(lines) // 2] else 1


def _rate_of(times):
    steps = np.diff(times)
    if not len(steps) or not (steps > 0).all():
        raise ValueError("The first of several columns must be time in s, ascending; give force alone otherwise.")
    step = np.median(steps)
    if np.abs(steps / step - 1).max() > JITTER:
        raise ValueError("Time must advance in equal steps: the recording has gaps, or its clock is too coarse.")
    return 1 / np.mean(steps)

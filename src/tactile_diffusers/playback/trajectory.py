"""A whole trajectory of a finger at once: the force that it would meet on a texture."""

from dataclasses import dataclass

import numpy as np

from ..io.reading import read_table, reading
from ..signal import DEVICE_RATE, REFERENCE_FORCE
from ..signal.checks import check_number
from .finger import LIFTED_SECONDS
from .stream import TextureStream

#: What a display that follows the finger reads at once, s.
_BLOCK_SECONDS = 0.002
#: Longest trajectory, s.
LONGEST_SECONDS = 3600.0


@dataclass(frozen=True)
class PlayedTrajectory:
    """What a finger meets along its way.

    Args:
        force (`np.ndarray`): (samples,), or (samples, 2) on a plane, float32, N, on the finger, against its motion,
            mean friction included.
        friction (`np.ndarray`): (samples,) float32, N, about its mean; positive = more friction.
        speed (`np.ndarray`): (samples,) float32, mm/s, of the finger as the stream follows it.
        time (`np.ndarray`): (samples,) float64, s, on the clock of the reports.
        position (`np.ndarray`): (samples,) or (samples, 2) float64, mm, as reported, linear between reports.
        sampling_rate (`float`): Hz.
        latency (`float`): s by which changes of speed are felt later than they are made; see [`TextureStream`].
    """

    force: np.ndarray
    friction: np.ndarray
    speed: np.ndarray
    time: np.ndarray
    position: np.ndarray
    sampling_rate: float
    latency: float


def read_trajectory(path):
    """Times (n,), s, and positions (n,) or (n, 2), mm, of a CSV file with a header: `time,position` or `time,x,y`.

    Raises:
        FileNotFoundError: if there is no file.
        ValueError: naming the file and what is wrong with it.
    """
    with reading(path, "a trajectory", "Write it as CSV with the header time,position or time,x,y, in s and mm."):
        header, table = read_table(path, ("time", "position"), ("time", "x", "y"))
    return table[:, 0], table[:, 1] if len(header) == 2 else table[:, 1:]


def play_trajectory(
    profile, friction_coefficient, time, position, sampling_rate=DEVICE_RATE, normal_force=REFERENCE_FORCE, **options
):
    """Moves a finger over a texture as a stream would have followed it: it starts, turns and stops as there.

    Only dropped reports do no harm: the finger goes straight on between two that are up to 0.1 s apart.

    Args:
        profile (`TextureProfile`): what is under the finger.
        friction_coefficient (`float`): of the mean friction.
        time (`np.ndarray`): (n,), s, ascending; the first one is the beginning.
        position (`np.ndarray`): (n,) or (n, 2), mm. Between two reports more than 0.1 s apart the finger is lifted.
        sampling_rate (`int`, *optional*, defaults to 10000): of the result, Hz.
        normal_force (`float`, *optional*, defaults to 0.5): N.
        options: of [`TextureStream`]: `cutoff`, `force_exponent`, `speed_exponent`.

    Returns:
        [`PlayedTrajectory`]: from the first report to `latency` after the last one.

    Raises:
        ValueError: for less than two reports, times that do not ascend or are longer than an hour, positions of another
            shape or not finite, reports slower than 17 Hz, or what [`TextureStream`] refuses.
    """
    time, position = np.asarray(time, dtype=np.float64), np.asarray(position, dtype=np.float64)
    if time.ndim != 1 or len(time) < 2 or position.shape not in ((len(time),), (len(time), 2)):
        raise ValueError(
            "`time` and `position` must be (n,) and (n,) or (n, 2) of at least two reports, got "
            f"{time.shape} and {position.shape}."
        )
    if not (np.isfinite(time).all() and np.isfinite(position).all() and (np.diff(time) > 0).all()):
        raise ValueError("`time` and `position` must be finite and `time` ascend. Leave out reports without a finger.")
    check_number("time[-1] - time[0]", time[-1] - time[0], "s", at_most=LONGEST_SECONDS)
    normal_force = check_number("normal_force", normal_force, "N", at_least=0)
    begun, time = time[0], time - time[0]
    sensor_rate = 1 / float(np.median(np.diff(time)))
    stream = TextureStream(
        profile, friction_coefficient, sensor_rate, sampling_rate, dimensions=position.ndim, **options
    )
    count = round((time[-1] + stream.latency) * sampling_rate)
    block, parts, reported = max(1, round(_BLOCK_SECONDS * sampling_rate)), [], 0
    for begin in range(0, count, block):
        samples = min(block, count - begin)
        # ahead of its time, so that the line between two reports is known
        due = int(np.searchsorted(time, begin / sampling_rate + LIFTED_SECONDS, side="right"))
        if due > reported:
            stream.report(time[reported:due], position[reported:due])
            reported = due
        parts.append(stream.read_all(samples, normal_force))
    force, friction, speed = map(np.concatenate, zip(*parts, strict=True))
    at = np.arange(count) / sampling_rate
    place = np.stack([np.interp(at, time, axis) for axis in position.reshape(len(time), -1).T], axis=-1)
    place = place.reshape(count, *position.shape[1:])
    return PlayedTrajectory(force, friction, speed, begun + at, place, sampling_rate, stream.latency)

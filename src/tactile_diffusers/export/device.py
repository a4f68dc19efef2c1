"""What a device can play, and what of a texture is lost on it, band by band, before anyone plugs in."""

import math
from dataclasses import dataclass

import numpy as np

from ..io.reading import read_json, reading
from ..signal import BAND_HZ, band_edges, band_levels_db, resample
from ..signal.checks import check_number, check_whole_number
from ..signal.resampling import low_pass_for
from .metadata import check_texture

#: Level change, dB, and ratio of a band to the error in it, dB, from which a band counts as held.
HELD_DB, HELD_SNR_DB = 1.0, 10.0
#: A band that has lost so much, dB, is not there any more.
SILENT_DB = 120.0


@dataclass(frozen=True)
class DeviceProfile:
    """What a device plays. `load` reads one from a JSON object of these names.

    Args:
        rate (`float`): of its samples, Hz.
        band (`tuple[float, float]`): lowest and highest frequency that it moves at, Hz.
        one_signed (`bool`): whether it only adds friction, or only takes it away: it then plays a texture about the
            middle of what it can do, so that half of `amplitude` is left to either side.
        bits (`int`): of a sample.
        amplitude (`float`): largest change of force, N.

    Raises:
        ValueError: naming the entry that no device has.
    """

    rate: float
    band: tuple[float, float] = BAND_HZ
    one_signed: bool = False
    bits: int = 16
    amplitude: float = 1.0

    def __post_init__(self):
        try:
            low, high = self.band
        except (TypeError, ValueError) as error:
            raise ValueError(
                f"`band` must be two frequencies, lowest and highest, in Hz, got {self.band!r}."
            ) from error
        low = check_number("band[0]", low, "Hz", at_least=0)
        high = check_number("band[1]", high, "Hz", above=low)
        if not isinstance(self.one_signed, bool):
            raise ValueError(f"`one_signed` must be True or False, got {self.one_signed!r}.")
        checked = {
            "rate": check_number("rate", self.rate, "Hz", above=2 * BAND_HZ[0]),
            "band": (low, high),
            "bits": check_whole_number("bits", self.bits, at_least=2, at_most=32),
            "amplitude": check_number("amplitude", self.amplitude, "N", above=0),
        }
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    @classmethod
    def load(cls, path):
        """A profile from a JSON file; a ValueError names the file and the entry."""
        with reading(path, "a device profile", "Correct it."):
            content = read_json(path, "JSON")
            if unknown := sorted(set(content) - set(cls.__annotations__)):
                raise ValueError(f"it has unknown entries {unknown}; it may hold {list(cls.__annotations__)}")
            return cls(**content)

    @property
    def swing(self):
        """Largest force about the middle, N."""
        return self.amplitude / 2 if self.one_signed else self.amplitude


@dataclass(frozen=True)
class BandLoss:
    """What a device leaves of one band.

    Args:
        band (`tuple[float, float]`): Hz.
        change_db (`float`): of its level; -inf = nothing is left.
        snr_db (`float`): of what should be there to the error; infinite = no error.
        cause (`str`): what is to blame most: `"rate"`, `"band"`, `"amplitude"`, `"bits"`; `""` where the band is held.
    """

    band: tuple[float, float]
    change_db: float
    snr_db: float
    cause: str


@dataclass(frozen=True)
class DeviceLoss:
    """What a device leaves of a texture.

    Args:
        bands (`tuple[BandLoss, ...]`): the nine bands.
        clipped (`float`): share of the samples beyond the device's amplitude.
        fitting_scale (`float`): factor on the texture at which nothing would be clipped; above 1 = room is left.
    """

    bands: tuple[BandLoss, ...]
    clipped: float
    fitting_scale: float

    def __str__(self):
        lines = ["| band, Hz | level, dB | SNR, dB | lost by |", "|---|---:|---:|---|"]
        for one in self.bands:
            low, high = one.band
            lines.append(f"| {low:.0f}-{high:.0f} | {one.change_db:+.1f} | {one.snr_db:.1f} | {one.cause or '-'} |")
        return "\n".join([*lines, "", f"{100 * self.clipped:.3g} % clipped; factor that fits {self.fitting_scale:.3g}"])


def what_is_lost(texture, sampling_rate, device):
    """Plays a texture on a device that is nothing but its profile, and compares band by band.

    The device takes samples at its rate, holds frequencies within its band, clips at its amplitude and rounds to its
    bits. What its own dynamics do is a matter of calibration (`tactile_diffusers.display`).

    Args:
        texture (`np.ndarray`): (samples,), N, at least 0.1 s of it.
        sampling_rate (`int`): Hz, at least 2 kHz.
        device ([`DeviceProfile`]): it.

    Returns:
        [`DeviceLoss`]: print it for a table.

    Raises:
        ValueError: on a bad argument.
    """
    texture = check_texture(texture, sampling_rate)
    if not isinstance(device, DeviceProfile):
        raise ValueError(f"`device` must be a DeviceProfile, got {type(device).__name__}.")
    before = band_levels_db(texture, sampling_rate)  # refuses what is too short
    stages = {"rate": texture}
    if device.rate < sampling_rate:
        coarse = low_pass_for(texture, sampling_rate, device.rate)
        coarse = resample(coarse, sampling_rate, device.rate, method="fourier")
        stages["rate"] = resample(coarse, device.rate, sampling_rate, len(texture), method="fourier")
    spectrum, frequencies = np.fft.rfft(stages["rate"]), np.fft.rfftfreq(len(texture), 1 / sampling_rate)
    inside = (frequencies >= device.band[0]) & (frequencies <= device.band[1])
    stages["band"] = np.fft.irfft(spectrum * inside, len(texture))
    stages["amplitude"] = np.clip(stages["band"], -device.swing, device.swing)
    step = 2 * device.swing / 2**device.bits
    stages["bits"] = np.clip(np.round(stages["amplitude"] / step) * step, -device.swing, device.swing)
    played = stages["bits"]
    after, error = (band_levels_db(signal, sampling_rate) for signal in (played, played - texture))
    change, snr = np.where(after - before < -SILENT_DB, -np.inf, after - before), before - error
    steps = np.diff([texture, *stages.values()], axis=0)
    blame = band_levels_db(steps, sampling_rate).argmax(0)
    held = (np.abs(change) <= HELD_DB) & (snr >= HELD_SNR_DB)
    causes = [*stages, ""]
    edges = band_edges().tolist()
    rows = zip(zip(edges[:-1], edges[1:], strict=True), change, snr, np.where(held, -1, blame), strict=True)
    bands = tuple(BandLoss(band, float(level), float(ratio), causes[cause]) for band, level, ratio, cause in rows)
    peak = float(np.abs(stages["band"]).max())
    clipped = float((np.abs(stages["band"]) > device.swing).mean())
    return DeviceLoss(bands, clipped, device.swing / peak if peak else math.inf)

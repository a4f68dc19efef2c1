"""A texture over position, at several resolutions: what a finger reads at whatever speed it moves.

A texture made at one speed is a profile over position: what repeats every wavelength w over space is felt at the
frequency v / w by a finger of speed v. That is exact for what is fixed in space, and wrong for what is not (stick-slip,
the finger's own resonances).
"""

import numpy as np

from ..signal import BAND_HZ

#: Resolutions of the profile per octave of spatial frequency; between two of them is interpolated.
PER_OCTAVE = 4
#: Octaves on either side of what the texture holds that are filled: speeds from a quarter to four times its own.
FILLED_OCTAVES = 2
#: Octaves at either end of the texture's spectrum from whose slope the filling is continued.
SLOPE_OCTAVES = 1.5
#: Width of the edges of a resolution.
EDGE_OCTAVES = 0.25
#: Samples per shortest period that a resolution keeps at least: a cubic through four of them is then 55 dB exact.
LEAST_SAMPLES_PER_PERIOD = 8
#: Share of a profile, at its end, that fades into its beginning so that it can be repeated.
LOOP_SHARE = 0.1


class TextureProfile:
    """A periodic profile over position, low-passed at a ladder of spatial frequencies.

    Reading it at a speed limits what is felt to the band of textures, 20-1000 Hz: fast fingers read coarser
    resolutions (no aliasing), and what a slow or a fast finger would feel below the band is left out.

    A texture of 20-1000 Hz at 80 mm/s holds 0.25 to 12.5 cycles/mm: at 40 mm/s none above 500 Hz, at 160 mm/s none
    below 40 Hz (`coverage`). What is missing is filled with noise, fixed in space like the rest, that continues the
    slope of the texture's spectrum for two octaves on either side, or left out.

    Args:
        texture (`np.ndarray`): (samples,), N, zero mean, as recorded at `reference_speed`.
        sampling_rate (`float`): Hz.
        reference_speed (`float`): mm/s.
        band (`tuple[float, float]`, *optional*): Hz, what the texture holds and what may be felt.
        fill (`bool`, *optional*, defaults to `True`): whether what the texture does not hold is filled.
        seed (`int`, *optional*, defaults to 0): of the filling.

    Attributes:
        length (`float`): mm after which the profile repeats.
        pitch (`float`): mm between samples of the finest resolution.
        cutoffs (`np.ndarray`): (levels,) cycles/mm, falling: the largest spatial frequency of each resolution.

    Raises:
        ValueError: if `texture` is not finite and one-dimensional or is too short for the lowest frequency of the
            band, or a rate or speed is not positive.
    """

    def __init__(self, texture, sampling_rate, reference_speed, band=BAND_HZ, fill=True, seed=0):
        texture = np.asarray(texture, dtype=np.float64)
        for name, value in (("sampling_rate", sampling_rate), ("reference_speed", reference_speed)):
            if not (np.isfinite(value) and value > 0):
                raise ValueError(f"`{name}` must be a positive number, got {value}.")
        least = int(np.ceil(4 * sampling_rate / band[0]))
        if texture.ndim != 1 or len(texture) < least or not np.isfinite(texture).all():
            raise ValueError(
                f"`texture` must be (samples,), finite, and of at least {least} samples (four periods of {band[0]:g} "
                f"Hz), got {texture.shape}."
            )
        self.band = tuple(band)
        self.reference_speed = float(reference_speed)
        self.pitch = reference_speed / sampling_rate
        overlap = round(LOOP_SHARE * len(texture))
        looped = loop(texture, overlap + (len(texture) - overlap) % 2)  # an even number of samples
        self.length = len(looped) * self.pitch
        spectrum, frequencies = np.fft.rfft(looped), np.fft.rfftfreq(len(looped), self.pitch)
        spectrum[0] = 0
        lowest, highest = (edge / reference_speed for edge in band)
        if fill:
            spectrum = _filled(spectrum, frequencies, (lowest, highest), seed)
            lowest, highest = lowest / 2**FILLED_OCTAVES, min(highest * 2**FILLED_OCTAVES, frequencies[-1])
        # the finest resolution lies one above, so that what the texture holds up to its end stays as it is
        count = int(np.ceil(PER_OCTAVE * np.log2(highest / lowest))) + 3
        self.cutoffs = highest * 2.0 ** ((1 - np.arange(count)) / PER_OCTAVE)
        self._levels = self._ladder(spectrum, frequencies)

    def _ladder(self, spectrum, frequencies):
        """Resolutions, finest first, each with a sample of its end before it and two of its beginning after it."""
        samples, levels = 2 * (len(frequencies) - 1), []
        for cutoff in self.cutoffs:
            kept = spectrum * _soft_edge(frequencies, cutoff)
            length = max(16, int(np.ceil(LEAST_SAMPLES_PER_PERIOD * cutoff * self.length)))
            level = np.fft.irfft(kept[: length // 2 + 1], n=length) * (length / samples)
            levels.append(np.concatenate([level[-1:], level, level[:2]]).astype(np.float32))
        return levels

    def coverage(self, speed):
        """What part of the band the profile holds at a speed: its lowest and highest frequency, Hz.

        Args:
            speed (`float`): mm/s.
        """
        low, high = (frequency * speed / self.reference_speed for frequency in self.band)
        return max(low, self.band[0]), min(high, self.band[1])

    def read(self, position, speed):
        """Texture force at positions, before the direction of motion gives it a sign.

        Args:
            position (`np.ndarray`): (n,), mm, anywhere: the profile repeats.
            speed (`np.ndarray`): (n,), mm/s, at each position; only its magnitude counts.

        Returns:
            `np.ndarray`: (n,) float64, N.
        """
        speed = np.maximum(np.abs(speed), 1e-3)
        place = np.asarray(position, dtype=np.float64) / self.length
        place = place - np.floor(place)
        beyond = 2 ** (EDGE_OCTAVES / 2)  # edges lie outside the band: what is inside stays as it is
        highest, lowest = beyond * self.band[1] / speed, self.band[0] / beyond / speed
        return self._low_passed(place, highest) - self._low_passed(place, lowest)

    def _low_passed(self, place, cutoff):
        """The profile below a spatial frequency that differs from sample to sample; `place` in [0, 1)."""
        rung = np.clip(PER_OCTAVE * np.log2(self.cutoffs[0] / cutoff), 0, None)
        lower = np.minimum(rung.astype(int), len(self._levels))
        share = rung - lower
        made = np.zeros(len(place))
        for level in range(lower.min(), min(lower.max() + 1, len(self._levels) - 1) + 1):
            weight = np.where(lower == level, 1 - share, np.where(lower == level - 1, share, 0.0))
            chosen = np.flatnonzero(weight)
            made[chosen] += weight[chosen] * _cubic(self._levels[level], place[chosen])
        return made


def loop(texture, overlap):
    """A texture that can be repeated: its end fades into its beginning at equal power.

    Args:
        texture (`np.ndarray`): (samples,).
        overlap (`int`): samples that fade, fewer than half.

    Returns:
        `np.ndarray`: (samples - overlap,).
    """
    angle = np.linspace(0, np.pi / 2, overlap + 2)[1:-1]
    joined = texture[: len(texture) - overlap].copy()
    joined[:overlap] = np.sin(angle) * texture[:overlap] + np.cos(angle) * texture[len(texture) - overlap :]
    return joined


def _soft_edge(frequencies, cutoff):
    """1 below the cutoff, 0 above, half a cosine over `EDGE_OCTAVES` around it: short ringing over position."""
    octaves = np.log2(np.maximum(frequencies, 1e-9) / cutoff)
    return 0.5 - 0.5 * np.sin(np.pi * np.clip(octaves / EDGE_OCTAVES, -0.5, 0.5))


def _filled(spectrum, frequencies, held, seed):
    """A spectrum whose power beyond what is `held` (cycles/mm) continues the slope at either end, at random phases."""
    low, high = held
    power, octave = np.abs(spectrum) ** 2, np.log2(np.maximum(frequencies, frequencies[1]))
    draw = np.random.default_rng(seed).standard_normal((len(spectrum), 2)) @ np.array([1, 1j]) / np.sqrt(2)
    within = (frequencies >= low) & (frequencies <= high)
    if not power[within].any():
        return spectrum
    made = spectrum * within
    for edge, inner, beyond in (
        (low, low * 2**SLOPE_OCTAVES, (frequencies < low) & (frequencies > low / 2 ** (FILLED_OCTAVES + 1))),
        (high, high / 2**SLOPE_OCTAVES, frequencies > high),
    ):
        # a quarter of an octave at the very edge is where the recording's own filter fades
        near = sorted((edge * (inner / edge) ** (0.25 / SLOPE_OCTAVES), inner))
        chosen = (frequencies >= near[0]) & (frequencies <= near[1]) & (power > 0)
        slope, offset = np.polyfit(octave[chosen], np.log(power[chosen]) + np.euler_gamma, 1)
        made += beyond * draw * np.exp(0.5 * (slope * octave + offset))
    return made


def _cubic(level, place):
    """Cubic (four-point Lagrange) interpolation in a level that has one sample before its beginning and two after."""
    x = place * (len(level) - 3)
    index = x.astype(int)
    t = x - index
    before, here, after, beyond = (level[index + offset] for offset in range(4))
    return (
        -t * (t - 1) * (t - 2) / 6 * before
        + (t + 1) * (t - 1) * (t - 2) / 2 * here
        - (t + 1) * t * (t - 2) / 2 * after
        + (t + 1) * t * (t - 1) / 6 * beyond
    )

"""A texture over position, at several resolutions: what a finger reads at whatever speed it moves.

What repeats every w mm is felt at the frequency v / w by a finger of speed v. That is exact for what is fixed in space,
and wrong for what is not: the events of stick-slip are therefore taken apart (`events`), the finger's own resonances
are not.
"""

from functools import cached_property

import numpy as np
from scipy.fft import irfft, next_fast_len

from ..signal import BAND_HZ
from ..signal.checks import check_number
from .events import separate_events

#: Shortest texture of a profile, s: four periods of the lowest frequency of the band.
LEAST_SECONDS = 4 / BAND_HZ[0]
#: Resolutions of the profile per octave of spatial frequency; reading interpolates between two of them.
PER_OCTAVE = 4
#: Octaves on either side of what the texture holds that are filled: speeds from a quarter to four times its own.
FILLED_OCTAVES = 2
#: Octaves at the lower and the upper end of the texture's spectrum whose slope the filling continues: many at the lower
#: one, where there are few lines to estimate it from, few at the upper one, where the spectrum bends.
SLOPE_OCTAVES = (2.5, 1.0)
#: Deviation of the smoothing of the texture's envelope, which the filling follows, s at the reference speed: envelopes
#: of a texture's bands move together (McDermott & Simoncelli 2011).
ENVELOPE_SECONDS = 0.005
#: Steepness of the edges of a resolution: those of a recording's band-pass (`signal.band_pass`, order 4, both ways).
EDGE_POWER = 8
#: Largest factor by which a recording's fading edges are raised: at the very edge of its band.
_LARGEST_RAISE = 2.0
#: Up to this multiple of its cutoff a resolution is kept; beyond it has faded by 48 dB.
_TAIL = 2.0
#: Samples of a resolution that are there twice, for the interpolation: one before its beginning, two after its end.
_MARGIN = 3
#: Samples per shortest period that a resolution keeps at least: a cubic through four of them is then 55 dB exact.
LEAST_SAMPLES_PER_PERIOD = 8
#: Share of a profile, at its end, that fades into its beginning so that it can be repeated.
LOOP_SHARE = 0.1
#: Share of a profile that is one of many, at each end, that fades out; its neighbours take over before.
TAPER_SHARE = 0.05


class TextureProfile:
    """A periodic profile over position, low-passed at a ladder of spatial frequencies.

    Reading it at a speed limits what is felt to the band of textures, 20-1000 Hz, by the filter of recordings
    (`signal.band_pass`): fast fingers read coarser resolutions (no aliasing), and what a slow or a fast finger would
    feel below the band is left out. The texture's own edges, which this filter has faded, are raised before: they lie
    at other frequencies when the finger moves at another speed.

    A texture of 20-1000 Hz at 80 mm/s holds 0.25 to 12.5 cycles/mm: at 40 mm/s nothing above 500 Hz, at 160 mm/s
    nothing below 40 Hz. What is missing is filled with noise, fixed in space like the rest, that continues
    the slope of the texture's spectrum for two octaves on either side and follows its envelope; `fill=False` leaves it
    out.

    Args:
        texture (`np.ndarray`): (samples,), N, zero mean, as recorded at `reference_speed`.
        sampling_rate (`float`): Hz.
        reference_speed (`float`): mm/s.
        fill (`bool`, *optional*, defaults to `True`): whether to fill what the texture does not hold.
        seed (`int`, *optional*, defaults to 0): of the filling.
        repeats (`bool`, *optional*, defaults to `True`): whether its end fades into its beginning; `False` = its ends
            fade out, and it is read in between alone (`EndlessProfile`).
        noise (`np.ndarray`, *optional*): (samples,), white noise for the filling, in place of `seed`; without `repeats`
            only.
        separate (`bool`, *optional*, defaults to `True`): whether events are taken apart, from a texture that repeats.

    Attributes:
        length (`float`): mm after which the profile repeats: the texture's own, less a tenth in which its end fades
            into its beginning. 120 of 133 mm (16384 samples at 81.3 mm/s) with the bundled checkpoint.
        pitch (`float`): mm between samples of the finest resolution.
        cutoffs (`np.ndarray`): (levels,) cycles/mm, falling: the largest spatial frequency of each resolution.
        events (`TextureProfile`): events of stick-slip over mm of travel (`separate_events`), which a stream adds to
            what is read here; `None` if the texture has none.

    Raises:
        ValueError: if `texture` is not finite and one-dimensional or is too short for the lowest frequency of the
            band, or a rate or speed is not positive.
    """

    def __init__(
        self, texture, sampling_rate, reference_speed, fill=True, seed=0, repeats=True, noise=None, separate=True
    ):  # fmt: skip
        texture = np.asarray(texture, dtype=np.float64)
        sampling_rate = check_number("sampling_rate", sampling_rate, "Hz", above=0)
        reference_speed = check_number("reference_speed", reference_speed, "mm/s", above=0)
        least = int(np.ceil(LEAST_SECONDS * sampling_rate))
        if texture.ndim != 1 or len(texture) < least or not np.isfinite(texture).all():
            raise ValueError(
                f"`texture` must be (samples,), finite, and of at least {least} samples (four periods of "
                f"{BAND_HZ[0]:g} Hz), got {texture.shape}."
            )
        self.reference_speed, self.pitch = reference_speed, reference_speed / sampling_rate
        parts, self.events = separate_events(texture, sampling_rate) if repeats and separate else None, None
        if parts is not None:
            self.events = TextureProfile(parts[0], sampling_rate, reference_speed, fill, seed, separate=False)
            texture = parts[1]
        if repeats:
            overlap = round(LOOP_SHARE * len(texture))
            texture = loop(texture, overlap + (len(texture) - overlap) % 2)  # an even number of samples
        else:
            texture = _tapered(texture[: len(texture) // 2 * 2])
        if noise is None:
            noise = np.random.default_rng(seed).standard_normal(len(texture))
        self.length = len(texture) * self.pitch
        self._spectrum, self._frequencies = np.fft.rfft(texture), np.fft.rfftfreq(len(texture), self.pitch)
        self._spectrum[0] = 0
        lowest, highest = (edge / reference_speed for edge in BAND_HZ)
        self._spectrum *= _raise(self._frequencies, lowest, highest)
        if fill:
            noise = np.fft.rfft(noise[: len(texture)]) / np.sqrt(len(texture))
            self._spectrum = _filled(self._spectrum, self._frequencies, (lowest, highest), noise)
            lowest, highest = lowest / 2**FILLED_OCTAVES, min(highest * 2**FILLED_OCTAVES, self._frequencies[-1])
        # the finest resolution, one above, holds all
        count = int(np.ceil(PER_OCTAVE * np.log2(highest / lowest))) + 3
        self.cutoffs = highest * 2.0 ** ((1 - np.arange(count)) / PER_OCTAVE)
        # resolutions one after the other, finest first, the last one empty
        lengths = np.ceil(LEAST_SAMPLES_PER_PERIOD * self.cutoffs * self.length).astype(int)
        self._lengths = np.array([next_fast_len(max(16, int(length)), real=True) for length in lengths] + [16])
        self._begins = np.concatenate([[0], np.cumsum(self._lengths + _MARGIN)])

    @cached_property
    def _samples(self):
        """What lies below each cutoff, float32: each with one of its end before it and two of its beginning after it.

        In single precision, in which it is kept: a window of an endless texture waits for it.
        """
        samples = np.zeros(self._begins[-1], dtype=np.float32)
        spectrum = (self._spectrum / (2 * (len(self._frequencies) - 1))).astype(np.complex64)
        power = (self._frequencies / self.cutoffs[0]) ** EDGE_POWER
        for begin, length, cutoff in zip(self._begins, self._lengths, self.cutoffs, strict=False):
            kept = np.searchsorted(self._frequencies[: length // 2 + 1], cutoff * _TAIL)
            below = spectrum[:kept]
            if cutoff < self.cutoffs[0]:
                below = below / (1 + power[:kept] * (self.cutoffs[0] / cutoff) ** EDGE_POWER).astype(np.float32)
            own = samples[begin : begin + length + _MARGIN]
            own[1:-2] = irfft(below, n=length, norm="forward")
            own[0], own[-2:] = own[-3], own[1:3]
        return samples

    def prepare(self):
        """Makes what `read` reads, 5 to 15 ms, which else the first `read` does."""
        _ = self._samples

    def period(self):
        """One period of the profile, filled, with all its spatial frequencies: (n,) float64, N, `pitch` mm apart."""
        return np.fft.irfft(self._spectrum)

    def read(self, position, speed):
        """Texture force at positions, without the sign of the direction of motion.

        Args:
            position (`np.ndarray`): (n,), mm, anywhere: the profile repeats.
            speed (`np.ndarray`): (n,), mm/s, at each position; only its magnitude counts.

        Returns:
            `np.ndarray`: (n,) float64, N.
        """
        speed = np.maximum(np.abs(speed), 1e-3)
        place = np.asarray(position, dtype=np.float64) / self.length
        place = place - np.floor(place)
        place[place >= 1] = 0  # of -1e-17, rounding leaves 1
        # what lies below the highest frequency that is felt, less what lies below the lowest; each is read between two
        # resolutions. All four at once: a block is short, and calls cost more than arithmetic
        cutoff = np.stack([BAND_HZ[1] / speed, BAND_HZ[0] / speed])
        rung = np.clip(PER_OCTAVE * np.log2(self.cutoffs[0] / cutoff), 0, len(self.cutoffs))  # 0 = the finest
        lower = rung.astype(int)
        share = rung - lower
        levels = np.stack([lower, np.minimum(lower + 1, len(self.cutoffs))])
        weights = np.stack([1 - share, share])
        weights[:, 1] *= -1
        return (weights * self._cubic(levels, place)).sum(axis=(0, 1))

    def _cubic(self, levels, place):
        """Cubic (four-point Lagrange) interpolation in levels (..., n) at places (n,) in [0, 1)."""
        x = place * self._lengths[levels]
        index = x.astype(int)
        t = x - index
        index += self._begins[levels]
        before, here, after, beyond = (self._samples[index + offset] for offset in range(4))
        u, v, w = t + 1, t - 1, t - 2
        return t * v * (u * beyond - w * before) / 6 + u * w * (v * here - t * after) / 2


def loop(texture, overlap):
    """A texture that can be repeated, (samples - overlap,): its end fades into its beginning at equal power."""
    angle = np.linspace(0, np.pi / 2, overlap + 2)[1:-1]
    joined = texture[: len(texture) - overlap].copy()
    joined[:overlap] = np.sin(angle) * texture[:overlap] + np.cos(angle) * texture[len(texture) - overlap :]
    return joined


def _tapered(texture):
    """Both ends faded out, so that the last sample meets the first."""
    fade = np.linspace(0, np.pi / 2, round(TAPER_SHARE * len(texture)) + 2)[1:-1]
    texture = texture.copy()
    texture[: len(fade)] *= np.sin(fade)
    texture[len(texture) - len(fade) :] *= np.cos(fade)
    return texture


def _raise(frequencies, lowest, highest):
    """Factor that takes the fading edges of a recording's band-pass away: 1 within, 2 at its edges and beyond."""
    from_middle = (frequencies**2 - lowest * highest) / np.maximum(frequencies * (highest - lowest), 1e-12)
    return np.minimum(1 + from_middle**EDGE_POWER, _LARGEST_RAISE)


def _filled(spectrum, frequencies, held, noise):
    """A spectrum whose power beyond what is `held` (cycles/mm) continues the slope at either end.

    `noise`: of the same length, complex normal numbers of unit variance that give it its phases. It is modulated by the
    envelope of what is held.
    """
    low, high = held
    power, octave = np.abs(spectrum) ** 2, np.log2(np.maximum(frequencies, frequencies[1]))
    within = (frequencies >= low) & (frequencies <= high)
    if not power[within].any():
        return spectrum
    filled = spectrum * within
    noise = _modulated(noise, filled, ENVELOPE_SECONDS * BAND_HZ[0] / low * 2 * frequencies[-1])
    below = (frequencies < low) & (frequencies > low / 2 ** (FILLED_OCTAVES + 1))
    for octaves, beyond in zip(SLOPE_OCTAVES, (below, frequencies > high), strict=True):
        near = (low, low * 2**octaves) if beyond is below else (high / 2**octaves, high)
        chosen = (frequencies >= near[0]) & (frequencies <= near[1]) & (power > 0)
        if chosen.sum() < 2:  # a texture of a low rate ends before its band does
            continue
        slope, offset = np.polyfit(octave[chosen], np.log(power[chosen]) + np.euler_gamma, 1)
        filled += beyond * noise * np.exp(0.5 * (slope * octave + offset))
    return filled


def _modulated(noise, spectrum, smoothing):
    """Noise (its spectrum) that follows the envelope of a texture (spectrum), smoothed over so many samples."""
    samples = 2 * (len(spectrum) - 1)
    analytic = np.fft.ifft(np.concatenate([2 * spectrum[:-1], np.zeros(samples - len(spectrum) + 1)]))
    lines = np.arange(len(spectrum)) / samples  # cycles per sample
    envelope = np.fft.irfft(np.fft.rfft(np.abs(analytic)) * np.exp(-2 * (np.pi * smoothing * lines) ** 2))
    return np.fft.rfft(np.fft.irfft(noise) * envelope / np.sqrt(np.mean(envelope**2)))

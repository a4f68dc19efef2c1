"""From a texture in N to the encoder's features, and back from the decoder's waveform to N."""

from numbers import Real

import numpy as np
import torch
from transformers.feature_extraction_sequence_utils import SequenceFeatureExtractor
from transformers.feature_extraction_utils import BatchFeature, FeatureExtractionMixin  # noqa: F401 (diffusers' loader looks for the base class in this module)

from ..signal import BAND_HZ, DEVICE_RATE, WORKING_RATE, level, resample, rms
from ..signal.checks import check_number, check_whole_number, texture_rows
from .band_levels import band_sums, check_band_levels, impose_band_levels, measure_band_levels, measure_fast_modulation
from .fast_envelope import envelope_gain, gain_of_frames, measure_fast_envelope
from .filterbank import FILTER_SCALES, filterbank
from .low_band import sample_low_band

#: powers below this are silence to the logarithm (a whitened texture has a mean power of 1 in every band)
LOG_FLOOR = 1e-4
#: RMS below which a signal counts as silent, N
SILENCE = 1e-12
#: Largest rate, Hz: a damaged config may ask for any, and one without a common divisor with ours takes gigabytes.
MOST_RATE = 1_000_000
#: Larger samples have no place in the float32 of features and textures, and their squares none in float64.
LARGEST_SAMPLE = float(np.finfo(np.float32).max)


class TactileFeatureExtractor(SequenceFeatureExtractor):
    r"""
    Prepares textures for [`LCTGModel`] and turns what it decodes back into newtons.

    A texture is resampled to the working rate, freed from its mean, whitened by a fixed pre-emphasis and brought to
    unit RMS; its level is kept beside it. The features are, in this order: the levels of bands, the fast envelope,
    log-mel energies (paper section 2.2), and the low end of the waveform (detail). All but the energies have one frame
    per latent frame and are repeated `frame_multiple` times. Everything is computed row by row in float64 and returned
    as float32.

    Args:
        feature_size (`int`, *optional*): channels; `None` = `level_bands + 1` if there are any, plus
            `envelope_samples`, `num_filters` and `detail_samples`: 87 by default.
        sampling_rate (`int`, *optional*, defaults to 2500): the working rate, Hz.
        padding_value (`float`, *optional*, defaults to 0.0): unused; part of the transformers interface.
        delivery_rate (`int`, *optional*, defaults to 10000): rate of `denormalize`'s textures, Hz.
        band (`tuple[float, float]`, *optional*, defaults to `(20.0, 1000.0)`): Hz.
        num_filters (`int`, *optional*, defaults to 48): mel filters over `band`.
        filter_scale (`str`, *optional*, defaults to `"log"`): `"log"`, or `"slaney"` (mel, linear below 1 kHz).
        window_lengths (`tuple[int, ...]`, *optional*, defaults to `(128, 512)`): Hann windows in samples; each filter
            uses the shortest that resolves it (51 ms for the highs, 205 ms for the lows).
        hop_length (`int`, *optional*, defaults to 32): samples at the working rate per feature frame.
        frame_multiple (`int`, *optional*, defaults to 2): feature frames per latent frame.
        preemphasis_frequencies, preemphasis_db (`list[float]`, *optional*): the whitening gains, see
            `fit_preemphasis`; `None` = flat.
        level_bands (`int`, *optional*, defaults to 18): logarithmic bands whose levels over time `band_levels` measures
            and `denormalize` restores; 0 = none.
        envelope_samples (`int`, *optional*, defaults to 4): values of the fast envelope in each latent frame, whose
            samples they divide (`features/fast_envelope.py`); 0 = none.
        detail_samples (`int`, *optional*, defaults to 16): samples of the waveform's low end in each latent frame, half
            of whose samples they divide (`features/low_band.py`); 0 = none.
        fixed_scale (`float`, *optional*): N that are 1 for the decoder, the same for every texture: the waveform keeps
            its level, and nothing restores it (as in the paper). `None` = each texture's own RMS, kept beside.

    Raises:
        ValueError: if sizes, rates, windows or gains do not fit each other.
    """

    __module__ = "tactile_diffusers"  # as checkpoints name it
    model_input_names = ["input_features", "level"]

    def __init__(
        self,
        feature_size: int | None = None,
        sampling_rate: int = WORKING_RATE,
        padding_value: float = 0.0,
        delivery_rate: int = DEVICE_RATE,
        band: tuple[float, float] = BAND_HZ,
        num_filters: int = 48,
        filter_scale: str = "log",
        window_lengths: tuple[int, ...] = (128, 512),
        hop_length: int = 32,
        frame_multiple: int = 2,
        preemphasis_frequencies: list[float] | None = None,
        preemphasis_db: list[float] | None = None,
        level_bands: int = 18,
        envelope_samples: int = 4,
        detail_samples: int = 16,
        fixed_scale: float | None = None,
        **kwargs,
    ):
        size = (level_bands + 1 if level_bands else 0) + envelope_samples + num_filters + detail_samples
        if feature_size not in (None, size):
            raise ValueError(
                f"`feature_size` must be {size}, the sum of band levels, envelope, filters and detail "
                f"samples, got {feature_size}. Leave it out."
            )
        if filter_scale not in FILTER_SCALES:
            raise ValueError(f"`filter_scale` must be one of {FILTER_SCALES}, got {filter_scale!r}.")
        if not 0 < band[0] < band[1] < sampling_rate / 2:
            raise ValueError(f"`band` must satisfy 0 < low < high < {sampling_rate / 2} Hz, got {tuple(band)}.")
        for name, value in (("sampling_rate", sampling_rate), ("delivery_rate", delivery_rate)):
            check_number(name, value, "Hz", above=0, at_most=MOST_RATE)
        for name, value, least in (
            ("frame_multiple", frame_multiple, 1), ("hop_length", hop_length, 1), ("level_bands", level_bands, 0),
        ):  # fmt: skip
            check_whole_number(name, value, at_least=least)
        if max(window_lengths, default=0) > MOST_RATE:
            raise ValueError(f"`window_lengths` must be at most {MOST_RATE} samples, got {tuple(window_lengths)}.")
        if not window_lengths or min(window_lengths) < hop_length:
            raise ValueError(
                f"`window_lengths` must hold at least one window, none shorter than a hop ({hop_length} samples), got "
                f"{tuple(window_lengths)}."
            )
        hop = hop_length * frame_multiple
        if detail_samples < 0 or (detail_samples and hop % (2 * detail_samples)):
            raise ValueError(
                f"`detail_samples` must be 0 (none) or divide half of the {hop} samples of a latent frame, got "
                f"{detail_samples}."
            )
        if envelope_samples < 0 or (envelope_samples and hop % envelope_samples):
            raise ValueError(
                f"`envelope_samples` must be 0 (none) or divide the {hop} samples of a latent frame, got "
                f"{envelope_samples}."
            )
        if level_bands:
            check_band_levels(sampling_rate, tuple(band), level_bands, max(window_lengths), hop)
        frequencies, gains = preemphasis_frequencies, preemphasis_db
        if (frequencies is None) != (gains is None) or (
            frequencies is not None and (len(frequencies) != len(gains) or len(frequencies) == 0)
        ):
            raise ValueError("`preemphasis_frequencies` and `preemphasis_db` must be lists of the same length or None.")
        if frequencies is not None and not (np.diff(frequencies, prepend=0.0) > 0).all():
            raise ValueError(f"`preemphasis_frequencies` must be positive and ascend, got {list(frequencies)}.")
        self.fixed_scale = None if fixed_scale is None else check_number("fixed_scale", fixed_scale, "N", above=0)
        self.delivery_rate = delivery_rate
        self.band = tuple(band)
        self.num_filters = num_filters
        self.filter_scale = filter_scale
        self.window_lengths = tuple(window_lengths)
        self.hop_length = hop_length
        self.frame_multiple = frame_multiple
        self.preemphasis_frequencies = preemphasis_frequencies
        self.preemphasis_db = preemphasis_db
        self.level_bands = level_bands
        self.envelope_samples = envelope_samples
        self.detail_samples = detail_samples
        super().__init__(feature_size=size, sampling_rate=sampling_rate, padding_value=padding_value, **kwargs)

    def __call__(self, texture, sampling_rate=None, return_tensors=None):
        """Features of textures.

        Args:
            texture (`np.ndarray` or `torch.Tensor`): (samples,) or (batch, samples), N.
            sampling_rate (`int`): of `texture`, Hz; required, because a wrong guess would go unnoticed.
            return_tensors (`str`, *optional*): `"pt"` or `"np"` (default).

        Returns:
            `BatchFeature`: `input_features` (batch, feature_size, frames) float32 and `level` (batch,) float32.

        Raises:
            ValueError: for a missing or impossible sampling rate, an empty, non-finite or wrongly shaped texture.
        """
        waveform, levels = self.normalize(texture, sampling_rate)
        data = {"input_features": self.features(waveform), "level": levels}
        return BatchFeature(data, tensor_type=return_tensors)

    def normalize(self, texture, sampling_rate):
        """The decoder's view of a texture: at the working rate, whitened, unit RMS, zero-padded to whole latents.

        Returns:
            `tuple[np.ndarray, np.ndarray]`: waveform (batch, samples) float32, a multiple of
            `hop_length * frame_multiple` samples, and level (batch,) float32, natural log of the RMS in N of what the
            working rate holds, without the mean.
        """
        texture = self._check(texture, sampling_rate)
        # a mean is no vibration, and rounding leaves 1e-16 of it
        flat = np.ptp(texture, axis=-1) <= 1e-12 * np.abs(texture).max(-1)
        texture = np.where(flat[:, None], 0.0, texture - texture.mean(-1, keepdims=True))
        texture = resample(texture, sampling_rate, self.sampling_rate)
        levels = level(texture).astype(np.float32)
        waveform = self._emphasize(texture, +1)
        scale = rms(waveform)[:, None]
        waveform = waveform / (self.fixed_scale or np.where(scale > SILENCE, scale, np.inf))
        multiple = self.hop_length * self.frame_multiple
        missing = -waveform.shape[-1] % multiple
        return np.pad(waveform, ((0, 0), (0, missing))).astype(np.float32), levels

    def features(self, waveform):
        """(batch, samples) of `normalize`, whole latent frames -> (batch, feature_size, feature frames) float32."""
        waveform = np.asarray(waveform, dtype=np.float64)
        frames = waveform.shape[-1] // self.hop_length
        banks = filterbank(self.sampling_rate, self.band, self.num_filters, self.window_lengths, self.filter_scale)
        energies = 0.0
        for length, bank in zip(self.window_lengths, banks, strict=True):
            window = np.hanning(length + 1)[:-1]
            # centred on the middle of each hop, or half a sample later where the two differ by an odd number
            before = (length - self.hop_length) // 2
            padded = np.pad(waveform, ((0, 0), (before, length)), mode="reflect")
            pieces = np.lib.stride_tricks.sliding_window_view(padded, length, axis=-1)[:, :: self.hop_length][
                :, :frames
            ]
            power = np.abs(np.fft.rfft(pieces * window, axis=-1)) ** 2 / np.sum(window**2)
            energies = energies + power @ bank.T

        def repeated(values):
            per_latent_frame = values.reshape(len(waveform), frames // self.frame_multiple, -1)
            return np.repeat(per_latent_frame, self.frame_multiple, axis=1)

        parts, evened = [np.log10(energies + LOG_FLOOR)], waveform
        if self.envelope_samples:
            envelope = self._fast_envelope(waveform)
            evened = waveform / envelope_gain(envelope, self._envelope_step)
            parts.insert(0, repeated(envelope))
        if self.level_bands:
            parts.insert(0, repeated(self.band_levels(waveform).transpose(0, 2, 1)))
        if self.detail_samples:
            parts.append(repeated(sample_low_band(evened, self._latent_grid["hop"] // self.detail_samples)))
        return np.ascontiguousarray(np.concatenate(parts, axis=-1).transpose(0, 2, 1), dtype=np.float32)

    @property
    def _envelope_step(self):
        """Samples per value of the fast envelope."""
        return self._latent_grid["hop"] // self.envelope_samples

    def _fast_envelope(self, waveform):
        return measure_fast_envelope(waveform, self._envelope_step, self.sampling_rate)

    def evened(self, waveform):
        """What the decoder learns of a waveform of `normalize`: freed from its fast envelope, if there is one.

        Args:
            waveform (`np.ndarray`): (batch, samples), whole latent frames.

        Returns:
            `np.ndarray`: (batch, samples), of the same dtype. `denormalize` undoes it.
        """
        if not self.envelope_samples:
            return waveform
        return (waveform / envelope_gain(self._fast_envelope(waveform), self._envelope_step)).astype(waveform.dtype)

    @property
    def lctg_geometry(self):
        """Arguments of [`LCTGModel`] that follow from this extractor: channels, hops, levels, envelope and detail."""
        return {
            "feature_channels": self.feature_size,
            "feature_hop": self.hop_length,
            "latent_hop": self.hop_length * self.frame_multiple,
            "level_bands": self.level_bands,
            "envelope_channels": self.envelope_samples,
            "detail_channels": self.detail_samples,
        }

    @property
    def _latent_grid(self):
        """Sampling rate, band, window and hop of what has one frame for each frame of the latents."""
        return {
            "sampling_rate": self.sampling_rate,
            "band": self.band,
            "window": max(self.window_lengths),
            "hop": self.hop_length * self.frame_multiple,
        }

    def band_levels(self, waveform):
        """Levels of `level_bands` bands and of what lies above them, of whitened waveforms (`measure_band_levels`).

        Args:
            waveform (`np.ndarray`): (batch, samples) of `normalize`.

        Returns:
            `np.ndarray`: (batch, level_bands + 1, samples / (hop_length * frame_multiple)) float32.

        Raises:
            ValueError: if the extractor has no `level_bands`.
        """
        if not self.level_bands:
            raise ValueError("`level_bands` is 0: this feature extractor measures no levels of bands.")
        return measure_band_levels(waveform, count=self.level_bands, **self._latent_grid).astype(np.float32)

    def fast_modulation(self, waveform):
        """Departures of the band levels from their smooth course (`measure_fast_modulation`), as `band_levels`."""
        return measure_fast_modulation(waveform, count=self.level_bands, **self._latent_grid)

    def power_over_time(self, band_levels):
        """Power over time that band levels ask of a texture, in an arbitrary unit.

        Args:
            band_levels (`torch.Tensor`): (batch, level_bands + 1, frames), as `denormalize` takes them.

        Returns:
            `torch.Tensor`: (batch, frames) float64.
        """
        grid = self._latent_grid
        frequencies = np.fft.rfftfreq(grid["window"], 1 / self.sampling_rate)
        gains = 10 ** (-self._preemphasis(frequencies) / 10)
        weights = band_sums(gains, grid["sampling_rate"], grid["band"], self.level_bands, grid["window"])
        return torch.einsum("b,nbf->nf", torch.from_numpy(weights), band_levels.double().exp().cpu())

    def denormalize(self, waveform, levels, samples=None, band_levels=None, modulation_gain=None, envelope=None):
        """Undoes `normalize`: pre-emphasis removed, delivery rate, and exactly the RMS that `levels` asks for.

        With a `fixed_scale`, the waveform's own RMS stays, whatever `levels` is.

        Args:
            waveform (`np.ndarray` or `torch.Tensor`): (batch, samples) at the working rate.
            levels (`np.ndarray` or `torch.Tensor`): (batch,), natural log of the RMS in N.
            samples (`int`, *optional*): number of delivered samples to keep; `None` = all.
            band_levels (`np.ndarray` or `torch.Tensor`, *optional*): (batch, level_bands + 1, frames), restored
                after the envelope.
            modulation_gain (`np.ndarray` or `torch.Tensor`, *optional*): (batch, level_bands + 1), factors by which the
                fast modulation of each band is deepened then (`impose_band_levels`).
            envelope (`np.ndarray` or `torch.Tensor`, *optional*): (batch, envelope_samples, frames), the fast envelope
                that `evened` took away: restored before everything else.

        Returns:
            `np.ndarray`: (batch, samples) float32, N, zero mean within the band.

        Raises:
            ValueError: if `band_levels`, `modulation_gain` or `envelope` has another shape.
        """
        waveform, levels = _as_float64(waveform), _as_float64(levels)
        self._check_restored("envelope", envelope, self.envelope_samples, waveform)
        self._check_restored("band_levels", band_levels, self.level_bands and self.level_bands + 1, waveform)
        if envelope is not None:
            waveform = waveform * gain_of_frames(_as_float64(envelope), waveform.shape[-1])
        if band_levels is not None:
            shape = (len(waveform), self.level_bands + 1)
            modulation_gain = None if modulation_gain is None else _as_float64(modulation_gain)
            if modulation_gain is not None and modulation_gain.shape != shape:
                raise ValueError(f"`modulation_gain` must be {shape}, got {modulation_gain.shape}.")
            waveform = impose_band_levels(
                waveform, _as_float64(band_levels), modulation_gain=modulation_gain, **self._latent_grid
            )
        texture = self._emphasize(waveform, -1)
        texture = resample(texture, self.sampling_rate, self.delivery_rate, samples, dtype=np.float32)
        texture = texture.astype(np.float64)
        texture -= texture.mean(-1, keepdims=True)
        with np.errstate(over="ignore", invalid="ignore"):  # the pipeline refuses infinities
            scale, wanted = rms(texture)[:, None], np.exp(levels)[:, None]
            audible = (scale > SILENCE) & (wanted > SILENCE)
            texture = (
                texture * self.fixed_scale if self.fixed_scale else texture / np.where(audible, scale, np.inf) * wanted
            )
            return texture.astype(np.float32)

    def _check_restored(self, name, values, channels, waveform):
        """Refuses values that have not one row for each of the channels and one column for each latent frame."""
        shape = (len(waveform), channels, waveform.shape[-1] // self._latent_grid["hop"])
        if values is not None and not (channels and tuple(values.shape) == shape):
            raise ValueError(
                f"`{name}` must be {shape if channels else None} for a waveform of {tuple(waveform.shape)}, got "
                f"{tuple(values.shape)}."
            )

    def _emphasize(self, waveform, sign):
        """Whitens (`sign` = +1) or colours back (-1) with zero phase.

        The ends are mirrored; turned about their last value, a decoded waveform's would become a step of the lows.
        """
        if self.preemphasis_db is None:
            return waveform
        margin = min(waveform.shape[-1] - 1, int(2 * self.sampling_rate / self.band[0]))
        padded = np.pad(waveform, ((0, 0), (margin, margin)), mode="reflect")
        bins = np.fft.rfftfreq(padded.shape[-1], 1 / self.sampling_rate)
        spectrum = np.fft.rfft(padded, axis=-1) * 10 ** (sign * self._preemphasis(bins) / 20)
        return np.fft.irfft(spectrum, n=padded.shape[-1], axis=-1)[:, margin : margin + waveform.shape[-1]]

    def _preemphasis(self, frequencies):
        """Gains in dB at frequencies (n,) in Hz."""
        if self.preemphasis_db is None:
            return np.zeros(len(frequencies))
        places = np.log(np.maximum(frequencies, self.preemphasis_frequencies[0]))
        return np.interp(places, np.log(self.preemphasis_frequencies), self.preemphasis_db)

    def check_sampling_rate(self, sampling_rate):
        """Raises a `ValueError` unless this is a whole number of Hz that holds the band."""
        if sampling_rate is None:
            raise ValueError(
                "`sampling_rate` is missing: pass the rate of `texture` in Hz; a wrong guess would go unnoticed."
            )
        least = 2 * self.band[1]
        number = isinstance(sampling_rate, Real) and least <= sampling_rate <= MOST_RATE  # NaN fails too
        if not number or sampling_rate % 1:
            raise ValueError(
                f"`sampling_rate` must be at least {least:g} Hz, to hold the band {self.band} Hz, at most {MOST_RATE} "
                f"Hz and a whole number, got {sampling_rate}."
            )

    def _check(self, texture, sampling_rate):
        self.check_sampling_rate(sampling_rate)
        texture = texture_rows(texture)
        usable = np.abs(texture) <= LARGEST_SAMPLE  # NaN is not
        if not usable.all():
            rows = np.flatnonzero(~usable.all(-1)).tolist()
            raise ValueError(f"`texture` has NaN or infinite samples in row(s) {rows[:8]}; remove or repair them.")
        return texture


def _as_float64(values):
    return np.asarray(torch.as_tensor(values).float().cpu(), dtype=np.float64)

"""Losses of both training stages, in float32."""

import math

import torch
import torch.nn.functional as F


def detection_sensitivity(frequencies):
    """How sensitive the fingertip is to vibration, as an amplitude relative to the best frequency, 0 to 1.

    The detection threshold in dB that the codecs of IEEE 1918.1.1 use (Noll et al. 2021, VC-PWQ: Vibrotactile Signal
    Compression based on Perceptual Wavelet Quantization; as in the package vibromaf 0.0.8): a parabola in
    log(frequency + 300 Hz), lowest at 250 Hz. The 300 Hz make it narrow: 6 dB down at 155 and 364 Hz. It was measured
    for acceleration; for force it is taken as a stand-in.

    Args:
        frequencies (`torch.Tensor`): Hz.
    """
    shifted = frequencies / 550 + 6 / 11  # (frequency + 300 Hz) / 550 Hz
    threshold_db = 62 * (shifted.log10() / math.log10(6 / 11)).square()  # above that at 250 Hz
    return 10 ** (-threshold_db / 20)


def multi_resolution_spectral_loss(predicted, target, window_lengths=(64, 256, 1024), sensitivity_rate=None):
    """The paper's optional frequency-aware loss (section 2.2), per row: spectra of predicted and clean waveforms.

    Mean absolute difference of log magnitudes over several window lengths (the multi-resolution form of Yamamoto et
    al. 2020, Parallel WaveGAN); long windows resolve the lows, short ones the moments.

    Args:
        predicted, target (`torch.Tensor`): (batch, samples), unit RMS.
        window_lengths (`tuple[int, ...]`): samples; windows longer than the signal are left out.
        sensitivity_rate (`float`, *optional*): the sampling rate in Hz, to weight frequencies by
            `detection_sensitivity`; `None` = all alike.

    Returns:
        `torch.Tensor`: (batch,).
    """
    losses = []
    for length in window_lengths:
        if length > predicted.shape[-1]:
            continue
        window = torch.hann_window(length, device=predicted.device)
        magnitudes = []
        for waveform in (predicted, target):
            spectrum = torch.stft(waveform.float(), length, length // 4, window=window, return_complex=True)
            # unit-RMS white noise has magnitude about 1 after the division; 0.05 keeps silence out of the logarithm
            magnitudes.append(torch.log(spectrum.abs() / window.square().sum().sqrt() + 0.05))
        difference = (magnitudes[0] - magnitudes[1]).abs().mean(dim=2)
        if sensitivity_rate is not None:
            bins = torch.arange(difference.shape[1], device=difference.device) * (sensitivity_rate / length)
            weights = detection_sensitivity(bins)
            difference = difference * weights / weights.mean()
        losses.append(difference.mean(dim=1))
    return torch.stack(losses).mean(0)


def rating_loss(recovered, requested):
    """Mean squared difference over the specified axes, per row.

    Args:
        recovered (`torch.Tensor`): (batch, axes), z-scores that a rating head hears.
        requested (`torch.Tensor`): (batch, axes), z-scores; NaN = not specified, left out.

    Returns:
        `torch.Tensor`: (batch,); 0 where nothing was specified.
    """
    specified = ~torch.isnan(requested)
    difference = torch.where(specified, recovered - torch.nan_to_num(requested), torch.zeros_like(recovered))
    return difference.square().sum(-1) / specified.sum(-1).clamp_min(1)


def velocity_loss(predicted, target, frequency_weights=None):
    """Mean squared error of the velocity, per row: (batch, ...) -> (batch,) (v-objective, arXiv 2202.00512).

    Args:
        predicted, target (`torch.Tensor`): (batch, ...); time last if there are weights.
        frequency_weights (`torch.Tensor`, *optional*): (samples // 2 + 1,), see `octave_weights`. Weights move the
            network's effort between frequencies, not its optimum: the best velocity is the same for any of them.
    """
    if frequency_weights is None:
        return F.mse_loss(predicted.float(), target.float(), reduction="none").flatten(1).mean(1)
    spectrum = torch.fft.rfft(predicted.float() - target.float(), norm="ortho")
    return ((spectrum.real.square() + spectrum.imag.square()) * frequency_weights).flatten(1).mean(1)


def octave_weights(samples, sampling_rate, band, exponent):
    """Weights proportional to frequency ** -exponent, constant outside the band, of mean one.

    A whitened texture has equal power in every hertz, so its lowest band of nine holds 1 % of the loss and the highest
    a third; with exponent 1 every octave counts the same, as it does to the finger.

    Args:
        samples (`int`): of the waveform.
        sampling_rate (`float`): Hz.
        band (`tuple[float, float]`): Hz.
        exponent (`float`): 0 = flat.

    Returns:
        `torch.Tensor`: (samples // 2 + 1,) float32.
    """
    frequencies = torch.arange(samples // 2 + 1) * (sampling_rate / samples)
    weights = frequencies.clamp(*band) ** -exponent
    return weights / weights.mean()

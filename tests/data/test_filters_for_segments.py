"""What preparation relies on: the band-pass and the resampling."""

import numpy as np
import pytest
from scipy import signal

from tactile_diffusers.signal import BAND_HZ, DEVICE_RATE, WORKING_RATE, band_pass, resample


def test_two_passes_square_the_magnitude_and_keep_the_phase():
    # the impulse sits in the middle of 2 s, so that padding plays no part; 1e-6 is rounding of a recursion with poles
    # close to the unit circle, relative to a response of 1
    impulse = np.zeros(20_001)
    impulse[10_000] = 1
    response = np.fft.rfft(np.roll(band_pass(impulse, DEVICE_RATE), -10_000))
    frequency = np.fft.rfftfreq(len(impulse), 1 / DEVICE_RATE)
    sections = signal.butter(4, BAND_HZ, btype="bandpass", fs=DEVICE_RATE, output="sos")
    single = signal.sosfreqz(sections, frequency, fs=DEVICE_RATE)[1]
    np.testing.assert_allclose(response.real, np.abs(single) ** 2, atol=1e-6)
    np.testing.assert_allclose(response.imag, 0, atol=1e-6)


@pytest.mark.parametrize("frequency", [20, 100, 500, 900, 1000])
def test_resampling_is_flat_to_1_khz(frequency):
    time = np.arange(20_000) / DEVICE_RATE
    output = resample(np.sin(2 * np.pi * frequency * time), DEVICE_RATE, WORKING_RATE)[500:-500]
    expected = np.sin(2 * np.pi * frequency * np.arange(5000) / WORKING_RATE)[500:-500]
    # 0.1 dB of ripple is 1.2 % of the amplitude
    assert np.abs(output - expected).max() < 0.0116


@pytest.mark.parametrize("frequency", [1400, 1500, 2000, 2400, 2600, 3500, 3601, 4900])
def test_resampling_rejects_what_would_fold_below_1100_hz(frequency):
    # between 10 and 2.5 kHz everything from 1400 Hz folds, onto 1100 Hz and below or above it; all of it is 60 dB down
    time = np.arange(20_000) / DEVICE_RATE
    output = resample(np.sin(2 * np.pi * frequency * time), DEVICE_RATE, WORKING_RATE)[500:-500]
    assert np.abs(output).max() < 1e-3

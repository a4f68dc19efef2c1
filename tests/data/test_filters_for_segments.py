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


@pytest.mark.parametrize("passes, edge_db", [(1, -3.01), (2, -6.02)])
def test_edges_of_the_design(passes, edge_db):
    # the convention that is told: one pass is 3 dB down at the edges, two are 6 dB; 0.01 dB for 1 s of transients
    time = np.arange(4 * DEVICE_RATE) / DEVICE_RATE
    for edge in BAND_HZ:
        filtered = band_pass(np.sin(2 * np.pi * edge * time), DEVICE_RATE, passes=passes)[DEVICE_RATE : 3 * DEVICE_RATE]
        assert 20 * np.log10(np.std(filtered) * np.sqrt(2)) == pytest.approx(edge_db, abs=0.01)


def resampled_gains(frequencies):
    """Largest amplitude of each resampled sine from the middle of 1 s."""
    time = np.arange(10_000) / DEVICE_RATE
    output = resample(np.exp(2j * np.pi * frequencies[:, None] * time).real, DEVICE_RATE, WORKING_RATE)
    quadrature = resample(np.exp(2j * np.pi * frequencies[:, None] * time).imag, DEVICE_RATE, WORKING_RATE)
    return np.abs(output + 1j * quadrature)[:, 500:-500]


def test_resampling_is_flat_to_1200_hz():
    gains = 20 * np.log10(resampled_gains(np.arange(0, 1201, 50.0)))
    assert np.abs(gains).max() < 0.01


def test_resampling_rejects_what_would_fold_below_1200_hz():
    # between 10 and 2.5 kHz everything from 1300 Hz folds onto 1200 Hz and below. The design asks for 80 dB, the
    # lengths of Kaiser's formula are estimates
    gains = resampled_gains(np.arange(1300, 5001, 50.0))
    assert 20 * np.log10(gains.max()) < -78

"""The fast envelope: what it measures, and what it does not."""

import numpy as np
import pytest

from tactile_diffusers.features.fast_envelope import envelope_gain, measure_fast_envelope

RATE, STEP = 2500, 16


def _noise(samples=4096, rows=3, seed=0):
    return np.random.default_rng(seed).normal(size=(rows, samples))


def test_a_gain_that_changes_within_milliseconds_is_measured():
    times = np.arange(4096) / RATE
    gain = 0.8 * np.sin(2 * np.pi * 15 * times)
    found = measure_fast_envelope(np.exp(gain) * np.sin(2 * np.pi * 500 * times)[None], STEP, RATE)[0]
    assert found.shape == (256,) and found.dtype == np.float64
    expected = gain.reshape(256, STEP).mean(1)
    # a window of 12.8 ms of a period of 67 ms; 1 - 0.03 / 0.3 of it is believed
    assert np.corrcoef(found, expected)[0, 1] > 0.99 and found.std() == pytest.approx(0.85 * expected.std(), rel=0.1)


def test_of_steady_noise_little_is_believed():
    assert measure_fast_envelope(_noise(), STEP, RATE).std() < 0.05  # measured without shrinking: 0.15


def test_a_click_stands_where_it_is():
    waveform = 0.1 * _noise(rows=1)
    waveform[0, 1000] += 10
    assert measure_fast_envelope(waveform, STEP, RATE)[0].argmax() == 1000 // STEP


def test_slow_changes_and_the_level_belong_to_the_band_levels():
    noise = _noise()
    slow = np.exp(np.sin(2 * np.pi * 0.5 * np.arange(4096) / RATE))
    plain = measure_fast_envelope(noise, STEP, RATE)
    # 0.5 Hz against a kernel of 0.4 s: what is left of an amplitude of 1 is 0.1
    np.testing.assert_allclose(measure_fast_envelope(slow * noise, STEP, RATE), plain, rtol=0, atol=0.35)
    # up to the floor, which matters 40 dB below the level
    np.testing.assert_allclose(measure_fast_envelope(3 * noise, STEP, RATE), plain, rtol=0, atol=0.02)
    np.testing.assert_array_equal(measure_fast_envelope(-noise, STEP, RATE), plain)


@pytest.mark.parametrize("samples", [16, 64, 640])
def test_any_length_and_silence_are_measured(samples):
    assert measure_fast_envelope(_noise(samples), STEP, RATE).shape == (3, samples // STEP)
    assert not measure_fast_envelope(np.zeros((1, samples)), STEP, RATE).any()


def test_the_gain_is_straight_in_log_amplitude_between_the_middles_of_values():
    values = np.array([[0.0, 1.0, -0.5]])
    middles = np.arange(3) * STEP + (STEP - 1) / 2
    expected = np.exp(np.interp(np.arange(3 * STEP), middles, values[0]))
    gain = envelope_gain(values, STEP)
    assert gain.shape == (1, 48) and gain.dtype == np.float64
    np.testing.assert_allclose(gain[0], expected, rtol=1e-12)


def test_a_value_for_each_sample_has_a_gain_for_each():
    assert envelope_gain(np.zeros((2, 5)), 1).tolist() == [[1.0] * 5] * 2


def test_an_evened_waveform_is_steady_and_comes_back_exactly(make_extractor):
    extractor = make_extractor(envelope_samples=2, preemphasis_frequencies=None, preemphasis_db=None)
    bursts = np.exp(np.sin(2 * np.pi * 10 * np.arange(4096) / RATE)) ** 2
    waveform = (bursts * _noise()).astype(np.float32)
    waveform /= waveform.std(-1, keepdims=True)
    evened = extractor.evened(waveform)
    assert evened.shape == waveform.shape and evened.dtype == np.float32
    kurtosis = [np.mean(x**4) / np.mean(x**2) ** 2 for x in (waveform.ravel(), evened.ravel())]
    assert kurtosis[0] > 6 and kurtosis[1] < 3.1  # that of noise is 3
    envelope = extractor.features(waveform)[:, :2, ::2]
    back, expected = (
        extractor.denormalize(x, np.zeros(3), envelope=e) for x, e in ((evened, envelope), (waveform, None))
    )
    np.testing.assert_allclose(back, expected, rtol=0, atol=1e-4)  # the envelope is float32; unit RMS


def test_features_hold_it_between_levels_and_energies(make_extractor):
    extractor = make_extractor(level_bands=1, envelope_samples=2, detail_samples=2)
    waveform = _noise(512)
    features = extractor.features(waveform)
    assert features.shape == (3, 2 + 2 + 24 + 2, 64)
    expected = measure_fast_envelope(waveform, 8, extractor.sampling_rate).reshape(3, 32, 2).transpose(0, 2, 1)
    np.testing.assert_allclose(features[:, 2:4, ::2], expected, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(features[:, :4, ::2], features[:, :4, 1::2])
    plain = make_extractor(level_bands=1, detail_samples=2)
    np.testing.assert_array_equal(np.delete(features, [2, 3], axis=1)[:, :-2], plain.features(waveform)[:, :-2])
    detail = plain.features(extractor.evened(waveform))[:, -2:]  # the low end of what the decoder learns
    np.testing.assert_allclose(features[:, -2:], detail, rtol=0, atol=1e-6)
    assert extractor.lctg_geometry["envelope_channels"] == 2


@pytest.mark.parametrize("count", [-1, 3, 17])
def test_a_number_that_does_not_divide_a_frame_is_refused(make_extractor, count):
    with pytest.raises(ValueError, match=rf"`envelope_samples` must be 0 \(none\) or divide the 16 .* got {count}\b"):
        make_extractor(envelope_samples=count)

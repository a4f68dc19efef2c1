"""The 72 features, and what the distances on them see."""

import numpy as np
import pytest
from scipy import signal

from tactile_diffusers.evaluation import (
    EMBEDDING_VERSION,
    FEATURE_NAMES,
    TactileEmbedding,
    frechet_tactile_distance,
    kernel_tactile_distance,
    tactile_features,
)
from tactile_diffusers.signal import DEVICE_RATE, SEGMENT_SAMPLES, WORKING_RATE, band_pass, resample, rms

SECONDS = np.arange(SEGMENT_SAMPLES) / DEVICE_RATE


@pytest.fixture(scope="module")
def embedding(reference):
    return TactileEmbedding.fit(reference)


@pytest.fixture(scope="module")
def embedded_reference(embedding, reference):
    return embedding(reference)


@pytest.fixture(scope="module")
def distances(embedding, embedded_reference):
    """A function textures -> (FTD, KTD) to the reference."""

    def measure(textures):
        embedded = embedding(textures)
        return (
            frechet_tactile_distance(embedded, embedded_reference),
            kernel_tactile_distance(embedded, embedded_reference, embedding.width),
        )

    return measure


def _feature(values, name):
    return values[:, FEATURE_NAMES.index(name)]


def _sine(frequency):
    return np.sin(2 * np.pi * frequency * SECONDS)


@pytest.mark.parametrize(
    ("texture", "expected"),
    [
        # amplitude a: power a^2 / 2 in the band that holds it; tolerances are the window's leakage and the cut ends
        (0.01 * _sine(100), {"band_92_114_db": (10 * np.log10(0.01**2 / 2), 0.05), "out_2000_5000_db": (-40, 0)}),
        (_sine(100), {"kurtosis": (1.5, 0.01), "skew": (0, 0.01), "crest": (np.sqrt(2), 0.01)}),
        # -20 dB of the strong one, -20.04 dB of the total
        (_sine(100) + 0.1 * _sine(1500), {"out_1050_2000_db": (-20.04, 0.01), "out_2000_5000_db": (-40, 0)}),
        # 1 + m cos has a variance of m^2 / 2
        (
            (1 + 0.5 * np.cos(2 * np.pi * 10 * SECONDS)) * _sine(200),
            {
                "modulation_3_6_20_db": (20 * np.log10(0.5) - 3.01, 0.3),
                "envelope_variation_3": (0.5 / np.sqrt(2), 0.01),
                "modulation_3_20_60_db": (-60, 30),
                "modulation_3_2_6_db": (-60, 30),
            },
        ),
    ],
)
def test_features_of_sines(texture, expected):
    features = tactile_features(texture[None])
    assert features.shape == (1, len(FEATURE_NAMES)) == (1, 72)
    for name, (value, tolerance) in expected.items():
        assert _feature(features, name) == pytest.approx(value, abs=tolerance), name


def _noise(low, high, seed):
    """Gaussian noise of a band, (1, samples), unit RMS."""
    spectrum = np.fft.rfft(np.random.default_rng(seed).standard_normal((1, SEGMENT_SAMPLES)))
    frequencies = np.fft.rfftfreq(SEGMENT_SAMPLES, 1 / DEVICE_RATE)
    noise = np.fft.irfft(spectrum * ((frequencies >= low) & (frequencies < high)), SEGMENT_SAMPLES)
    return noise / rms(noise)[:, None]


def test_envelopes_that_move_together_correlate():
    """Noise of 142-271 Hz (carrier 3) and 521-1000 Hz (5): correlated by a common gain, against it, or not at all."""
    gain = 1 + 0.9 * np.sin(2 * np.pi * 5 * SECONDS)
    low, high = _noise(142, 271, 1), _noise(521, 1000, 2)
    found = tactile_features(np.concatenate([low + high, gain * (low + high), gain * low + (2 - gain) * high]))
    apart, together, against = _feature(found, "correlation_3_5")
    # the envelope of noise fluctuates too: the common gain is about 0.6 of its variance
    assert abs(apart) < 0.15 and together > 0.4 and against < -0.4


def test_polarity_is_the_sign_of_skews():
    rising = signal.sawtooth(2 * np.pi * 40 * SECONDS)[None]  # slow up, fast down
    saw = np.concatenate([rising, -rising, _noise(20, 1000, 3)])
    up, down, neither = _feature(tactile_features(band_pass(saw, DEVICE_RATE)), "slope_skew")
    assert up < -2 and down == pytest.approx(-up) and abs(neither) < 0.2
    first, second = tactile_features(np.stack([_noise(20, 1000, 3)[0], -_noise(20, 1000, 3)[0]]))
    odd = [FEATURE_NAMES.index(name) for name in ("skew", "slope_skew")]
    np.testing.assert_allclose(np.delete(first, odd), np.delete(second, odd), atol=1e-9)


@pytest.mark.parametrize("jitter", [0.0, 0.03])
def test_events_are_counted(jitter):
    """Bursts of 4 ms on weak noise, ten a second: their rate, how regular they are and how high."""
    moments = np.arange(0.1, 1.5, 0.1) + jitter * np.random.default_rng(4).standard_normal(14)
    bursts = sum(np.exp(-0.5 * ((SECONDS - moment) / 0.004) ** 2) for moment in moments)
    found = tactile_features(0.05 * _noise(100, 1000, 5) + bursts * _sine(300))
    assert _feature(found, "event_rate") == pytest.approx(14 / 1.56, rel=0.12)
    irregularity, intervals = _feature(found, "event_irregularity"), np.diff(np.sort(moments))
    assert irregularity == pytest.approx(intervals.std() / intervals.mean(), abs=0.1)
    assert _feature(found, "event_depth_db") > 15


def test_version_is_named(embedding):
    assert embedding.version == EMBEDDING_VERSION == 2


def test_features_do_not_depend_on_order_chunks_or_dtype(held_out):
    whole = tactile_features(held_out)
    np.testing.assert_allclose(tactile_features(held_out[::-1])[::-1], whole, rtol=0, atol=1e-9)
    np.testing.assert_allclose(np.concatenate([tactile_features(held_out[k : k + 1]) for k in range(5)]), whole[:5])
    np.testing.assert_allclose(tactile_features(held_out.astype(np.float32)), whole, rtol=0, atol=1e-4)


def test_lower_rates_give_the_same_features_within_the_band(held_out):
    slow = tactile_features(resample(held_out, DEVICE_RATE, WORKING_RATE), WORKING_RATE)
    fast = tactile_features(held_out)
    # the resampling filter is flat to 80 dB up to 1 kHz; modulations of its ends: 0.05 dB
    np.testing.assert_allclose(slow[:, :18], fast[:, :18], atol=0.01)
    np.testing.assert_allclose(slow[:, 20:50], fast[:, 20:50], atol=0.05)
    np.testing.assert_allclose(slow[:, 53:68], fast[:, 53:68], atol=0.01)
    assert (_feature(slow, "out_2000_5000_db") == -40).all()


def test_reference_has_zero_mean_unit_deviation_and_floors(embedding, embedded_reference):
    np.testing.assert_allclose(embedded_reference.mean(0), 0, atol=1e-9)
    assert (embedded_reference.std(0, ddof=1) <= 1 + 1e-9).all()
    decibels = np.array([name.endswith("_db") for name in FEATURE_NAMES])
    assert decibels.sum() == 45
    assert (embedding.scale[decibels] >= 1).all() and (embedding.scale[~decibels] >= 0.05).all()
    assert embedding.scale[FEATURE_NAMES.index("out_2000_5000_db")] == 1


def test_width_is_the_median_distance(embedding, embedded_reference):
    pairs = [np.linalg.norm(embedded_reference[k + 1 :] - row, axis=1) for k, row in enumerate(embedded_reference)]
    assert embedding.width == pytest.approx(np.median(np.concatenate(pairs)))


def test_held_out_textures_are_near(distances, held_out):
    # 150 and 100 draws of one distribution: FTD is biased upwards, about 7 here; KTD is not, standard error about 2
    ftd, ktd = distances(held_out)
    assert 0 < ftd < 12
    assert abs(ktd) < 6


def test_bad_input_is_refused(embedding, held_out):
    bad = np.where(held_out == held_out[1, 7], np.inf, held_out)
    for refused, message in (
        (lambda: tactile_features(bad), r"`textures` must be finite, got inf at index \[1, 7\]"),
        (lambda: tactile_features(held_out[0]), "must have the shape 2 axes"),
        (lambda: tactile_features(held_out[:, :4000]), "too short for modulations"),
        (lambda: tactile_features(held_out, 2000), "`sampling_rate` must be above 2000"),
        (lambda: embedding(held_out, WORKING_RATE), "must be that of the reference, 10000 Hz, got 2500"),
        (lambda: TactileEmbedding.fit(held_out[:1]), "at least 2 textures"),
    ):
        with pytest.raises(ValueError, match=message):
            refused()

"""Copies are found wherever they hide, honest draws are not accused, and spread is what it says."""

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from tactile_diffusers.evaluation import TactileEmbedding
from tactile_diffusers.evaluation.metrics import copying
from tactile_diffusers.evaluation.metrics import diversity as diversity_metrics
from tactile_diffusers.evaluation.metrics.copying import TrainingWaveforms, closer_share, nearest_distance
from tactile_diffusers.evaluation.metrics.diversity import diversity, precision_recall, rating_diversity, take_spread_db
from tactile_diffusers.evaluation.metrics.texture_checks import in_blocks
from tactile_diffusers.signal import DEVICE_RATE, band_levels_db


@pytest.fixture(scope="module")
def waveforms(reference):
    return TrainingWaveforms([reference], DEVICE_RATE)


def _shifted(segment, other, samples):
    """A copy that begins `samples` later in the segment (earlier, if negative), filled up from another texture."""
    if samples >= 0:
        return np.concatenate([segment[samples:], other[:samples]])
    return np.concatenate([other[:-samples], segment[:samples]])


@pytest.mark.parametrize("scale", [1.0, -0.5, 1e4])
def test_copies_correlate_fully(waveforms, reference, scale):
    np.testing.assert_allclose(waveforms.nearest_correlation(scale * reference[:6]), 1, atol=2e-3)


@pytest.mark.parametrize("samples", [3000, -3000, 3001, -1703, 8000, -8000])
@pytest.mark.parametrize("scale", [1.0, -0.5])
def test_shifted_copies_correlate_nearly_fully(waveforms, reference, held_out, samples, scale):
    copy = scale * np.stack([_shifted(reference[k], held_out[k], samples) for k in range(4)])
    # half a step of the lag, 0.17 ms, turns 400 Hz by 25 degrees: a loss of 3 % over the band; edges lose 1 % more
    assert waveforms.nearest_correlation(copy).min() > 0.95


def test_fresh_noise_correlates_little(waveforms, reference, held_out):
    correlations = waveforms.nearest_correlation(held_out)
    assert correlations.dtype == np.float64 and correlations.shape == (100,)
    # 1.6 s x 380 Hz are some 1200 free numbers, fewer where the spectrum is uneven: a deviation of about 1/30, of which
    # the largest of 150 x 4800 lags is 5 to 7
    assert 0.1 < correlations.min() and correlations.max() < 0.3
    # less than half of the segment overlaps here, which is not looked at
    beyond = _shifted(reference[0], held_out[0], 10_000)
    assert waveforms.nearest_correlation(beyond[None]) < 0.3


def test_chunks_order_dtype_and_scale_do_not_matter(waveforms, reference, held_out, monkeypatch):
    expected = waveforms.nearest_correlation(held_out[:8])
    monkeypatch.setattr(copying, "_SEGMENTS", 7)
    chunks = (rows.astype(np.float32) for rows in np.array_split(reference[::-1], 7))
    other = TrainingWaveforms(chunks, DEVICE_RATE)
    assert len(other) == len(waveforms) == 150
    np.testing.assert_allclose(other.nearest_correlation(held_out[:8].astype(np.float32)), expected, atol=1e-5)
    single = [other.nearest_correlation(-3 * texture[None])[0] for texture in held_out[:8]]
    np.testing.assert_allclose(single, expected, atol=1e-5)
    loud = TrainingWaveforms([reference * np.geomspace(0.01, 100, 150)[:, None]], DEVICE_RATE)
    np.testing.assert_allclose(loud.nearest_correlation(held_out[:8]), expected, atol=1e-5)


def test_silence_is_no_copy(reference):
    waveforms = TrainingWaveforms([np.concatenate([reference[:3], np.zeros_like(reference[:1])])], DEVICE_RATE)
    assert waveforms.nearest_correlation(np.zeros_like(reference[:1])) == 0
    assert waveforms.nearest_correlation(reference[:1]) > 0.99
    silent = TrainingWaveforms([np.zeros_like(reference[:2])], DEVICE_RATE)
    assert silent.nearest_correlation(reference[:1]) == 0


@pytest.fixture(scope="module")
def closeness(waveforms, reference):
    """The three ways to be close: name -> (function of textures, whether higher is closer)."""
    embedding = TactileEmbedding.fit(reference)
    points, latents = embedding(reference), reference[:, ::16]
    return {
        "waveform": (waveforms.nearest_correlation, True),
        "embedding": (lambda textures: nearest_distance(embedding(textures), points), False),
        "latent": (lambda textures: nearest_distance(textures[:, ::16], latents), False),  # (n, 1024)
    }


@pytest.mark.parametrize("name", ["waveform", "embedding", "latent"])
def test_a_memoriser_is_caught_and_an_honest_generator_is_not(closeness, reference, held_out, noise_textures, name):
    measure, higher = closeness[name]
    real = measure(noise_textures(200, seed=21))
    memorised, threshold = closer_share(measure(reference[::3]), real, higher_is_closer=higher)
    assert memorised == 1
    assert (threshold > np.median(real)) == higher
    # 1 % of 100 textures, and a percentile known from 200: deviation sqrt(0.01/100 + 0.01/200) = 1.2 %, four of them
    honest, _ = closer_share(measure(held_out), real, higher_is_closer=higher)
    assert honest <= 0.06
    half, _ = closer_share(measure(np.concatenate([reference[:50], held_out[:50]])), real, higher_is_closer=higher)
    assert 0.5 <= half <= 0.56


def test_share_and_threshold_are_known():
    real = np.arange(1.0, 100.0)  # 99 values: the first percentile is the smallest
    assert closer_share([0.5, 0.9, 1.0, 50.0], real) == (0.5, 1.0)
    assert closer_share([99.0, 99.1], real, higher_is_closer=True) == (0.5, 99.0)
    assert closer_share([0.5, 3.5], [4.0, 3.0]) == (0.5, 3.0)  # too few real values: their smallest
    assert closer_share([24.0, 26.0], real, quantile=0.25)[0] == 0.5
    with pytest.raises(ValueError, match="`quantile` must be between"):
        closer_share(real, real, quantile=1)
    with pytest.raises(ValueError, match="`real_values` must have the shape"):
        closer_share(real, [])
    with pytest.raises(ValueError, match="`values` must be finite"):
        closer_share([np.nan], real)


def test_nearest_distance_is_the_smallest_distance(monkeypatch):
    rng = np.random.default_rng(1)
    points, reference = rng.normal(size=(70, 53)), rng.normal(size=(300, 53))
    expected = cdist(points, reference).min(-1)
    np.testing.assert_allclose(nearest_distance(points, reference), expected, rtol=1e-12)
    monkeypatch.setattr(copying, "in_blocks", lambda rows: in_blocks(rows, 9))
    np.testing.assert_allclose(nearest_distance(points[::-1], reference[::-1])[::-1], expected, rtol=1e-12)
    single = nearest_distance(points.astype(np.float32), reference.astype(np.float32))
    assert single.dtype == np.float64
    np.testing.assert_allclose(single, expected, rtol=1e-5)
    # an offset far larger than the distances costs digits of the offset alone
    np.testing.assert_allclose(nearest_distance(points + 1e6, reference + 1e6), expected, rtol=1e-8)
    assert (nearest_distance(reference[5:9], reference) == 0).all()
    with pytest.raises(ValueError, match="`points` and `reference` must have the same features, got 53 and 52"):
        nearest_distance(points, reference[:, 1:])
    with pytest.raises(ValueError, match="`reference` must be finite"):
        nearest_distance(points, np.full_like(points, np.inf))


def test_precision_and_recall_are_their_definition(monkeypatch):
    rng = np.random.default_rng(3)
    generated, real = rng.normal(size=(30, 4)) + 0.8, rng.normal(size=(40, 4))

    def covered(points, members, k):
        hits = 0
        for point in points:
            for member in members:
                radius = sorted(np.linalg.norm(members - member, axis=1))[k]
                if np.linalg.norm(point - member) <= radius:
                    hits += 1
                    break
        return hits / len(points)

    expected = (covered(generated, real, 3), covered(real, generated, 3))
    assert 0.2 < min(expected) and max(expected) < 1
    assert precision_recall(generated, real, k=3) == expected
    monkeypatch.setattr(diversity_metrics, "in_blocks", lambda rows: in_blocks(rows, 7))
    assert precision_recall(generated[::-1], real[::-1], k=3) == expected
    assert precision_recall(generated.astype(np.float32), real, k=3) == pytest.approx(expected, abs=0.04)  # one member
    for k in (0, 30):
        with pytest.raises(ValueError, match=f"`k` must be at least 1 and below.*30 and 40, got {k}"):
            precision_recall(generated, real, k=k)
    with pytest.raises(ValueError, match="same features"):
        precision_recall(generated[:, 1:], real)


def test_take_spread_of_known_takes():
    # takes that differ by d have the unbiased variance d^2 / 2; the lone take counts for nothing
    levels = np.array([[0.0, 10.0], [2.0, 14.0], [50.0, 50.0]])
    assert take_spread_db(levels, ["a", "a", "b"]) == pytest.approx((2 + 4) / 2 / np.sqrt(2))
    # pooled: (0.5 * 2^2 + 0.5 * 4^2) / 2 degrees of freedom
    levels = np.array([[0.0], [2.0], [100.0], [104.0]])
    assert take_spread_db(levels, [1, 1, 0, 0]) == pytest.approx(np.sqrt(5))
    assert take_spread_db(levels[[2, 1, 3, 0]] + 7, [0, 1, 0, 1]) == pytest.approx(np.sqrt(5))


def test_diversity_of_repetition_is_zero_and_of_honest_takes_one(noise_textures):
    # textures of one slope and level would be takes; here all 60 of one distribution play takes of one surface
    real, honest = (band_levels_db(noise_textures(60, seed), DEVICE_RATE) for seed in (31, 32))
    one_group = np.zeros(60)
    assert diversity(np.repeat(honest[:1], 60, axis=0), one_group, real, one_group) == pytest.approx(0, abs=1e-12)
    # slope and level are shared by the bands, so 59 degrees of freedom in each set: deviation sqrt(2/(2*59)) = 13 %
    assert diversity(honest, one_group, real, one_group) == pytest.approx(1, abs=0.4)
    halved = real.mean(0) + 0.5 * (real - real.mean(0))
    assert diversity(halved, one_group, real, one_group) == pytest.approx(0.5)


CENTRES = np.array([[1.0, 0.5, -1.0], [-1.0, 0.0, 1.0]])


def _rated_surfaces(rng, near=300, per_surface=2, slope=0.0):
    """Real textures of surfaces near two ratings: what ratings leave open is 4 dB, in bands of 30 and 60 dB.

    Beyond that levels rise by `slope` dB for each unit of the second rating.
    """
    ratings = np.repeat(CENTRES, near, axis=0) + 0.2 * rng.standard_normal((2 * near, 3))
    surfaces = np.repeat(np.arange(2 * near), per_surface)
    centres = np.where(ratings[:, :1] > 0, 30.0, 60.0) + slope * ratings[:, 1:2]
    levels = centres + 4.0 * rng.standard_normal((2 * near, 9))
    return levels[surfaces], ratings[surfaces], surfaces


def _takes(rng, spread, count=150):
    """Generated takes of the two ratings, in other bands: only their spread counts."""
    groups = np.repeat([0, 1], count)
    return np.array([[0.0], [90.0]])[groups] + spread * rng.standard_normal((2 * count, 9)), groups


@pytest.mark.parametrize("share", [1.0, 0.5, 2.0])
@pytest.mark.parametrize("slope", [0.0, 20.0])
def test_diversity_of_a_rating_is_the_share_of_what_ratings_leave_open(share, slope):
    rng = np.random.default_rng(5)
    real = _rated_surfaces(rng, slope=slope)  # 20 dB x 0.17, what ratings that count alike spread: nearly as much
    # 2 x 9 x 149 numbers of takes and some 2 x 9 x 200 of surfaces that count: relative deviations of standard
    # deviations of 1/sqrt(2 * 2700) = 1.4 % and 1.2 %, together 1.8 %; three of them
    made = rating_diversity(*_takes(rng, share * 4.0), CENTRES, *real)
    assert made == pytest.approx(share, rel=0.06)

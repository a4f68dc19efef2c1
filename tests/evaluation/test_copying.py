"""Copies are found wherever they hide, honest draws are not accused, and spread is what it says."""

import numpy as np
import pytest

from tactile_diffusers.evaluation.metrics import diversity as diversity_metrics
from tactile_diffusers.evaluation.metrics.copying import TrainingEnvelopes, copied_share
from tactile_diffusers.evaluation.metrics.diversity import covered, diversity, rating_diversity, take_spread_db
from tactile_diffusers.evaluation.metrics.texture_checks import in_blocks
from tactile_diffusers.signal import DEVICE_RATE, band_levels_db


@pytest.fixture(scope="module")
def envelopes(reference):
    return TrainingEnvelopes([reference], DEVICE_RATE)


def _shifted(segment, other, samples):
    """A copy that begins `samples` later in the segment (earlier, if negative), filled up from another texture."""
    if samples >= 0:
        return np.concatenate([segment[samples:], other[:samples]])
    return np.concatenate([other[:-samples], segment[:samples]])


@pytest.mark.parametrize("scale", [1.0, -0.5, 1e4])
def test_copies_correlate_fully(envelopes, reference, scale):
    np.testing.assert_allclose(envelopes.nearest_correlation(scale * reference[:6]), 1, atol=1e-5)


@pytest.mark.parametrize("samples", [3000, -3001, -1703, 4000, -4000])
def test_shifted_copies_stand_out(envelopes, reference, held_out, samples):
    copy = np.stack([_shifted(reference[k], held_out[k], samples) for k in range(4)])
    # training segments overlap by half, so none is farther than 0.4 s; a quarter of it is of another texture then
    assert envelopes.nearest_correlation(copy).min() > 0.38
    # chance: the largest of 150 segments x 29 lags with some 18 x 13 free numbers that a limit makes alike
    honest = envelopes.nearest_correlation(held_out)
    assert honest.dtype == np.float64 and honest.shape == (100,)
    assert 0.1 < honest.min() and honest.max() < 0.36


def test_chunks_order_dtype_and_scale_do_not_matter(envelopes, reference, held_out):
    expected = envelopes.nearest_correlation(held_out[:8])
    chunks = (rows.astype(np.float32) for rows in np.array_split(reference[::-1], 7))
    other = TrainingEnvelopes(chunks, DEVICE_RATE)
    assert len(other) == len(envelopes) == 150
    np.testing.assert_allclose(other.nearest_correlation(held_out[:8].astype(np.float32)), expected, atol=1e-4)
    single = [other.nearest_correlation(-3 * texture[None])[0] for texture in held_out[:8]]
    np.testing.assert_allclose(single, expected, atol=1e-4)
    loud = TrainingEnvelopes([reference * np.geomspace(0.01, 100, 150)[:, None]], DEVICE_RATE)
    np.testing.assert_allclose(loud.nearest_correlation(held_out[:8]), expected, atol=1e-4)


def test_silence_is_no_copy(envelopes, reference):
    assert envelopes.nearest_correlation(np.zeros_like(reference[:1])) == 0
    silent = TrainingEnvelopes([np.zeros_like(reference[:2])], DEVICE_RATE)
    assert silent.nearest_correlation(reference[:1]) == 0


def test_impossible_segments_are_refused(envelopes, reference):
    with pytest.raises(ValueError, match="at least one array"):
        TrainingEnvelopes([], DEVICE_RATE)
    with pytest.raises(ValueError, match="`chunks` must have .* last 0.5 s"):
        TrainingEnvelopes([reference[:, :4000]], DEVICE_RATE)
    with pytest.raises(ValueError, match="`textures` must have 16384 samples.*got 16000"):
        envelopes.nearest_correlation(reference[:, :16000])


def test_real_against_real_gives_the_nominal_share_and_copies_give_all(envelopes, reference, noise_textures):
    real, groups = envelopes.nearest_correlation(noise_textures(200, seed=21)), np.repeat(np.arange(50), 4)
    copies, own = envelopes.nearest_correlation(reference[::3]), np.arange(50)
    # a share of 5 % of 200: deviation 1.5 %, of which the threshold, taken from the same values, leaves little
    share, (low, high) = copied_share(real, groups, real, groups)
    assert share == pytest.approx(0.05, abs=0.02) and low <= 0.05 <= high
    assert copied_share(copies, own, real, groups) == (1.0, (1.0, 1.0))
    other = envelopes.nearest_correlation(noise_textures(200, seed=22))
    share, (low, high) = copied_share(other, groups, real, groups)
    # the shares above and below a threshold known from 200: deviation sqrt(2 * 0.05 * 0.95 / 200) = 2.2 %
    assert share < 0.12 and low <= 0.05 <= high + 0.02
    half, (low, high) = copied_share(np.r_[copies, other[:50]], np.r_[own, own], real, groups)
    assert 0.5 <= half <= 0.58 and low > 0.45


def test_share_is_that_above_a_quantile_of_the_other_surfaces():
    real, groups = np.arange(1.0, 101.0), np.arange(100)
    # of the 99 others the 5th largest has the rank 5 of 100: a new draw exceeds it in 5 of 100 cases
    share, _ = copied_share(real, groups, real, groups)
    assert share == 0.05
    share, interval = copied_share([96.5, 95.5, 0.0, 0.0], [200, 201, 202, 203], real, groups)
    assert share == 0.25 and interval[0] <= 0.25 <= interval[1]
    assert copied_share([1e3, 1e3], [0, 1], real, groups)[0] == 1
    # a surface whose own takes are all alike is compared with the others alone
    assert copied_share([50.0], [7], np.r_[real, np.full(400, 49.0)], np.r_[groups, np.full(400, 7)])[0] == 0
    assert copied_share([50.0], [7], np.r_[real, np.full(400, 99.0)], np.r_[groups, np.full(400, 7)])[0] == 0
    with pytest.raises(ValueError, match="`quantile` must be between"):
        copied_share(real, groups, real, groups, quantile=1)
    with pytest.raises(ValueError, match="`real_values` must have the shape"):
        copied_share(real, groups, [], [])
    with pytest.raises(ValueError, match="`real_groups` must name two surfaces or more, got"):
        copied_share(real, groups, real, np.zeros(100, int))
    with pytest.raises(ValueError, match="`values` must be finite"):
        copied_share([np.nan], [0], real, groups)


def test_precision_and_recall_are_their_definition(monkeypatch):
    rng = np.random.default_rng(3)
    generated, real = rng.normal(size=(30, 4)) + 0.8, rng.normal(size=(40, 4))

    def by_hand(points, members, k):
        hits = 0
        for point in points:
            for member in members:
                radius = sorted(np.linalg.norm(members - member, axis=1))[k]
                if np.linalg.norm(point - member) <= radius:
                    hits += 1
                    break
        return hits / len(points)

    expected = by_hand(generated, real, 3)
    assert 0.2 < expected < 1 and covered(generated, real, k=3) == expected
    monkeypatch.setattr(diversity_metrics, "in_blocks", lambda rows: in_blocks(rows, 7))
    assert covered(generated[::-1], real[::-1], k=3) == expected
    assert covered(generated.astype(np.float32), real, k=3) == pytest.approx(expected, abs=0.04)  # one member
    for k in (0, 40):
        with pytest.raises(ValueError, match=f"`k` must be at least 1 and below.*40, got {k}"):
            covered(generated, real, k=k)
    with pytest.raises(ValueError, match="same features"):
        covered(generated[:, 1:], real)


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
    made, _ = rating_diversity(*_takes(rng, share * 4.0), CENTRES, *real)
    assert made == pytest.approx(share, rel=0.06)

"""Baselines: each against a case whose answer is known."""

from dataclasses import replace
from math import inf, nan

import numpy as np
import pytest
from report import envelopes
from report.baselines import (
    SLUGS,
    BaselineRequest,
    Decimated,
    KnnBlend,
    MeanSpectrum,
    PhaseRandomised,
    Ridge,
    TrainingTextures,
    default_baselines,
    latent_rate,
)
from scipy import signal

from tactile_diffusers.evaluation import out_of_band_ratio_db, snr_db
from tactile_diffusers.signal import DEVICE_RATE, SEGMENT_SAMPLES, band_levels_db, nine_band_error_db, rms

GRID = envelopes.Grid(SEGMENT_SAMPLES, DEVICE_RATE)


def seeded(seed=0):
    return np.random.default_rng(seed)


def levels_db(textures):
    return 20 * np.log10(rms(textures))


def tilted_noise(level, tilt, rng):
    """Textures of given levels (n,), dB re 1 N, and tilts (n,), dB an octave."""
    density = 10 ** (np.multiply.outer(tilt, np.log2(GRID.frequencies / 150)) / 10)
    return GRID.noise(density, rng, 10 ** (np.asarray(level) / 20))


@pytest.fixture(scope="module")
def training(reference):
    """The 150 textures as 50 surfaces of 3 segments."""
    rng, ids = seeded(10), np.repeat(np.arange(50), 3)
    ratings, friction = rng.normal(size=(50, 3)), rng.lognormal(-0.5, 0.3, size=50)
    return TrainingTextures(reference, ratings[ids], friction[ids], ids, DEVICE_RATE)


@pytest.fixture(scope="module")
def request_(held_out):
    ratings = seeded(11).normal(size=(12, 3))
    ratings[3:6, 1], ratings[6:9, :2], ratings[9:] = nan, nan, nan
    return BaselineRequest(ratings, held_out[:12], held_out[12:24])


@pytest.fixture(scope="module")
def planted():
    """80 surfaces: 6 dB of level a unit of roughness, -2 dB an octave a unit of bumpiness, -0.4 of log friction a unit
    of slipperiness; roughness and bumpiness correlate by 0.6; segments of a surface scatter by 1 dB."""
    rng = seeded(12)
    covariance = np.array([[1, 0.6, 0], [0.6, 1, 0], [0, 0, 1]])
    ratings = np.repeat(rng.multivariate_normal(np.zeros(3), covariance, size=80), 3, 0)
    textures = tilted_noise(-40 + 6 * ratings[:, 0] + rng.normal(size=240), -2 * ratings[:, 1] - 4, rng)
    friction = np.exp(-0.5 - 0.4 * ratings[:, 2])
    return TrainingTextures(textures, ratings, friction, np.repeat(np.arange(80), 3), DEVICE_RATE)


@pytest.fixture(scope="module")
def three_surfaces():
    """One segment each at roughness -1, 1 and 8: levels -50, -30 and -20 dB, friction 0.2, 0.8 and 5."""
    textures = tilted_noise([-50, -30, -20], [-2, -6, 0], seeded(13))
    ratings = np.array([[-1, 0, 0], [1, 0, 0], [8, 0, 0.0]])
    return TrainingTextures(textures, ratings, np.array([0.2, 0.8, 5.0]), np.arange(3), DEVICE_RATE)


def test_slugs_are_the_contract():
    assert SLUGS == (
        *("silence", "other_take", "phase_randomised", "mean_spectrum", "lpc20"),
        *("nine_band_noise", "decimated", "knn_blend", "ridge"),
    )
    assert tuple(default_baselines(500, 2.0)) == SLUGS


@pytest.mark.parametrize("slug", SLUGS)
def test_textures_are_finite_in_band_repeatable_and_know_only_what_they_may(slug, training, request_):
    baseline = default_baselines(500, 2.0)[slug]
    assert baseline.fit(training) is baseline
    made = baseline.sample(request_, seeded())
    assert made.shape == (12, SEGMENT_SAMPLES) and made.dtype == np.float64 and np.isfinite(made).all()
    # another take is a recording, with the slope of its filter: -27 dB where highs are strong
    assert (out_of_band_ratio_db(made, DEVICE_RATE) < (-25 if slug == "other_take" else -40)).all()
    np.testing.assert_array_equal(baseline.sample(request_, seeded()), made)
    if slug not in ("silence", "other_take"):
        assert not np.allclose(baseline.sample(request_, seeded(1)), made)

    blind = {
        "nothing": BaselineRequest(np.zeros((12, 3))),
        "ratings": replace(request_, textures=None, other_takes=None),
        "recording": replace(request_, ratings=np.full((12, 3), nan)),
    }[baseline.knows]
    np.testing.assert_array_equal(baseline.sample(blind, seeded()), made)


@pytest.mark.parametrize("slug", ("phase_randomised", "lpc20", "nine_band_noise"))
def test_descriptions_keep_level_and_scale_and_do_not_look_at_other_rows(slug, training, request_):
    baseline = default_baselines(500, 2.0)[slug].fit(training)
    made = baseline.sample(request_, seeded())
    # band levels come from a Hann window, so they miss the ends of a texture whose power is uneven
    tolerance = 1.5 if slug == "nine_band_noise" else 0.05
    np.testing.assert_allclose(levels_db(made), levels_db(request_.textures), atol=tolerance)
    louder = replace(request_, textures=10 * request_.textures)
    np.testing.assert_allclose(baseline.sample(louder, seeded()), 10 * made, atol=1e-6 * np.abs(made).max())
    first = BaselineRequest(request_.ratings[:4], request_.textures[:4])
    np.testing.assert_allclose(baseline.sample(first, seeded()), made[:4], atol=1e-12)
    silent = replace(request_, textures=np.zeros_like(request_.textures))
    assert (rms(baseline.sample(silent, seeded())) < 1e-12).all()


def test_mean_spectrum_has_the_mean_levels_of_the_training_set(training, reference):
    made = MeanSpectrum().fit(training).sample(BaselineRequest(np.zeros((100, 3))), seeded())
    # Welch's bins smear the filter's edge at 20 Hz and the mean of noisy decibels is low: 0.2 dB each
    difference = band_levels_db(made, DEVICE_RATE).mean(0) - band_levels_db(reference, DEVICE_RATE).mean(0)
    np.testing.assert_allclose(difference[1:], 0, atol=0.5)
    assert abs(difference[0]) < 1.5


def test_linear_prediction_finds_the_spectrum_of_an_autoregressive_process():
    rate, samples = 2500, 20_000
    poles = [0.97 * np.exp(2j * np.pi * 150 / rate), 0.93 * np.exp(2j * np.pi * 500 / rate)]
    denominator = np.poly([*poles, *np.conj(poles)]).real
    rows = signal.lfilter([1], denominator, seeded().normal(size=(6, samples + 1000)))[:, 1000:]
    grid = envelopes.Grid(samples, rate)
    expected = np.abs(signal.freqz([1], denominator, grid.frequencies, fs=rate)[1]) ** 2
    difference = 10 * np.log10(envelopes.lpc_density(rows, grid) / expected)
    difference -= difference.mean(-1, keepdims=True)
    # 20 coefficients from 20,000 samples: relative error of the density about sqrt(2 * 20 / 20000) = 0.2 dB
    assert rms(difference).max() < 0.5


def test_nine_band_noise_has_the_nine_levels(training, held_out):
    wanted = band_levels_db(held_out, DEVICE_RATE)
    wanted[0] += 12 * (-1) ** np.arange(9)  # an envelope as jagged as gratings make it
    density = envelopes.nine_band_density(wanted, GRID)
    edges = np.geomspace(20, 1000, 10)
    width = DEVICE_RATE / SEGMENT_SAMPLES
    for band in range(9):
        inside = (GRID.frequencies >= edges[band]) & (GRID.frequencies < edges[band + 1])
        np.testing.assert_allclose(10 * np.log10(density[:, inside].sum(-1) * width), wanted[:, band], atol=1e-3)
    request = BaselineRequest(np.zeros((100, 3)), held_out)
    made = default_baselines(1, 1)["nine_band_noise"].fit(training).sample(request, seeded())
    # under a Hann window 18 bins of noise, the lowest band, scatter by 1.4 dB; mean error over nine such bands 0.56 dB
    assert nine_band_error_db(made, held_out, DEVICE_RATE).mean() < 0.7


@pytest.mark.parametrize("bits", (0.5, 1.0, 3.0))
def test_noise_of_decimation_matches_the_bits_and_has_the_mean_colour(bits, training, request_):
    exact, noisy = (Decimated(1500, b).fit(training) for b in (inf, bits))
    clean, made = exact.sample(request_, seeded()), noisy.sample(request_, seeded())
    inside = (GRID.frequencies > 30) & (GRID.frequencies < 750)
    mean = 10 ** (envelopes.spectrum_db(training.textures, GRID)[1].mean(0) / 10)
    colour = np.interp(GRID.frequencies, np.arange(20, 1001, 5), mean)[inside]
    noise, texture = (
        signal.periodogram(rows, DEVICE_RATE)[1][:, GRID.bins][:, inside] / colour for rows in (made - clean, clean)
    )
    # 1/2 log2(1 + SNR) = bits, in whitened power: 1200 bins give it to 3 %, or 0.06 bits
    np.testing.assert_allclose(0.5 * np.log2(1 + texture.mean(-1) / noise.mean(-1)), bits, atol=0.15)
    low, high = np.array_split(noise.mean(0), 2)
    assert low.mean() / high.mean() == pytest.approx(1, abs=0.1)


def test_latent_rate_is_its_formula():
    latents = seeded().normal(size=(40, 2, 500)) * np.array([np.sqrt(3), np.sqrt(15)])[:, None] * 0.1
    assert latent_rate(latents, 0.1) == pytest.approx(1.5, abs=0.02)
    assert latent_rate(np.full((2, 3, 4), 7.0), 0.1) == 0
    for sigma in (0.0, nan, -1.0):
        with pytest.raises(ValueError, match="`sigma` must be .*above 0"):
            latent_rate(latents, sigma)


def test_knn_blends_decibels_and_log_friction_by_distance(three_surfaces):
    knn = KnnBlend(2).fit(three_surfaces)
    request = BaselineRequest(np.array([[0.0, 0, 0], [-1, 0, 0], [0.5, nan, nan]]))
    # halfway; at a surface, where the other weighs 0.1 / 2 as much; three times as near to the second
    weights = np.array([[0.5, 0.5], np.array([20, 1]) / 21, [0.25, 0.75]])
    made = band_levels_db(knn.sample(request, seeded()), DEVICE_RATE)
    wanted = weights @ band_levels_db(three_surfaces.textures, DEVICE_RATE)[:2]
    # Gaussian noise in narrow bands against single noisy segments: 1 to 2 dB where bands are narrow; tilts differ by 20
    np.testing.assert_allclose(made[:, 3:], wanted[:, 3:], atol=2.0)
    friction = knn.friction_coefficients(request, seeded())
    np.testing.assert_allclose(friction, np.exp(weights @ np.log([0.2, 0.8])))


def test_knn_without_any_rating_draws_surfaces_at_random(three_surfaces):
    request = BaselineRequest(np.full((90, 3), nan))
    knn = KnnBlend(1).fit(three_surfaces)
    levels = levels_db(knn.sample(request, seeded()))
    nearest = np.abs(levels[:, None] - [-50, -30, -20]).argmin(-1)
    assert (np.bincount(nearest, minlength=3) > 15).all()  # 30 expected, standard deviation 4.5
    np.testing.assert_allclose(knn.friction_coefficients(request, seeded()), np.array([0.2, 0.8, 5.0])[nearest])
    every = KnnBlend(9).fit(three_surfaces).friction_coefficients(request, seeded())
    np.testing.assert_allclose(every, np.exp(np.log([0.2, 0.8, 5.0]).mean()))


def slope_on_rating(axis, quantity, baseline):
    """How much `quantity` (of textures, friction) changes on the mean when one rating goes from -1 to 1, a unit."""
    ratings = np.zeros((60, 3))
    ratings[:, axis] = np.repeat([-1, 1], 30)
    request = BaselineRequest(ratings)
    values = quantity(baseline.sample(request, seeded()), baseline.friction_coefficients(request, seeded()))
    return (values[30:].mean() - values[:30].mean()) / 2


def tilt(textures, _):
    return np.polyfit(np.log2(np.geomspace(25, 800, 9)), band_levels_db(textures, DEVICE_RATE).T, 1)[0]


# Nearest neighbours flatten a law, because in sparse corners they lie rather towards the middle.
@pytest.mark.parametrize(("baseline", "tolerance"), ((KnnBlend(), 0.35), (Ridge(), 0.1)))
def test_ratings_move_level_tilt_and_friction_as_planted(baseline, tolerance, planted):
    baseline.fit(planted)
    assert slope_on_rating(0, lambda t, _: levels_db(t), baseline) == pytest.approx(6, rel=tolerance)
    assert slope_on_rating(1, tilt, baseline) == pytest.approx(-2, rel=tolerance)
    assert slope_on_rating(2, lambda _, mu: np.log(mu), baseline) == pytest.approx(-0.4, rel=tolerance)


def test_ridge_draws_what_is_not_specified_given_the_rest(planted):
    ridge = Ridge().fit(planted)
    ratings = np.full((600, 3), nan)
    ratings[300:, 0] = 2.0
    request = BaselineRequest(ratings)
    tilts, friction = tilt(ridge.sample(request, seeded()), None), ridge.friction_coefficients(request, seeded())
    real = tilt(planted.textures, None)
    # nothing specified: spread as the training surfaces; 300 draws give it to 4 %, the mean to 0.1
    assert tilts[:300].mean() == pytest.approx(real.mean(), abs=0.4)
    assert tilts[:300].std() == pytest.approx(real.std(), rel=0.15)
    assert np.log(friction).std() == pytest.approx(np.log(planted.friction_coefficients).std(), rel=0.15)
    # bumpiness given roughness 2 is N(1.2, 0.8), -2 dB an octave a unit; 80 surfaces give the correlation to 0.07
    assert tilts[300:].mean() - tilts[:300].mean() == pytest.approx(-2 * 1.2, abs=0.8)
    assert tilts[300:].std() == pytest.approx(2 * 0.8, abs=0.4)


@pytest.mark.parametrize("baseline", (KnnBlend(1), Ridge()))
def test_surfaces_without_ratings_or_friction_are_left_out(baseline, planted):
    strange = planted.surface_ids >= 60
    ratings, textures = planted.ratings.copy(), planted.textures.copy()
    ratings[strange, 2], textures[strange] = nan, 1e3 * textures[strange]
    names = ("textures", "ratings", "friction_coefficients", "surface_ids")
    known = {name: getattr(planted, name)[~strange] for name in names}
    request = BaselineRequest(np.array([[0, 0, -1], [0, 0, 1], [nan, nan, nan]]))
    expected = baseline.fit(replace(planted, **known)).sample(request, seeded())
    made = baseline.fit(replace(planted, textures=textures, ratings=ratings)).sample(request, seeded())
    np.testing.assert_array_equal(made, expected)

    half = np.where(planted.surface_ids % 2, planted.friction_coefficients, nan)
    some = baseline.fit(replace(planted, friction_coefficients=half)).friction_coefficients(request, seeded())
    if isinstance(baseline, Ridge):  # half of the surfaces show a law without scatter as well
        np.testing.assert_allclose(np.log(some[:2]), [-0.1, -0.9], atol=0.05)
    none = baseline.fit(replace(planted, friction_coefficients=np.full(240, nan)))
    assert np.isnan(none.friction_coefficients(request, seeded())).all()
    assert np.isfinite(none.sample(request, seeded())).all()


def test_another_rate_and_band():
    """BioTac slides: 2.2 kHz, from 30 Hz, shorter, without ratings."""
    rng = seeded()
    grid = envelopes.Grid(2100, 2200, (30.0, 1000.0))
    textures = grid.noise(np.ones((20, len(grid.bins))), rng, np.ones(20))
    unrated, unknown = np.full((20, 3), nan), np.full(20, nan)
    training = TrainingTextures(textures, unrated, unknown, np.repeat(np.arange(5), 4), 2200, grid.band)
    request = BaselineRequest(unrated, textures, textures)
    for slug, baseline in default_baselines(500, 2.0).items():
        if baseline.knows == "ratings":
            with pytest.raises(ValueError, match="rated on every axis, got none: leave out the baselines that know"):
                baseline.fit(training)
        else:
            made = baseline.fit(training).sample(request, rng)
            assert made.shape == textures.shape and np.isfinite(made).all(), slug


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"ratings": np.zeros(3)}, r"`request.ratings` must have the shape \(n, axes\)"),
        ({"textures": None}, "needs `request.textures`, got None"),
        ({"textures": np.zeros((12, 7))}, "`request.textures` must have the shape"),
        ({"textures": np.full((12, SEGMENT_SAMPLES), inf)}, "`request.textures` must be finite"),
    ],
)
def test_bad_requests_are_refused(change, message, training, request_):
    baseline = default_baselines(500, 2.0)["lpc20"]
    with pytest.raises(ValueError, match="'lpc20' is not fitted. Call `fit"):
        baseline.sample(request_, seeded())
    with pytest.raises(ValueError, match=message):
        baseline.fit(training).sample(replace(request_, **change), seeded())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"textures": np.zeros((150, 100))}, "too short"),
        ({"ratings": np.zeros((149, 3))}, "inconsistent numbers of samples: .150, 149"),
        ({"friction_coefficients": np.zeros(150)}, "must be above 0"),
    ],
)
def test_bad_training_textures_are_refused(change, message, training):
    with pytest.raises(ValueError, match=message):
        MeanSpectrum().fit(replace(training, **change))


def test_random_phases_keep_the_spectrum_and_lose_the_waveform(training, held_out):
    made = PhaseRandomised().fit(training).sample(BaselineRequest(np.zeros((100, 3)), held_out), seeded())
    inside = np.fft.rfftfreq(SEGMENT_SAMPLES, 1 / DEVICE_RATE) < 1050
    spectra = [np.abs(np.fft.rfft(textures))[:, inside] for textures in (made, held_out)]
    np.testing.assert_allclose(*spectra, atol=1e-9 * spectra[1].max())
    # two signals of equal power and no correlation; the mean over 100 scatters by about 0.1 dB
    assert snr_db(made, held_out).mean() == pytest.approx(-10 * np.log10(2), abs=0.3)

"""Failures planted in real (virtual) textures: the metric meant for each must see it, at about FIELD.md's size.

FIELD.md section 3 has its sizes from another reference (860 textures of 50 surfaces) than these tests can afford (192
of 48): bounds are wide, but all lie many intervals away from what real held-out textures get.
"""

from dataclasses import replace

import numpy as np
import pytest
import torch
from report import second_judge
from report.baselines import BaselineRequest, TrainingTextures, default_baselines
from report.sampling import encode
from report.second_judge import SecondJudge, tell_apart
from scipy import signal

from tactile_diffusers import TactileTexturePipeline, bundled_checkpoint
from tactile_diffusers.evaluation import (
    goodness_of_fit,
    out_of_band_ratio_db,
    signed_band_error_db,
    snr_db,
)
from tactile_diffusers.evaluation.judge import Judge, explained, response_matrix
from tactile_diffusers.evaluation.metrics.copying import TrainingEnvelopes, copied_share
from tactile_diffusers.evaluation.metrics.distances import Reference
from tactile_diffusers.evaluation.metrics.diversity import covered, diversity
from tactile_diffusers.evaluation.metrics.embedding import FEATURE_NAMES, SCALE_FLOORS, tactile_features
from tactile_diffusers.evaluation.metrics.rating_effects import reversal
from tactile_diffusers.signal import DEVICE_RATE, SEGMENT_SAMPLES, band_levels_db, band_pass, nine_band_error_db, rms
from tactile_diffusers.virtual import VirtualSurface, steady_exploration


def _takes(surface, count, rng):
    """Textures and friction coefficients of steady slides over one surface."""
    textures, frictions = [], []
    for _ in range(count):
        slide = steady_exploration(rng.uniform(70, 95), rng.uniform(0.45, 0.55), 2.2)
        force = surface.record(slide, rng)
        lateral = force[:, 0].astype(np.float64)
        frictions.append(abs(lateral.mean() / force[:, 2].mean()))
        textures.append(band_pass(lateral, DEVICE_RATE)[2500 : 2500 + SEGMENT_SAMPLES])
    return textures, frictions


@pytest.fixture(scope="module")
def world():
    """48 training and 48 held-out surfaces, four takes each, rated by their percepts."""
    sets = {}
    for name, first in (("train", 0), ("held_out", 48)):
        textures, frictions, ratings = [], [], []
        for number in range(first, first + 48):
            surface = VirtualSurface(seed=5, index=number)
            made = _takes(surface, 4, np.random.default_rng([7, number]))
            textures, frictions = textures + made[0], frictions + made[1]
            ratings += [surface.percepts] * 4
        ids = np.repeat(np.arange(first, first + 48), 4)
        sets[name] = TrainingTextures(np.array(textures), np.array(ratings), np.array(frictions), ids, DEVICE_RATE)
    return sets


@pytest.fixture(scope="module")
def frozen(world):
    return Reference(world["train"].textures, DEVICE_RATE, world["train"].surface_ids)


def _ktd(frozen, textures, groups):
    return frozen.distances(frozen.embed(textures), groups)["ktd"]


def test_real_textures_are_close_to_the_reference(world, frozen):
    held_out = world["held_out"]
    ktd = _ktd(frozen, held_out.textures, held_out.surface_ids)
    # 48 surfaces on either side: their own draw moves it by some tens, below every failure that follows
    assert abs(ktd["mean"]) < 30


def test_half_the_level_is_seen(world, frozen):
    held_out = world["held_out"]
    assert _ktd(frozen, 0.5 * held_out.textures, held_out.surface_ids)["mean"] > 60


def test_lost_lows_are_seen(world, frozen):
    """-6 dB below 100 Hz: FIELD.md has KTD 89; the bands below 100 Hz say -6 dB."""
    held_out = world["held_out"]
    spectra, frequencies = np.fft.rfft(held_out.textures), np.fft.rfftfreq(SEGMENT_SAMPLES, 1 / DEVICE_RATE)
    weak = np.fft.irfft(spectra * np.where(frequencies < 100, 0.5, 1.0), SEGMENT_SAMPLES)
    errors = signed_band_error_db(weak, held_out.textures, DEVICE_RATE, [(20, 60), (400, 650)]).mean(0)
    assert errors == pytest.approx([-6.02, 0.0], abs=0.1)  # leakage of the window at 100 Hz
    assert 40 < _ktd(frozen, weak, held_out.surface_ids)["mean"] < 200
    assert goodness_of_fit(weak, held_out.textures, DEVICE_RATE).mean() > 0.9  # which is why GFC alone will not do


def test_noise_above_1_khz_is_seen(world, frozen):
    """White noise of 1-5 kHz at -30 dB: FIELD.md has KTD 428, and the out-of-band ratio must say -30 dB."""
    held_out = world["held_out"]
    noise = np.random.default_rng(0).standard_normal(held_out.textures.shape)
    noise = signal.sosfiltfilt(signal.butter(8, 1100, "highpass", fs=DEVICE_RATE, output="sos"), noise)
    noise *= (10 ** (-30 / 20) * rms(held_out.textures) / rms(noise))[:, None]
    noisy = held_out.textures + noise
    clean, heard = (out_of_band_ratio_db(t, DEVICE_RATE).mean() for t in (held_out.textures, noisy))
    assert clean < -37 and heard == pytest.approx(-30, abs=1.5)  # the clean textures' own remainder adds up to 1.3 dB
    assert _ktd(frozen, noisy, held_out.surface_ids)["mean"] > 200
    assert nine_band_error_db(noisy, held_out.textures, DEVICE_RATE).mean() < 0.1  # the nine bands cannot see it


def test_one_surface_repeated_is_seen(world, frozen):
    """Mode collapse: FIELD.md has KTD 118; coverage of the real set collapses while each texture is good."""
    held_out = world["held_out"]
    takes, _ = _takes(VirtualSurface(seed=5, index=60), 96, np.random.default_rng(3))
    points, real_points = frozen.embed(np.array(takes)), frozen.embed(held_out.textures)
    precision, recall = covered(points, real_points), covered(real_points, points)
    assert precision > 0.8 and recall < 0.1
    assert _ktd(frozen, np.array(takes), np.arange(96))["mean"] > 80
    real_bands, bands = band_levels_db(held_out.textures, DEVICE_RATE), band_levels_db(np.array(takes), DEVICE_RATE)
    # asked for 48 surfaces, the collapsed generator answers with one: no spread between requests, but between takes
    groups = np.repeat(np.arange(48), 2)
    between = np.stack([bands[groups == group].mean(0) for group in range(48)]).std(0).mean()
    assert (
        between < 2.0 < np.stack([real_bands[held_out.surface_ids == s].mean(0) for s in range(48, 96)]).std(0).mean()
    )
    assert 0.2 < diversity(bands, groups, real_bands, held_out.surface_ids) < 2.0


def test_ignored_conditioning_is_seen(world, frozen):
    """Real textures in the wrong order are as real as ever; only the response says that nobody asked for them."""
    train, held_out = world["train"], world["held_out"]
    judge = Judge.fit(frozen.points, np.log(train.friction_coefficients), train.ratings, train.surface_ids)
    recovered = judge.predict(frozen.embed(held_out.textures), np.log(held_out.friction_coefficients))
    real = response_matrix(recovered, held_out.ratings)
    shuffled = np.random.default_rng(1).permutation(48)
    asked = held_out.ratings.reshape(48, 4, 3)[shuffled].reshape(-1, 3)
    ignored = response_matrix(recovered, asked)
    # a slope over 48 surfaces at random has a standard deviation of about 1 / sqrt(48) = 0.14
    assert (np.diag(real) > 0.4).all() and (np.abs(np.diag(ignored)) < 0.4).all()
    assert np.trace(real) > np.trace(ignored) + 1.0
    noise = default_baselines(600, 2.0)["mean_spectrum"].fit(train)
    made = noise.sample(BaselineRequest(held_out.ratings), np.random.default_rng(2))
    # FIELD.md has 182; here the spectrum is averaged in dB, and so lies in the middle of the set
    assert _ktd(frozen, made, held_out.surface_ids)["mean"] > 40


@pytest.fixture(scope="module")
def copying(world):
    """The training envelopes, and how near to them the held-out textures come: the null."""
    envelopes = TrainingEnvelopes([world["train"].textures], DEVICE_RATE)
    return envelopes, envelopes.nearest_correlation(world["held_out"].textures)


def _decoded(textures, mixed_with=None):
    """What LCTG makes of the layer of their latents that DALE generates; `mixed_with`: of the mean with others'."""
    pipe = TactileTexturePipeline.from_pretrained(bundled_checkpoint())
    pipe.set_progress_bar_config(disable=True)
    latents = encode(pipe, textures, DEVICE_RATE)
    if mixed_with is not None:
        latents = (latents + encode(pipe, mixed_with, DEVICE_RATE)) / 2
    base = pipe.lctg.pad_detail(torch.from_numpy(latents[:, : pipe.lctg.base_channels]))
    generator = torch.Generator().manual_seed(0)
    return pipe.decode(base, torch.from_numpy(np.log(rms(textures))).float(), None, 3, generator).textures


def _moved(textures, rng):
    """Played from another moment up to a second away, softer, with noise 10 dB below."""
    noise = rng.standard_normal(textures.shape) * rms(textures)[:, None]
    shifts = rng.integers(-10_000, 10_000, len(textures))
    moved = [np.roll(row, shift) for row, shift in zip(textures, shifts, strict=True)]
    return 0.5 * (np.stack(moved) + 10 ** (-10 / 20) * noise)


def _at_one_level(textures):
    return textures / rms(textures)[:, None]


MEMORISERS = {
    "training segments": lambda a, b, rng: a,
    "from another moment, softer, with noise": lambda a, b, rng: _moved(a, rng),
    "blends of two": lambda a, b, rng: _at_one_level(a) + _at_one_level(b),
    "blends of seven parts and three": lambda a, b, rng: 0.7 * _at_one_level(a) + 0.3 * _at_one_level(b),
    "takes of one surface": lambda a, b, rng: a,
    "decoded latents": lambda a, b, rng: _decoded(a),
    "decoded means of two latents": lambda a, b, rng: _decoded(a, b),
}


@pytest.mark.parametrize("name", MEMORISERS)
def test_a_memoriser_is_seen(world, copying, name):
    """Generators that know their training by heart: perfect by every distance between sets."""
    (envelopes, null), train, surfaces = copying, world["train"], world["held_out"].surface_ids
    rng = np.random.default_rng(4)
    first, second = rng.permutation(len(train.textures))[:48].reshape(2, 24)
    if name == "takes of one surface":
        first = np.flatnonzero(train.surface_ids == 11)
    copies = MEMORISERS[name](train.textures[first], train.textures[second[: len(first)]], rng)
    values = envelopes.nearest_correlation(copies)
    share, (low, _) = copied_share(values, np.arange(len(values)), null, surfaces)
    assert share > 0.8 and low > 0.5
    # the null beside it: real textures of unseen surfaces, 5 % of 192, with a deviation of 1.6 %
    honest, (low, high) = copied_share(null, surfaces, null, surfaces)
    assert honest == pytest.approx(0.05, abs=0.03) and low <= 0.05 <= high


def test_all_takes_equal_are_seen(world):
    """One good take of each surface, again and again: every texture is real, nothing but the spread of takes tells."""
    held_out = world["held_out"]
    bands = band_levels_db(held_out.textures, DEVICE_RATE).reshape(48, 4, -1)
    own = np.repeat(np.arange(48), 2)
    null = diversity(bands[:, 2:].reshape(96, -1), own, bands[:, :2].reshape(96, -1), own)
    equal = diversity(np.repeat(bands[:, 2], 2, axis=0), own, bands[:, :2].reshape(96, -1), own)
    # the root of the ratio of two variances of 48 pairs x 9 bands that go together: a deviation of 10 % to 15 %
    assert null == pytest.approx(1.0, abs=0.4) and equal == pytest.approx(0.0, abs=1e-9)


def _pairs(textures):
    """Features of the held-out takes, four of each surface: (48, 4, features)."""
    features = tactile_features(textures, DEVICE_RATE)
    return features.reshape(48, 4, features.shape[-1])


def _phase_randomised(textures, rng):
    spectra = np.fft.rfft(textures)
    return np.fft.irfft(np.abs(spectra) * np.exp(2j * np.pi * rng.random(spectra.shape)), textures.shape[-1])


@pytest.mark.parametrize(
    ("name", "told_apart", "over_real", "features"),
    [
        ("envelopes", 0.9, 100, ("correlation_", "envelope_", "modulation_")),
        ("polarity", 0.65, 2, ("slope_skew", "skew")),
    ],
)
def test_what_levels_do_not_show_is_seen(world, frozen, name, told_apart, over_real, features):
    """Stationary noise with the right level in every band; and textures upside down."""
    held_out = world["held_out"]
    wrong = -held_out.textures if name == "polarity" else _phase_randomised(held_out.textures, np.random.default_rng(6))
    other = np.roll(held_out.textures.reshape(48, 4, -1), 1, axis=1).reshape(wrong.shape)
    errors = [nine_band_error_db(made, held_out.textures, DEVICE_RATE).mean() for made in (wrong, other)]
    assert errors[0] < 1.0 < errors[1]  # levels are better than those of another take
    real, fake, surfaces = _pairs(held_out.textures), _pairs(wrong), np.arange(48)
    null, _ = tell_apart(real[:, :2], real[:, 2:], surfaces, SCALE_FLOORS)
    found, contributions = tell_apart(real[:, :2], fake[:, 2:], surfaces, SCALE_FLOORS)
    # shares of 48 surfaces, each of 4 pairs: a deviation of 0.5 / sqrt(48) = 0.07 at most
    assert null.mean() == pytest.approx(0.5, abs=0.15) and found.mean() > told_apart
    assert (found - null).mean() > 2 * (found - null).std() / np.sqrt(48)
    given_away = [k for k in np.argsort(-contributions.mean(0))[:2] if contributions.mean(0)[k] > 0]
    assert given_away and all(FEATURE_NAMES[k].startswith(features) for k in given_away)
    points, null_points, own = frozen.embed(wrong), frozen.embed(held_out.textures), held_out.surface_ids
    excess = frozen.distances(points, own, (null_points, own))["ktd_excess"]
    assert excess["interval"][0] > over_real
    assert frozen.distances(null_points, own, (null_points, own))["ktd_excess"]["interval"] == [0, 0]


def test_a_judge_of_its_own_test_surfaces_is_refused(world, monkeypatch):
    """Fitted on the pairs that it then judges, it tells real takes from real takes; on other surfaces it does not."""
    real, surfaces = _pairs(world["held_out"].textures), np.arange(48)
    null, _ = tell_apart(real[:, :2], real[:, 2:], surfaces, SCALE_FLOORS)
    monkeypatch.setattr(second_judge, "C", 10.0)  # the penalty would keep it from that: all but lifted
    judge = SecondJudge.fit(real[:, :2], real[:, 2:], surfaces, SCALE_FLOORS)
    for names in (surfaces, surfaces + 100):  # also under other names
        with pytest.raises(ValueError, match="fitted on .* of these surfaces"):
            judge.contributions(real[:, :2], names)
    blind = replace(judge, seen=frozenset())
    first, second = (blind.contributions(part, surfaces).sum(-1) for part in (real[:, :2], real[:, 2:]))
    gamed = (second[:, :, None] > first[:, None]).mean()
    assert gamed > 0.65 and null.mean() == pytest.approx(0.5, abs=0.15) and gamed > null.mean() + 0.1


def test_ratings_judged_by_a_judge_of_the_same_surfaces_are_flattered(world, frozen):
    """The judge of ratings: its R² on surfaces that it was fitted on is not that on unseen ones, which is reported."""
    train, held_out = world["train"], world["held_out"]
    points = frozen.embed(held_out.textures)
    own = (points, np.log(held_out.friction_coefficients), held_out.ratings)
    known = (frozen.points, np.log(train.friction_coefficients), train.ratings)
    honest = explained(Judge.fit(*known, train.surface_ids).predict(*own[:2]), own[2])
    gamed = explained(Judge.fit(*own, held_out.surface_ids).predict(*own[:2]), own[2])
    assert (gamed > honest).all() and gamed.mean() > honest.mean() + 0.05


def test_a_response_that_turns_back_is_seen():
    """Beyond ±2 the response of one model goes on, of one is held, and of one turns back by half."""
    ratings = np.array([-6.0, -3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0, 6.0])
    held = 3.0 * np.clip(ratings, -2, 2)
    assert reversal(ratings, 3.0 * ratings) == reversal(ratings, held) == 0
    turned = held - 6.0 * (ratings > 2)
    assert reversal(ratings, turned) == pytest.approx(0.5) == reversal(ratings, -turned)


def test_waveform_metrics_reward_silence(world):
    """The reason for all of the above: 0 dB for silence, -3 dB for another take, which feels the same."""
    held_out = world["held_out"]
    assert snr_db(np.zeros_like(held_out.textures), held_out.textures) == pytest.approx(0, abs=1e-9)
    first, second = held_out.textures[0::4], held_out.textures[1::4]
    # log of a ratio of powers that scatter from take to take: not exactly -3.01
    assert snr_db(second, first).mean() == pytest.approx(-3.0, abs=0.6)

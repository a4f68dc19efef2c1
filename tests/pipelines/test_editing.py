"""`TactileTextureEditPipeline`: what is asked for moves, what is not stays, what is known is kept bit for bit."""

import numpy as np
import pytest
import torch

from tactile_diffusers import (
    RatingEstimator,
    TactileTextureEditPipeline,
    TactileTexturePipeline,
    TactileTexturePipelineOutput,
    bundled_checkpoint,
)
from tactile_diffusers.pipelines.filling import guessed, joined, lay_out, parse_mask, share_drawn
from tactile_diffusers.signal import rms

RATE = 10_000
SOURCE = [0.2, -0.1, 0.3]


@pytest.fixture
def edit(make_pipeline):
    return TactileTextureEditPipeline.from_pipe(make_pipeline())


@pytest.fixture(scope="module")
def bundled():
    pipe = TactileTexturePipeline.from_pretrained(bundled_checkpoint())
    pipe.set_progress_bar_config(disable=True)
    return TactileTextureEditPipeline.from_pipe(pipe)


@pytest.fixture(scope="module")
def recording(bundled):
    """Two generated textures of 1.6 s, which the bundled models know, and their friction coefficients."""
    pipe = TactileTexturePipeline.from_pipe(bundled)
    out = pipe([SOURCE, [0.0, 0.5, -0.5]], generator=torch.Generator().manual_seed(5))
    return out.textures, out.friction_coefficient


def test_from_pipe_both_ways_and_a_saved_one_is_loaded(edit, tmp_path, pink_noise, seeded):
    back = TactileTexturePipeline.from_pipe(edit)
    assert type(back) is TactileTexturePipeline and back.lctg is edit.lctg and back.scheduler is not edit.scheduler
    edit.save_pretrained(tmp_path / "saved")
    loaded = TactileTextureEditPipeline.from_pretrained(tmp_path / "saved")
    loaded.set_progress_bar_config(disable=True)
    texture = pink_noise(4096, RATE)[0]
    options = {"ratings": {"roughness": 0.5}, "source_ratings": SOURCE}
    first, second = (pipe(texture, RATE, **options, generator=seeded(1)).textures for pipe in (edit, loaded))
    np.testing.assert_array_equal(first, second)
    assert type(TactileTexturePipeline.from_pretrained(tmp_path / "saved")) is TactileTexturePipeline


def test_no_strength_is_the_reconstruction_and_all_of_it_a_fresh_take(bundled, recording, seeded):
    textures, friction = recording
    options = {"ratings": {"roughness": 0.5}, "rating_scale": "difference", "source_ratings": SOURCE}
    none = bundled(textures, RATE, strength=0, generator=seeded(1), friction_coefficient=friction, **options)
    same = bundled.reconstruct(textures, RATE, generator=seeded(1))
    np.testing.assert_array_equal(none.textures, same.textures)
    np.testing.assert_array_equal(none.friction_coefficient, friction)
    full = bundled(textures, RATE, strength=1, generator=seeded(1), **options)
    target = np.float32(SOURCE) + np.float32([0.5, 0, 0])
    fresh = TactileTexturePipeline.from_pipe(bundled)([target] * 2, generator=seeded(1))
    for name in ("textures", "friction_coefficient", "level"):
        np.testing.assert_array_equal(full[name], fresh[name])
    # and the way there has no step at its end
    near = bundled(textures, RATE, strength=0.9999, generator=seeded(1), friction_coefficient=friction, **options)
    assert _correlation(near.textures, full.textures).min() > 0.98


def _correlation(a, b):
    return (a * b).mean(-1) / rms(a) / rms(b)


def test_likeness_falls_and_the_change_grows_with_strength(bundled, recording, seeded):
    textures, friction = recording
    estimates, likeness = [], []
    for strength in (0, 0.3, 0.6, 0.95):
        out = bundled(
            *(textures, RATE, {"slipperiness": -0.6}, strength, "difference"),
            friction_coefficient=friction,
            generator=seeded(2),
        )
        likeness.append(_correlation(out.textures, textures).mean())
        estimates.append(bundled.estimate_ratings(out.textures, RATE, out.friction_coefficient).mean(0)[2])
        assert out.textures.shape == textures.shape and out.sampling_rate == RATE
    assert (np.diff(likeness) < 0).all() and likeness[0] > 0.7 > 0.4 > likeness[-1]
    assert (np.diff(estimates) < 0).all() and estimates[-1] - estimates[0] < -0.2


def test_absolute_ratings_keep_the_axes_that_are_open(bundled, recording, seeded):
    texture = recording[0][:1]
    relative, absolute = (
        bundled(texture, RATE, {"roughness": value}, rating_scale=scale, source_ratings=SOURCE, generator=seeded(0))
        for value, scale in ((0.5, "difference"), (SOURCE[0] + 0.5, "z"))
    )
    np.testing.assert_allclose(absolute.textures, relative.textures, atol=1e-5 * np.abs(texture).max())  # 0.2 + 0.5


def test_without_friction_nothing_is_said_of_it(bundled, recording, seeded):
    out = bundled(recording[0], RATE, {"slipperiness": 0.5}, 0.5, "difference", generator=seeded(0))
    assert np.isfinite(out.textures).all() and np.isnan(out.friction_coefficient).all()


def test_a_list_of_generators_equals_single_calls(edit, pink_noise, seeded):
    textures = pink_noise(4096, RATE, count=2)
    options = {"ratings": {"roughness": 0.5}, "source_ratings": SOURCE}
    together = edit(textures, RATE, generator=seeded([1, 2]), **options).textures
    for row in range(2):
        alone = edit(textures[row], RATE, generator=seeded(row + 1), **options).textures[0]
        np.testing.assert_allclose(together[row], alone, atol=1e-3 * rms(alone))  # batched sums, float32


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("rate", [RATE, 4000])
def test_what_is_not_masked_stays_bit_for_bit(edit, pink_noise, seeded, dtype, rate):
    texture = pink_noise(round(0.7 * rate), rate)[0].astype(dtype)
    mask = np.zeros(len(texture), bool)
    mask[round(0.3 * rate) : round(0.35 * rate)] = True
    broken = np.where(mask, np.nan, texture).astype(dtype)
    out = edit(broken, rate, mask=mask, source_ratings=SOURCE, generator=seeded(0))
    assert isinstance(out, TactileTexturePipelineOutput) and out.sampling_rate == rate
    made = out.textures[0]
    assert made.dtype == dtype and np.isfinite(made).all()
    np.testing.assert_array_equal(made[~mask], texture[~mask])
    again = edit(broken, rate, mask=[(0.3, 0.35)], source_ratings=SOURCE, generator=seeded(0))
    np.testing.assert_array_equal(again.textures[0], made)


def test_continued_and_closed(edit, pink_noise, seeded):
    texture = pink_noise(4096, RATE)[0]
    common = {"source_ratings": SOURCE, "generator": seeded(0)}
    longer = edit(texture, RATE, continue_s=0.5, **common).textures[0]
    assert len(longer) == 4096 + 5000
    np.testing.assert_array_equal(longer[:4096], texture)
    loop = edit(texture, RATE, loop=True, **common).textures[0]
    assert len(loop) == 4096
    np.testing.assert_array_equal(loop[512:-512], texture[512:-512])
    closed = edit(texture, RATE, continue_s=0.5, loop=True, **common).textures[0]
    np.testing.assert_array_equal(closed[:4096], texture)
    largest = np.abs(np.diff(texture)).max()
    for made in (loop, closed):  # where end and beginning meet, no larger step than inside
        assert abs(made[0] - made[-1]) < largest
    assert abs(longer[4096] - longer[4095]) < largest
    assert abs(texture[0] - texture[-1]) > largest  # which the recording's own would be


def test_what_is_drawn_continues_the_known_samples():
    """A gap in a sine is what the sine's neighbours say, whatever is drawn, as far as they reach."""
    time = np.arange(4000) / 2000
    texture, missing = np.sin(2 * np.pi * 60 * time), np.zeros(4000, bool)
    missing[2000:2020] = True
    drawn = 0.1 * np.random.default_rng(0).standard_normal(4000)
    drawn = np.convolve(drawn, np.ones(8) / 8, mode="same")
    result = joined(texture, drawn, missing, guessed(texture, missing), 2000)
    np.testing.assert_array_equal(result[~missing], texture[~missing])
    assert rms((result - texture)[missing]) < 0.2 * rms(texture)  # 0.7 without: nothing of the drawn is the sine
    assert rms((drawn - texture)[missing]) > 0.9 * rms(texture)


def test_gaps_at_both_ends_and_all_over():
    rng = np.random.default_rng(1)
    texture, missing = np.convolve(rng.standard_normal(3000), np.ones(5) / 5, mode="same"), np.zeros(3000, bool)
    missing[:100] = missing[-50:] = missing[500:520] = missing[530:560] = True
    broken = np.where(missing, np.nan, texture)
    guess = guessed(broken, missing)
    assert np.isfinite(guess).all() and 0.3 < rms(guess[missing]) / rms(texture) < 2
    result = joined(broken, rng.standard_normal(3000) / 5, missing, guess, 2000)
    assert np.isfinite(result).all()
    np.testing.assert_array_equal(result[~missing], texture[~missing])
    share = share_drawn(missing, 30, 2)  # frames of 100 samples, of which the first alone is missing as a whole
    assert share[0] == 0.5 and (share[1:] == 0).all()


def test_a_loop_is_laid_out_around_its_seam():
    texture = np.arange(10_000.0)
    rolled, missing, shift = lay_out(texture, RATE, None, None, True)
    np.testing.assert_array_equal(np.roll(rolled, shift), texture)
    assert missing.sum() == 2000 and not missing[0] and not missing[-1]
    np.testing.assert_array_equal(np.flatnonzero(np.roll(missing, shift)), [*range(1000), *range(9000, 10_000)])


def test_masks_are_read():
    expected = np.zeros(100, bool)
    expected[10:20] = True
    for mask in ([(0.1, 0.2)], (0.1, 0.2), expected, np.array([[0.1, 0.2]])):
        np.testing.assert_array_equal(parse_mask(mask, 100, 100), expected)


def test_variations_differ_from_the_recording_and_from_each_other(bundled, recording, seeded):
    out = bundled.variations(recording[0][0], RATE, n=3, generator=seeded([1, 2, 3]))
    assert out.textures.shape == (3, 16384)
    rows = np.concatenate([recording[0][:1], out.textures])
    alike = [_correlation(a, b) for k, a in enumerate(rows) for b in rows[:k]]
    assert max(alike) < 0.6
    assert abs(out.level - np.log(rms(recording[0][0]))).max() < 0.5  # a surface has its level
    with pytest.raises(ValueError, match="`texture` must be one"):
        bundled.variations(recording[0], RATE)


@pytest.mark.parametrize(
    "options, words",
    [
        ({"strength": 1.5}, "`strength`"),
        ({"strength": float("nan")}, "`strength`"),
        ({"ratings": [1, 2]}, "`ratings` must have 3"),
        ({"ratings": [[0, 0, 0]] * 2}, "`ratings` must be those of one"),
        ({"ratings": {"roughness": 1}, "rating_scale": "difference", "source_ratings": None}, "give `source_ratings`"),
        ({"source_ratings": [9, 0, 0]}, "`source_ratings`"),
        ({"source_ratings": [[0, 0, 0]] * 3}, "`source_ratings`"),
        ({"rating_scale": "stars"}, "`rating_scale`"),
        ({"friction_coefficient": [1.0, 2.0]}, "`friction_coefficient`"),
        ({"friction_coefficient": -0.5}, "`friction_coefficient` must be finite and above 0"),
        ({"mask": [(0.1, 9.0)]}, "`mask` must lie within"),
        ({"mask": [(0.2, 0.1)]}, "`mask` must lie within"),
        ({"mask": np.ones(7, bool)}, "`mask` must have one bool"),
        ({"mask": "all"}, "`mask` must be bool"),
        ({"mask": [(0.0, 0.4096)]}, "`mask` leaves"),
        ({"mask": [(0.1, 0.2)], "ratings": SOURCE}, "in a call before"),
        ({"continue_s": 0}, "`continue_s`"),
        ({"continue_s": 7200}, "`continue_s`"),
        ({"output_type": "latent"}, "`output_type`"),
        ({"num_inference_steps": 0}, "`num_inference_steps`"),
        ({"generator": 3}, "`generator`"),
    ],
)
def test_impossible_arguments_are_refused_by_name(edit, pink_noise, calls_of, options, words):
    calls = calls_of(edit.lctg)
    with pytest.raises(ValueError, match=words):
        edit(pink_noise(4096, RATE)[0], RATE, **{"source_ratings": SOURCE, **options})
    assert not calls


def test_recordings_that_are_none_are_refused(edit, pink_noise):
    texture = pink_noise(4096, RATE)[0]
    for made, rate, words in (
        (texture[:2000], RATE, "at least 0.25 s"),
        (1e-5 * texture, RATE, "too quiet"),
        (0 * texture, RATE, "too quiet"),
        (1e3 * texture, RATE, "too loud.*Calibrate"),
        (np.sin(2 * np.pi * 5 * np.arange(4096) / RATE), RATE, "Band-pass it"),
        (np.where(np.arange(4096) == 7, np.nan, texture), RATE, "NaN or infinite"),
        (texture, 1000, "`sampling_rate`"),
        (texture, None, "`sampling_rate`"),
        ("texture", RATE, "`texture` must be real"),
    ):
        with pytest.raises(ValueError, match=words):
            edit(made, rate, {"roughness": 0.5}, source_ratings=SOURCE)


def test_no_dale_no_edit(make_pipeline, pink_noise):
    with pytest.raises(ValueError, match="no `dale`"):
        TactileTextureEditPipeline.from_pipe(make_pipeline(dale=False))(pink_noise(4096, RATE)[0], RATE)


@pytest.mark.parametrize("strength", [0.5, 1])
def test_an_edit_warns_of_ratings_that_its_caller_gave(make_pipeline, pink_noise, recorded_warnings, strength):
    statistics = {"range": [[-1.5, 1.5]] * 3}
    edit = TactileTextureEditPipeline.from_pipe(make_pipeline(dale_config={"rating_statistics": statistics}))
    estimate = lambda *given: np.array([[0.0, 2.5, 5.4]], np.float32)  # noqa: E731
    edit.register_modules(rating_estimator=RatingEstimator(edit.dale.channel_groups, width=8))
    edit._estimate, texture = estimate, pink_noise(4096, RATE)[0]
    for options, words in (
        ({"ratings": {"roughness": 0.5}}, ""),
        ({"mask": [(0.1, 0.2)]}, ""),
        ({"ratings": {"roughness": 2.0}}, "roughness +2.00"),
        ({"ratings": {"bumpiness": 0.5}, "rating_scale": "difference"}, "bumpiness +3.00"),
        ({"ratings": {"roughness": 0.5}, "source_ratings": {"slipperiness": -3}}, "slipperiness -3.00"),
    ):
        with recorded_warnings() as found:
            edit(texture, RATE, strength=strength, **options)
        assert len(found) == bool(words), (options, found)
        assert not words or (words in found[0] and found[0].count("held at") == 1)

"""`pipe.estimate_ratings` and its optional component: from textures to ratings, saved and loaded."""

import numpy as np
import pytest
import torch

from tactile_diffusers import RatingEstimator, TactileTexturePipeline
from tactile_diffusers.training.recalibration import Recalibration

RATE = 10_000
SAMPLES = 2048  # of the tiny pipeline's segment


@pytest.fixture
def pipe(make_pipeline, randomized):
    made = make_pipeline()
    made.register_modules(rating_estimator=randomized(RatingEstimator(made.dale.channel_groups, width=8), 5).eval())
    return made


@pytest.fixture
def textures(pink_noise):
    return pink_noise(SAMPLES, RATE, count=3, seed=1) * np.array([[0.5], [1.0], [2.0]])


def test_a_row_of_ratings_for_each_texture(pipe, textures):
    made = pipe.estimate_ratings(textures, RATE, 0.6)
    assert made.shape == (3, 3) and made.dtype == np.float32 and np.isfinite(made).all()
    assert np.abs(made[0] - made[1]).max() > 0.01
    # float32; batched and single convolutions add in another order
    np.testing.assert_allclose(pipe.estimate_ratings(textures[1], RATE, 0.6), made[1:2], atol=1e-4)
    np.testing.assert_array_equal(pipe.estimate_ratings(torch.from_numpy(textures), RATE, 0.6), made)


def test_it_is_the_estimator_of_the_packed_state(pipe, textures):
    made = pipe.encode(textures, RATE)
    friction = torch.tensor([0.3, 0.6, 1.2])
    with torch.no_grad():
        pooled = pipe.dale.pool_state(pipe.dale.pack(made.latents, made.level, friction))
        expected = pipe.rating_estimator(pooled, torch.ones(3, dtype=torch.bool))
    np.testing.assert_allclose(pipe.estimate_ratings(textures, RATE, friction), expected, atol=1e-6)  # float32


def test_unknown_friction_is_ignored(pipe, textures):
    unknown = pipe.estimate_ratings(textures, RATE)
    np.testing.assert_array_equal(pipe.estimate_ratings(textures, RATE, float("nan")), unknown)
    np.testing.assert_array_equal(pipe.estimate_ratings(textures, RATE, [np.nan] * 3), unknown)
    some = pipe.estimate_ratings(textures, RATE, [np.nan, 0.3, np.nan])
    np.testing.assert_array_equal(pipe.estimate_ratings(textures, RATE, [None, 0.3, None]), some)
    np.testing.assert_array_equal(some[[0, 2]], unknown[[0, 2]])
    # not the same as the mean friction of training, which is known
    mean = np.exp(pipe.dale.config.log_friction_mean)
    assert all(np.abs(pipe.estimate_ratings(textures, RATE, value) - unknown).max() > 1e-3 for value in (0.3, mean))


def test_frames_beyond_whole_patches_are_left_out(make_pipeline, randomized, pink_noise):
    pipe = make_pipeline(dale_config={"patch_size": 4})
    pipe.register_modules(rating_estimator=randomized(RatingEstimator(pipe.dale.channel_groups, width=8), 5).eval())
    texture = pink_noise(2350, RATE)
    assert pipe.encode(texture, RATE).latents.shape[-1] % 4
    assert np.isfinite(pipe.estimate_ratings(texture, RATE, 0.5)).all()


def test_a_checkpoint_without_an_estimator_says_so(make_pipeline, textures):
    for pipe in (make_pipeline(), make_pipeline(dale=False)):
        with pytest.raises(ValueError, match="no `rating_estimator`: examples/train_dale.py trains one"):
            pipe.estimate_ratings(textures, RATE)


def test_it_is_optional_and_may_be_left_out_on_loading(make_pipeline, pipe, textures, tmp_path):
    make_pipeline().save_pretrained(tmp_path / "without")
    assert not (tmp_path / "without" / "rating_estimator").exists()
    pipe.save_pretrained(tmp_path / "with")
    for folder, options in (("without", {}), ("with", {"rating_estimator": None})):
        again = TactileTexturePipeline.from_pretrained(tmp_path / folder, **options)
        assert again.rating_estimator is None and again.dale is not None


def test_an_adapted_checkpoint_says_that_its_estimator_was_not(pipe, textures, recorded_warnings):
    from tactile_diffusers.models.calibration import own_calibration

    pipe.dale.register_to_config(calibration=own_calibration(pipe.dale.config, pipe.dale.num_scalars))
    with recorded_warnings() as found:
        pipe.estimate_ratings(textures, RATE, 0.6)
        pipe.estimate_ratings(textures, RATE, 0.6)
    assert len(found) == 1 and "The checkpoint was adapted" in found[0]


def test_a_recalibration_leaves_estimates_as_they_are(make_pipeline, randomized, textures, tmp_path):
    pipe = make_pipeline(dale_config={"in_channels": 9, "level_channels": 2, "departure_std": [0.5, 0.3]})
    dale, size = pipe.dale, pipe.dale.num_scalars
    pipe.register_modules(rating_estimator=randomized(RatingEstimator(dale.channel_groups, width=8), 5).eval())
    before = pipe.estimate_ratings(textures, RATE, 0.6)
    shapes, nothing = (
        (np.full(2, 0.2), np.full(2, 1.5), np.array([1.5, 0.8])),
        (np.zeros((3, size)), np.zeros((6, size))),
    )
    change = Recalibration(1.0, np.zeros(size), *nothing, np.full(size, 1.5), np.zeros(3), np.eye(3), 3, shapes)
    for _ in range(2):
        change.apply(dale)
        np.testing.assert_array_equal(pipe.estimate_ratings(textures, RATE, 0.6), before)
    dale.save_pretrained(tmp_path)
    pipe.register_modules(dale=type(dale).from_pretrained(tmp_path))
    np.testing.assert_allclose(pipe.estimate_ratings(textures, RATE, 0.6), before, atol=1e-6)  # float32


@pytest.mark.parametrize("friction", [0, -0.5, np.inf, [0.5, 0.5, -np.inf], torch.tensor(-1.0)])
def test_friction_coefficients_that_are_none_are_refused_before_any_work(pipe, textures, monkeypatch, friction):
    monkeypatch.setattr(pipe, "encode", None)
    with pytest.raises(ValueError, match="`friction_coefficient` must be finite and above 0, or NaN = unknown, got"):
        pipe.estimate_ratings(textures, RATE, friction)


def test_a_friction_coefficient_in_per_cent_is_warned_of(pipe, textures, recorded_warnings):
    with recorded_warnings() as found:
        pipe.estimate_ratings(textures, RATE, [0.5, None, 50])
        pipe.estimate_ratings(textures, RATE, 3.0)
    assert len(found) == 1 and "`friction_coefficient` 50 is more than skin has" in found[0]


@pytest.mark.parametrize("samples", [1, 60, 200])
def test_a_texture_shorter_than_a_patch_is_estimated(make_pipeline, randomized, pink_noise, samples):
    pipe = make_pipeline(dale_config={"patch_size": 4})
    pipe.register_modules(rating_estimator=randomized(RatingEstimator(pipe.dale.channel_groups, width=8), 5).eval())
    texture = pink_noise(2048, RATE)[:, :samples]
    assert pipe.encode(texture, RATE).latents.shape[-1] < 5
    assert np.isfinite(pipe.estimate_ratings(texture, RATE, 0.5)).all()

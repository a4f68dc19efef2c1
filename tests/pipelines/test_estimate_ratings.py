"""`pipe.estimate_ratings` and its optional component: from textures to ratings, saved and loaded."""

import numpy as np
import pytest
import torch

from tactile_diffusers import RatingEstimator, TactileTexturePipeline

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
    assert len(found) == 1 and "The checkpoint was adapted" in found[0]

"""`DALEModel`: the effect of ratings, axes left out, and the scalars that travel with the latents."""

import pytest
import torch

from tactile_diffusers import DALEModel
from tactile_diffusers.models.dale_state import (
    MODULATIONS,
    coloured,
    latent_statistics,
    modulation_numbers,
    normal_scores,
    whitened,
)
from tactile_diffusers.models.embeddings import RatingEmbedder, TimestepEmbedder, sinusoidal_embedding


def _normal(*shape, seed=0):
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed))


@pytest.fixture
def dale(make_dale):
    return make_dale()


def _velocity(model, ratings, sample=None, timestep=400.0):
    ratings = torch.as_tensor(ratings)
    with torch.no_grad():
        return model(_normal(len(ratings), 6, 32) if sample is None else sample, timestep, ratings).sample


# --- ratings


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_every_rating_reaches_the_output(dale, axis):
    ratings = torch.zeros(2, 3)
    ratings[1, axis] = 1.0
    one, other = _velocity(dale, ratings, _normal(1, 6, 32).expand(2, -1, -1))
    assert (one - other).norm() / one.norm() > 0.02
    # latents, level and friction alike
    assert not torch.allclose(one[:4], other[:4], atol=1e-3)
    assert not torch.allclose(one[4], other[4], atol=1e-5) and not torch.allclose(one[5], other[5], atol=1e-5)


def test_ratings_reach_every_level_through_cross_attention(dale):
    # attention alone: the pooled ratings in the time embedding are switched off
    torch.nn.init.zeros_(dale.rating_pool.weight)
    ratings = torch.tensor([[0.0, 0.0, 0.0], [2.0, -1.0, 0.5]])
    sample = _normal(1, 6, 32).expand(2, -1, -1)
    one, other = _velocity(dale, ratings, sample)
    assert (one - other).norm() / one.norm() > 0.01
    # ... and with the learnable scale at zero in every block, nothing is left
    scales = [p for name, p in dale.named_parameters() if name.endswith("context_scale")]
    assert len(scales) == 5
    for scale in scales:
        torch.nn.init.zeros_(scale)
    one, other = _velocity(dale, ratings, sample)
    torch.testing.assert_close(one, other, rtol=0, atol=1e-6)


def test_not_specified_is_not_zero(dale):
    ratings = torch.tensor([[0.0, 0.0, 0.0], [torch.nan] * 3])
    one, other = _velocity(dale, ratings, _normal(1, 6, 32).expand(2, -1, -1))
    assert other.isfinite().all() and (one - other).norm() / one.norm() > 0.02


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_an_axis_left_out_is_its_null_token_and_changes_no_other(randomized, axis):
    embedder = randomized(RatingEmbedder(3, 16))
    full = torch.tensor([[0.7, -1.2, 0.4]])
    partial = full.clone()
    partial[0, axis] = torch.nan
    with torch.no_grad():
        tokens, expected = embedder(partial, torch.float32), embedder(full, torch.float32).clone()
    assert torch.equal(tokens[0, axis], embedder.null_tokens[axis].detach())
    expected[0, axis] = embedder.null_tokens[axis].detach()
    assert torch.equal(tokens, expected)


def test_null_tokens_learn_without_nan(make_dale):
    model = make_dale().train()
    ratings = torch.tensor([[torch.nan, 1.0, torch.nan], [0.5, torch.nan, torch.nan]])
    model(_normal(2, 6, 32), 400.0, ratings).sample.square().mean().backward()
    assert all(p.grad.isfinite().all() for p in model.parameters())
    assert all(row.any() for row in model.rating_embedder.null_tokens.grad)


def test_ratings_of_another_width_are_refused(dale):
    for width in (1, 2, 4):
        with pytest.raises(ValueError, match="`ratings`"):
            dale(_normal(2, 6, 32), 400.0, torch.zeros(2, width))


# --- latents, level and friction coefficient


def test_pack_and_unpack_are_inverse(dale):
    latents = 0.99 * _normal(4, 4, 32).tanh()
    level = torch.tensor([-6.0, -5.0, -4.2, -3.0])
    friction = torch.tensor([0.1, 0.5, 1.0, 2.5])
    state = dale.pack(latents, level, friction)
    assert state.shape == (4, 6, 32) and state.dtype == torch.float32
    made = dale.unpack(state)
    for value, expected in zip(made, (latents, level, friction), strict=True):
        torch.testing.assert_close(value, expected, rtol=1e-5, atol=1e-5)  # float32 sums of 32 frames


def test_unknown_friction_is_packed_as_the_training_mean(dale):
    state = dale.pack(torch.zeros(1, 4, 8), torch.tensor([-5.0]), torch.tensor([torch.nan]))
    assert state.isfinite().all()
    assert dale.unpack(state)[2].item() == pytest.approx(torch.tensor(dale.config.log_friction_mean).exp().item())


def test_a_standard_deviation_of_zero_is_a_constant(make_dale):
    model = make_dale(level_std=0.0, log_friction_std=0.0)
    state = model.pack(_normal(2, 4, 8), torch.tensor([-7.0, -3.0]), torch.tensor([0.1, 2.0]))
    for sample in (state, _normal(2, 6, 8)):
        _, level, friction = model.unpack(sample)
        assert level.tolist() == [model.config.level_mean] * 2
        assert friction.log().tolist() == pytest.approx([model.config.log_friction_mean] * 2, rel=1e-5)


def test_friction_that_training_never_knew_stays_unknown(make_dale):
    model = make_dale(log_friction_mean=None, log_friction_std=None)
    state = model.pack(torch.zeros(1, 4, 8), torch.tensor([-5.0]), torch.tensor([0.5]))
    latents, level, friction = model.unpack(state)
    assert state.isfinite().all() and friction.isnan().all() and level.isfinite().all()


@pytest.mark.parametrize(
    ("config", "message"),
    [
        ({"in_channels": 2, "latent_mean": None, "latent_std": None}, "`in_channels` must hold 2 scalars .*, got 2"),
        ({"latent_mean": [0.0]}, "`latent_mean` must hold 4 numbers, got 1"),
        ({"level_channels": 3}, r"`in_channels` must hold 6 scalars and the 3 \+ 0 `level_channels` .*, got 6"),
        ({"level_channels": 1}, "`latent_mean` must hold 2 numbers, got 4"),
        ({"envelope_channels": 1}, "`in_channels` must hold 18 scalars and the 0 \\+ 1 `level_channels` .*, got 6"),
        ({"size_mean": [0.0]}, "`size_mean` must hold 0 numbers, got 1"),
        ({"departure_std": [1.0]}, "`departure_std` must hold 0 numbers, got 1"),
        ({"patch_size": 3}, r"`latent_frames` \(32\) must be a multiple of `patch_size`, got 3"),
        ({"latent_std": [1.0] * 5}, "`latent_std` must hold 4 numbers"),
        ({"widths": [48]}, "`widths` must be multiples of the attention head width 32, got 48"),
        ({"widths": []}, "`widths` must hold at least one positive"),
        ({"kernel_size": 2}, "`kernel_size` must be odd, got 2"),
    ],
)
def test_configs_that_cannot_be_built_are_refused(make_dale, config, message):
    with pytest.raises(ValueError, match=message):
        make_dale(**config)


# --- band levels: one number a patch, and their means over the texture


LAYERS = {"in_channels": 29, "level_channels": 3, "envelope_channels": 2, "patch_size": 4}


@pytest.fixture
def layered(make_dale):
    """Three band levels, two values of the envelope and two learned channels: 4 + 3 + 22 channels of state."""
    statistics = {"latent_mean": [0.5, -0.2, 0.1, 0.3, -0.1], "latent_std": [2.0, 0.7, 0.4, 0.5, 0.6]}
    sizes = {"size_mean": [-0.2, -0.1, *[-1.5] * 6, *[0.0] * 9], "size_std": [0.3, 0.1, *[0.4] * 15]}
    return make_dale(**LAYERS, **statistics, **sizes, departure_std=[0.4, 0.2, 0.1])


def _smooth(count, seed=0):
    """(count, 7, 32) latents whose first three channels are straight lines: what patches can hold."""
    latents = 0.4 * _normal(count, 7, 32, seed=seed) - 0.1
    slopes, means = _normal(count, 3, 1, seed=seed + 1), _normal(count, 3, 1, seed=seed + 2)
    latents[:, 5:] = 0.99 * latents[:, 5:].tanh()
    latents[:, :3] = means + 0.05 * slopes * (torch.arange(32) - 15.5)
    return latents


def test_band_levels_and_the_envelope_survive_packing(layered):
    latents, level, friction = _smooth(4), torch.tensor([-6.0, -5.0, -4.2, -3.0]), torch.tensor([0.1, 0.5, 1.0, 2.5])
    state = layered.pack(latents, level, friction)
    assert state.shape == (4, 29, 32) and layered.latent_channels == 7 and layered.num_scalars == 22
    made = layered.unpack(state)
    torch.testing.assert_close(made[0][:, 5:], latents[:, 5:], rtol=0, atol=1e-5)
    # the envelope in its order, its 64 values between quantiles straight over normal scores: ends reach too far
    torch.testing.assert_close(made[0][:, 3:5], latents[:, 3:5], rtol=0, atol=0.6)
    for row in range(4):
        pair = torch.stack([values[row, 3:5].flatten() for values in (made[0], latents)])
        assert torch.corrcoef(pair)[0, 1] > 0.99
    # a line that rises by up to 0.15 a frame is one again, but for the waviness of torch's cubic and flat ends
    torch.testing.assert_close(made[0][:, :3, 2:-2], latents[:, :3, 2:-2], rtol=0, atol=0.05)
    torch.testing.assert_close(made[0][:, :3].mean(-1), latents[:, :3].mean(-1), rtol=0, atol=1e-5)
    for value, expected in zip(made[1:], (level, friction), strict=True):
        torch.testing.assert_close(value, expected, rtol=1e-5, atol=1e-5)


def test_the_envelope_has_the_quantiles_that_are_asked_for_in_the_order_that_was_generated(layered):
    latents = _normal(3, 7, 4000)
    latents[:, 3:5] = (0.5 * latents[:, 3:5]).exp() * torch.tensor([0.1, 0.5, 1.0])[:, None, None]  # skewed
    state = layered.pack(latents, torch.zeros(3), torch.ones(3))
    field, scalars = layered.split_scalars(state)
    made = layered.append_scalars(_normal(*field.shape, seed=1), scalars)
    envelope = layered.unpack(made)[0][:, 3:5].flatten(1)
    shares = torch.tensor([0.1, 0.5, 0.9, 0.99])
    # 8000 values; the log-normal is bent between quantiles, by up to a tenth of its spread
    wanted = latents[:, 3:5].flatten(1)
    error = (envelope.quantile(shares, 1) - wanted.quantile(shares, 1)) / wanted.std(1)
    assert error.abs().max() < 0.15
    assert torch.equal(envelope.argsort(1), layered.read(made)[0].flatten(1).argsort(1))


def test_the_envelope_is_modulated_as_asked_for_whatever_was_generated():
    series = _normal(3, 600).cumsum(-1).unflatten(-1, (300, 2)).mT  # slow: most power at low rates
    scores = normal_scores(series)
    numbers, white = modulation_numbers(scores), whitened(scores)
    assert numbers.shape == (3, MODULATIONS) and (numbers[:, 0] > numbers[:, 4:].amax(1)).all()
    # equal power in every band, and what was taken away is given back: float32 transforms of 600 values
    torch.testing.assert_close(modulation_numbers(white), torch.zeros(3, MODULATIONS), rtol=0, atol=1e-4)
    torch.testing.assert_close(coloured(white, numbers), scores, rtol=0, atol=1e-4)
    other = coloured(5 * _normal(3, 2, 64, seed=1), numbers)  # another length, another amplitude
    torch.testing.assert_close(modulation_numbers(other), numbers, rtol=0, atol=1e-4)


def test_a_texture_that_does_not_vary_is_packed(layered):
    latents = torch.zeros(1, 7, 32)
    made = layered.unpack(layered.pack(latents, torch.tensor([-5.0]), torch.tensor([0.5])))[0]
    assert made.isfinite().all() and made[:, :5].abs().max() < 0.01


def test_statistics_bring_every_value_to_unit_variance(make_dale):
    latents = _normal(4000, 7, 64) * 0.5
    mixed, depths = _normal(3, 3, seed=3), torch.exp(0.3 * _normal(4000, 2, 1, seed=9))
    latents[:, :3] = mixed @ (_normal(4000, 3, 1, seed=4) + 0.3 * depths[:, :1] * _normal(4000, 3, 64, seed=5)) + 1.0
    latents[:, 3:5] = latents[:, 3:5] * depths[:, 1:] - 0.2 * depths[:, 1:]
    model = make_dale(**LAYERS, **latent_statistics(latents, 3, 2, 4))
    level, friction = -5 + 0.6 * _normal(4000, seed=6), torch.exp(-0.4 + 0.4 * _normal(4000, seed=7))
    numbers = model.pool_state(model.pack(latents, level, friction))
    assert numbers.shape == (4000, 4 * 4 + 3 + 22, 16) and sum(model.channel_groups) == 41
    # 4000 textures: the standard error of a deviation is 1.1 %
    torch.testing.assert_close(numbers.std((0, 2)), torch.ones(41), rtol=0, atol=0.06)
    torch.testing.assert_close(numbers.mean((0, 2)), torch.zeros(41), rtol=0, atol=0.06)
    noise = model.pool_state(_normal(4000, 29, 64, seed=8))
    torch.testing.assert_close(noise.std((0, 2)), torch.ones(41), rtol=0, atol=0.06)


def test_pooling_is_undone(layered):
    pooled = layered.pool_state(_normal(2, 29, 16))
    torch.testing.assert_close(layered.pool_state(layered.unpool_state(pooled)), pooled, rtol=0, atol=1e-5)
    with pytest.raises(ValueError, match=r"multiple of 4 frames \(patch_size\), got 18"):
        layered.pool_state(_normal(2, 29, 18))


def test_the_network_reads_and_writes_pooled_values_alone(layered):
    sample, ratings = _normal(2, 29, 32), torch.tensor([[0.5, 0.0, 0.0], [0.0, -1.0, torch.nan]])
    velocity = _velocity(layered, ratings, sample)
    torch.testing.assert_close(layered.unpool_state(layered.pool_state(velocity)), velocity, rtol=0, atol=1e-5)
    same = layered.unpool_state(layered.pool_state(sample))  # without what is not read
    torch.testing.assert_close(_velocity(layered, ratings, same), velocity, rtol=0, atol=1e-4)
    for channel in (0, 2, 4, 8, 11):  # the envelope, a learned channel, a departure, a mean, a size
        moved = sample.clone()
        moved[:, channel] += 0.2
        assert not torch.allclose(_velocity(layered, ratings, moved), velocity, atol=1e-3)


# --- embeddings


def test_sinusoids_equal_their_formula():
    values = torch.tensor([0.0, 0.5, -2.0])
    made = sinusoidal_embedding(values, 6, 1.0, 16.0)
    frequencies = torch.tensor([1.0, 4.0, 16.0])
    expected = torch.cat([torch.sin(values[:, None] * frequencies), torch.cos(values[:, None] * frequencies)], dim=-1)
    torch.testing.assert_close(made, expected, rtol=0, atol=1e-5)  # angles up to 32 in float32


def test_time_is_embedded_in_float32(randomized):
    embedder = randomized(TimestepEmbedder(8)).bfloat16()
    one, other = embedder(torch.tensor([998.0, 999.0]), torch.bfloat16)  # both are 1000 in bfloat16
    assert not torch.equal(one, other) and one.dtype == torch.bfloat16


class TestScalarsFirst:
    """A distilled model with a network for the numbers of a whole texture."""

    @pytest.fixture
    def dale(self):
        torch.manual_seed(0)
        shape = {"level_channels": 5, "envelope_channels": 4, "widths": [8, 8], "embedding_dim": 8, "rating_dim": 8}
        return DALEModel(in_channels=36, latent_frames=32, distilled_steps=1, scalar_width=16, **shape).eval()

    def test_a_step_leads_to_scalars_of_noise_and_ratings_alone(self, dale):
        ratings, state = torch.tensor([[1.0, torch.nan, 0.0]]).repeat(3, 1), _normal(3, 36, 32)
        field, noise = dale.split_scalars(state)
        other = dale.append_scalars(_normal(*field.shape, seed=1), noise)
        found = [dale.split_scalars(-dale(one, 999, ratings).sample)[1] for one in (state, other)]
        torch.testing.assert_close(*found)
        torch.testing.assert_close(found[0], dale.scalar_network(noise, ratings))
        moved = dale.split_scalars(dale(state, 999, ratings + 1).sample)[1]
        assert (moved + found[0]).abs().max() > 1e-3

    def test_the_rest_is_generated_to_fit_them(self, dale):
        ratings, state = torch.zeros(2, 3), _normal(2, 36, 32)
        field, noise = dale.split_scalars(state)
        given = dale.append_scalars(field, dale.scalar_network(noise, ratings))
        expected = dale.split_scalars(dale.unet_velocity(given, 999, ratings))[0]
        torch.testing.assert_close(dale.split_scalars(dale(state, 999, ratings).sample)[0], expected)

    def test_prepared_conditions_give_the_same(self, dale):
        ratings, state = torch.tensor([[9.0, 0.5, torch.nan]]), _normal(1, 36, 32)
        dale.register_to_config(rating_statistics={"range": [[-2.0, 2.0]] * 3})
        (known,) = dale.condition(ratings, torch.tensor([999.0]))
        torch.testing.assert_close(dale(state, 999, known).sample, dale(state, 999, ratings).sample)
        held = torch.tensor([[2.0, 0.5, torch.nan]])
        torch.testing.assert_close(dale(state, 999, held).sample, dale(state, 999, ratings).sample)

    def test_more_than_one_step_is_refused(self):
        with pytest.raises(ValueError, match="`scalar_width` needs `distilled_steps` = 1, got None"):
            DALEModel(scalar_width=16)

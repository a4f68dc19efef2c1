"""`DALETrainingStep` and its data: dropped ratings, what the loss leaves out, the auxiliary loss, packed states."""

import pytest
import torch

from tactile_diffusers import VDDIMScheduler
from tactile_diffusers.data import PreparedDataset
from tactile_diffusers.models.rating_estimator import RatingEstimator
from tactile_diffusers.training.dale_data import training_states
from tactile_diffusers.training.steps import BatchNoise, DALETrainingStep, drawn_ratings

ROWS = 64


def _random(seed=0):
    return BatchNoise(torch.Generator().manual_seed(seed), torch.device("cpu"))


class _Recorder(torch.nn.Module):
    """Stands in for DALE: records its inputs and predicts zero."""

    def __init__(self, dale):
        super().__init__()
        self.inputs, self.pool_state, self.channel_groups = [], dale.pool_state, dale.channel_groups

    def forward(self, sample, timestep, ratings, return_dict=True):
        self.inputs.append((sample, timestep, ratings))
        return (torch.zeros_like(sample, requires_grad=True),)


class _Estimator(torch.nn.Module):
    """Estimates ratings as the mean of the first three channels."""

    def forward(self, pooled, knows_friction):
        assert knows_friction.all()
        return pooled[:, :3].mean(-1)


@pytest.fixture
def step(make_dale):
    """`step(estimator=None, **options)` makes a training step around a recorder."""

    def make(estimator=None, model=None, **options):
        defaults = {"rating_jitter": 0.0, "condition_dropout": 0.0, "unconditional": 0.0}
        defaults |= {"scalar_weight": 0.2, "conditioning_weight": 0.0}
        model = model or _Recorder(make_dale())
        return DALETrainingStep(model, VDDIMScheduler(), estimator, **(defaults | options))

    return make


@pytest.fixture
def batch():
    generator = torch.Generator().manual_seed(0)
    return {
        "state": torch.randn((ROWS, 6, 8), generator=generator),
        "ratings": torch.randn((ROWS, 3), generator=generator),
        "ratings_error": torch.full((ROWS, 3), 0.3),
        "knows_friction": torch.ones(ROWS, dtype=torch.bool),
        "weight": torch.ones(ROWS),
    }


def _ratings_over_calls(module, batch, calls):
    """Ratings that the model was given: (calls, rows, axes)."""
    for seed in range(calls):
        module(batch, _random(seed))
    return torch.stack([ratings for _, _, ratings in module.model.inputs])


def test_noise_is_drawn_where_the_generator_is_and_given_on_the_device():
    random, drawn = BatchNoise(torch.Generator(), torch.device("meta")), []
    rows = random._rows(lambda shape, generator, device: drawn.append(device) or torch.zeros(shape), 2, 3)
    assert drawn == [torch.device("cpu")] and rows.device.type == "meta"


def test_a_single_rater_is_drawn_of_those_who_rated_the_surface():
    ratings = torch.arange(5.0).expand(200, 5)[..., None].repeat(1, 1, 3)
    sparse = ratings.clone()
    sparse[:, [0, 2, 4]] = torch.nan
    sparse[0] = torch.nan
    whole, drawn = (drawn_ratings({"ratings": rows}, _random(), 0.0, 0.0)[:, 0] for rows in (ratings, sparse))
    place = _random().uniform(200)
    assert torch.equal(whole, (place * 5).long().float())
    assert drawn[0].isnan() and torch.equal(drawn[1:], 1.0 + 2 * (place[1:] * 2).long())


def test_times_are_stratified_and_states_get_the_schedulers_noise(step, batch):
    module = step()
    module(batch, _random())
    noisy, timesteps, ratings = module.model.inputs[0]
    assert ((timesteps + 1) / 1000 * ROWS).floor().tolist() == list(range(ROWS))  # one time in each part of the angle
    assert torch.equal(ratings, batch["ratings"])
    torch.testing.assert_close(noisy[0], batch["state"][0], rtol=0, atol=0.2)  # nearly clean ...
    assert torch.corrcoef(torch.stack([noisy[-1].flatten(), batch["state"][-1].flatten()]))[0, 1] < 0.5


def test_the_loss_of_predicting_zero_is_the_power_of_the_velocity(step, batch):
    loss, scalars = step(scalar_weight=0.0)(batch, _random())
    # unit noise and unit data: 1, within the luck of 64 x 4 x 8 numbers
    assert loss.item() == scalars["velocity"].item() == pytest.approx(1.0, abs=0.15)
    weighted, scalars = step(scalar_weight=0.7)(batch, _random())
    assert weighted.item() == pytest.approx(loss.item() + 0.7 * scalars["scalars"].item(), rel=1e-6)


def test_unknown_friction_is_left_out(step, batch):
    batch["knows_friction"][:] = False
    _, scalars = step()(batch, _random())
    batch["state"][:, 5] += 100.0
    _, moved = step()(batch, _random())
    assert moved["scalars"].item() == pytest.approx(scalars["scalars"].item(), rel=1e-6)
    batch["knows_friction"][:] = True
    assert step()(batch, _random())[1]["scalars"] > 100 * scalars["scalars"]


def test_axes_are_dropped_one_by_one_and_all_together(step, batch):
    ratings = _ratings_over_calls(step(condition_dropout=0.25, unconditional=0.1), batch, 40)
    dropped = torch.isnan(ratings).flatten(0, 1).float()
    # 2560 rows: the standard error of a share is at most 1 %
    assert dropped.mean(0).tolist() == pytest.approx([1 - 0.75 * 0.9] * 3, abs=0.04)
    assert dropped.all(1).float().mean().item() == pytest.approx(0.1 + 0.9 * 0.25**3, abs=0.03)
    assert (dropped.any(1) & ~dropped.all(1)).any()  # some requests leave out some axes


def test_pooled_ratings_are_jittered_by_their_standard_error(step, batch):
    module = step(rating_jitter=2.0)
    moved = _ratings_over_calls(module, batch, 20) - batch["ratings"]
    assert moved.std().item() == pytest.approx(2.0 * 0.3, rel=0.05) and moved.mean().abs() < 0.05
    batch["ratings"][0] = torch.nan  # a surface without ratings
    loss, _ = module(batch, _random())
    assert torch.isnan(module.model.inputs[-1][2][0]).all() and loss.isfinite()


def test_single_ratings_are_those_of_one_rater_never_a_mix(step, batch):
    # rater, row and axis can be read from each number; raters left some axes out
    raters, rows, axes = torch.meshgrid(*(torch.arange(n).float() for n in (5, ROWS, 3)), indexing="ij")
    batch["ratings"] = (100 * raters + rows / 100 + axes / 1000).transpose(0, 1)  # (rows, raters, axes)
    batch["ratings"][:, 3, 1] = torch.nan
    given = _ratings_over_calls(step(rating_jitter=1.0), batch, 20)  # jitter is on pooled ratings only
    chosen = (given[..., 0] / 100).round().long()
    expected = torch.stack([batch["ratings"][torch.arange(ROWS), rater] for rater in chosen])
    torch.testing.assert_close(given, expected, rtol=0, atol=0, equal_nan=True)
    # every rater alike: of 1280 draws a fifth, standard error 1.1 %
    assert (chosen.flatten().bincount(minlength=5) / chosen.numel()).tolist() == pytest.approx([0.2] * 5, abs=0.045)
    assert (chosen != chosen[0]).any(0).float().mean() > 0.9  # another one each time


def test_the_auxiliary_loss_is_that_of_the_predicted_clean_state(step, batch):
    batch["ratings"][:, 1] = torch.nan  # not specified
    module = step(estimator=_Estimator(), conditioning_weight=0.5, scalar_weight=0.0)
    loss, scalars = module(batch, _random())
    noisy, timesteps, ratings = module.model.inputs[0]
    phi = torch.pi / 2 * (timesteps + 1) / 1000
    clean = phi.cos()[:, None, None] * noisy  # the recorder's velocity is zero
    error = (clean[:, :3].mean(-1) - batch["ratings"]).square()[:, [0, 2]].mean(-1)
    expected = (phi.cos().square() * error).mean()
    assert scalars["conditioning"].item() == pytest.approx(expected.item(), rel=1e-5)
    assert loss.item() == pytest.approx(scalars["velocity"].item() + 0.5 * expected.item(), rel=1e-5)


def test_the_estimator_is_neither_trained_nor_saved(step, make_dale, batch):
    estimator = RatingEstimator(make_dale().channel_groups).requires_grad_(False)
    module = step(estimator=estimator, model=make_dale().train(), conditioning_weight=1.0)
    names = [*dict(module.named_parameters()), *module.state_dict()]
    assert all(name.startswith("model.") for name in names)
    module(batch, _random())[0].backward()
    assert all(p.grad is None for p in estimator.parameters())
    assert all(p.grad.isfinite().all() for p in module.model.parameters())


# --- data


@pytest.fixture
def data(prepared):
    return PreparedDataset(prepared, "train")


@pytest.fixture
def latents(data):
    return torch.randn((len(data), 4, 8), generator=torch.Generator().manual_seed(0))


def test_states_hold_level_friction_and_ratings(data, latents, make_dale):
    dale = make_dale()
    states = training_states(dale, data, latents)
    unpacked, level, friction = dale.unpack(states["state"])
    torch.testing.assert_close(unpacked, latents, rtol=0, atol=1e-5)
    torch.testing.assert_close(level, torch.from_numpy(data.levels), rtol=1e-4, atol=1e-4)
    torch.testing.assert_close(friction, torch.from_numpy(data.friction_coefficients), rtol=1e-4, atol=1e-4)
    first = data[0]
    torch.testing.assert_close(states["ratings"][0], first["ratings"].float())
    error = first["ratings_std"] / first["ratings_count"].sqrt()
    torch.testing.assert_close(states["ratings_error"][0], error.float(), rtol=1e-5, atol=0)
    assert states["knows_friction"].shape == (len(data),) and states["knows_friction"].all()

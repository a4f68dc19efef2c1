"""`DALETrainingStep`: which ratings are dropped, what is left out of the loss, and what the frozen head adds."""

import argparse

import pytest
import torch

from tactile_diffusers import VDDIMScheduler
from tactile_diffusers.models.rating_estimator import RatingEstimator

ROWS = 64


def _generator(seed=0):
    return torch.Generator().manual_seed(seed)


class _Recorder(torch.nn.Module):
    """Stands for DALE: remembers what it was asked, answers zero."""

    def __init__(self, dale):
        super().__init__()
        self.asked, self.pool_state, self.channel_groups = [], dale.pool_state, dale.channel_groups

    def forward(self, sample, timestep, ratings, return_dict=True):
        self.asked.append((sample, timestep, ratings))
        return (torch.zeros_like(sample, requires_grad=True),)


@pytest.fixture
def step(script, make_dale):
    """`step(head=None, **options)` makes a training step around a recorder."""

    def make(head=None, model=None, **options):
        defaults = {"rating_jitter": 0.0, "condition_dropout": 0.0, "unconditional": 0.0}
        defaults |= {"ratings": "pooled"}
        defaults |= {"scalar_weight": 0.2, "conditioning_weight": 0.0}
        args = argparse.Namespace(**(defaults | options))
        return script("train_dale").DALETrainingStep(model or _Recorder(make_dale()), VDDIMScheduler(), head, args)

    return make


@pytest.fixture
def batch():
    generator = _generator()
    return {
        "state": torch.randn((ROWS, 6, 8), generator=generator),
        "ratings": torch.randn((ROWS, 3), generator=generator),
        "ratings_error": torch.full((ROWS, 3), 0.3),
        "knows_friction": torch.ones(ROWS, dtype=torch.bool),
        "weight": torch.ones(ROWS),
    }


def test_times_are_stratified_and_states_are_noisy_as_the_scheduler_says(step, batch):
    module = step()
    module(batch, _generator())
    noisy, timesteps, ratings = module.model.asked[0]
    strata = ((timesteps + 1) / 1000 * ROWS).floor()
    assert strata.tolist() == list(range(ROWS))  # one time in each stratum of the angle
    assert torch.equal(ratings, batch["ratings"])
    torch.testing.assert_close(noisy[0], batch["state"][0], rtol=0, atol=0.2)  # nearly clean ...
    assert torch.corrcoef(torch.stack([noisy[-1].flatten(), batch["state"][-1].flatten()]))[0, 1] < 0.5


def test_the_loss_of_a_zero_answer_is_the_power_of_the_velocity(step, batch):
    module = step(scalar_weight=0.0)
    loss, scalars = module(batch, _generator())
    # unit noise and unit data: 1, within the luck of 64 x 4 x 8 numbers
    assert loss.item() == scalars["velocity"].item() == pytest.approx(1.0, abs=0.15)
    weighted, scalars = step(scalar_weight=0.7)(batch, _generator())
    assert weighted.item() == pytest.approx(loss.item() + 0.7 * scalars["scalars"].item(), rel=1e-6)


def test_unknown_friction_is_left_out(step, batch):
    batch["knows_friction"][:] = False
    _, scalars = step()(batch, _generator())
    batch["state"][:, 5] += 100.0
    _, moved = step()(batch, _generator())
    assert moved["scalars"].item() == pytest.approx(scalars["scalars"].item(), rel=1e-6)
    batch["knows_friction"][:] = True
    _, heard = step()(batch, _generator())
    assert heard["scalars"] > 100 * scalars["scalars"]


def test_axes_are_dropped_one_by_one_and_all_together(step, batch):
    module = step(condition_dropout=0.25, unconditional=0.1)
    for seed in range(40):
        module(batch, _generator(seed))
    dropped = torch.isnan(torch.cat([ratings for _, _, ratings in module.model.asked])).float()
    # 2560 rows: the standard error of a share is at most 1 %
    expected = 1 - 0.75 * 0.9
    assert dropped.mean(0).tolist() == pytest.approx([expected] * 3, abs=0.04)
    assert dropped.all(1).float().mean().item() == pytest.approx(0.1 + 0.9 * 0.25**3, abs=0.03)
    given = dropped.any(1) & ~dropped.all(1)
    assert given.any()  # some requests leave out some axes
    for options, share in (({"condition_dropout": 1.0}, 1.0), ({"unconditional": 1.0}, 1.0), ({}, 0.0)):
        module = step(**options)
        module(batch, _generator())
        assert torch.isnan(module.model.asked[0][2]).float().mean() == share


def test_ratings_are_jittered_within_their_standard_error(step, batch):
    module = step(rating_jitter=2.0)
    for seed in range(20):
        module(batch, _generator(seed))
    moved = torch.stack([ratings for _, _, ratings in module.model.asked]) - batch["ratings"]
    assert moved.std().item() == pytest.approx(2.0 * 0.3, rel=0.05) and moved.mean().abs() < 0.05
    batch["ratings"][0] = torch.nan  # a surface without ratings
    loss, _ = module(batch, _generator())
    assert torch.isnan(module.model.asked[-1][2][0]).all() and loss.isfinite()


def test_single_ratings_are_those_of_one_rater_never_a_mix(step, batch):
    # (rater, row, axis) can be read off each number; raters left some axes out
    raters, rows, axes = torch.meshgrid(*(torch.arange(n).float() for n in (5, ROWS, 3)), indexing="ij")
    batch["ratings"] = (100 * raters + rows / 100 + axes / 1000).transpose(0, 1)  # (rows, raters, axes)
    batch["ratings"][:, 3, 1] = torch.nan
    module = step(ratings="single", rating_jitter=1.0)  # jitter is of pooled ratings alone
    for seed in range(20):
        module(batch, _generator(seed))
    asked = torch.stack([ratings for _, _, ratings in module.model.asked])  # (calls, rows, axes)
    chosen = (asked[..., 0] / 100).round().long()
    expected = torch.stack([batch["ratings"][torch.arange(ROWS), rater] for rater in chosen])
    torch.testing.assert_close(asked, expected, rtol=0, atol=0, equal_nan=True)
    # every rater alike: of 1280 draws a fifth, standard error 1.1 %
    assert (chosen.flatten().bincount(minlength=5) / chosen.numel()).tolist() == pytest.approx([0.2] * 5, abs=0.045)
    assert (chosen != chosen[0]).any(0).float().mean() > 0.9  # another one each time


def test_single_ratings_are_dropped_as_pooled_ones_are(step, batch):
    batch["ratings"] = batch["ratings"][:, None].expand(-1, 4, -1)
    module = step(ratings="single", condition_dropout=0.5)
    for seed in range(20):
        module(batch, _generator(seed))
    asked = torch.cat([ratings for _, _, ratings in module.model.asked])
    # 3840 numbers: the standard error of a share is 0.8 %
    assert torch.isnan(asked).float().mean().item() == pytest.approx(0.5, abs=0.035)
    kept, expected = ~torch.isnan(asked), batch["ratings"][:, 0].repeat(20, 1)
    assert torch.equal(asked[kept], expected[kept])


class _Head(torch.nn.Module):
    """Hears the mean of the first three channels."""

    def forward(self, numbers, knows_friction):
        assert knows_friction.all()
        return numbers[:, :3].mean(-1)


def test_the_auxiliary_loss_is_that_of_the_predicted_clean_state(step, batch):
    batch["ratings"][:, 1] = torch.nan  # asks nothing of this axis
    module = step(head=_Head(), conditioning_weight=0.5, scalar_weight=0.0)
    loss, scalars = module(batch, _generator())
    noisy, timesteps, ratings = module.model.asked[0]
    phi = torch.pi / 2 * (timesteps + 1) / 1000
    clean = phi.cos()[:, None, None] * noisy  # the recorder's velocity is zero
    error = (clean[:, :3].mean(-1) - batch["ratings"]).square()[:, [0, 2]].mean(-1)
    expected = (phi.cos().square() * error).mean()
    assert scalars["conditioning"].item() == pytest.approx(expected.item(), rel=1e-5)
    assert loss.item() == pytest.approx(scalars["velocity"].item() + 0.5 * expected.item(), rel=1e-5)


def test_the_head_is_no_part_of_what_is_trained_or_saved(step, make_dale, batch):
    head = RatingEstimator(make_dale().channel_groups).requires_grad_(False)
    module = step(head=head, model=make_dale().train(), conditioning_weight=1.0)
    assert not any("head" in name for name, _ in module.named_parameters())
    assert not any("head" in name for name in module.state_dict())
    loss, _ = module(batch, _generator())
    loss.backward()
    assert all(p.grad is None for p in head.parameters())
    assert all(p.grad.isfinite().all() for p in module.model.parameters())


def test_same_generator_same_loss(step, make_dale, batch):
    module = step(model=make_dale(), condition_dropout=0.3, rating_jitter=1.0)
    before = torch.get_rng_state()
    assert module(batch, _generator(3))[0] == module(batch, _generator(3))[0] != module(batch, _generator(4))[0]
    assert torch.equal(torch.get_rng_state(), before)


def test_packed_states_carry_level_friction_and_ratings(script, prepared, make_dale):
    from tactile_diffusers.data import PreparedDataset

    data = PreparedDataset(prepared, "train")
    dale = make_dale()
    latents = torch.randn((len(data), 4, 8), generator=_generator())
    states = script("train_dale").make_states(dale, data, latents)
    made, level, friction = dale.unpack(states["state"])
    torch.testing.assert_close(made, latents, rtol=0, atol=1e-5)
    torch.testing.assert_close(level, torch.from_numpy(data.levels), rtol=1e-4, atol=1e-4)
    torch.testing.assert_close(friction, torch.from_numpy(data.friction_coefficients), rtol=1e-4, atol=1e-4)
    first = data[0]
    torch.testing.assert_close(states["ratings"][0], first["ratings"].float())
    error = first["ratings_std"] / first["ratings_count"].sqrt()
    torch.testing.assert_close(states["ratings_error"][0], error.float(), rtol=1e-5, atol=0)
    assert states["knows_friction"].shape == (len(data),) and states["knows_friction"].all()


def test_states_hold_the_ratings_of_every_single_rater(script, prepared, make_dale):
    from tactile_diffusers.data import PreparedDataset

    data = PreparedDataset(prepared, "train")
    latents = torch.randn((len(data), 4, 8), generator=_generator())
    module, dale = script("train_dale"), make_dale()
    single, pooled = (module.make_states(dale, data, latents, single=single) for single in (True, False))
    raters = len(data.single_ratings)
    assert single["ratings"].shape == (len(data), raters, 3) and single["ratings"].dtype == torch.float32
    for row in (0, len(data) - 1):
        expected = data.single_ratings[:, data.surface_ids[row]]
        assert torch.equal(single["ratings"][row], torch.from_numpy(expected))
    torch.testing.assert_close(single["ratings"].nanmean(1), pooled["ratings"], rtol=0, atol=1e-5)  # float32
    for name in set(pooled) - {"ratings"}:
        assert torch.equal(single[name], pooled[name]), name


def test_bad_arguments_are_refused(script):
    parse = script("train_dale").parse_args
    words = ["--train_data_dir=x.h5", "--output_dir=out", "--pretrained_model_name_or_path=lctg"]
    assert parse(words).train_batch_size == 64
    for name in ("condition_dropout", "unconditional"):
        for value in ("-0.1", "1.5", "nan"):
            with pytest.raises(ValueError, match=f"--{name} "):
                parse([*words, f"--{name}={value}"])
    assert parse(words).ratings == "pooled" and parse([*words, "--ratings=single"]).ratings == "single"
    with pytest.raises(SystemExit):
        parse([*words, "--ratings=mixed"])
    assert parse(words).max_train_surfaces is None
    for value in ("0", "-3"):
        with pytest.raises(ValueError, match="--max_train_surfaces must be at least 1"):
            parse([*words, f"--max_train_surfaces={value}"])
    for name in ("rating_jitter", "scalar_weight", "conditioning_weight"):
        with pytest.raises(ValueError, match=f"--{name}"):
            parse([*words, f"--{name}=-1"])

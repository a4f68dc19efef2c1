"""Classifier-free guidance: the ratings that DALE is conditioned on, and how its velocities are combined."""

from dataclasses import dataclass

import torch

from ..models.calibration import scalar_shift

#: How far guidance moves a value of a one-step DALE's state at most, in standard deviations of the training set.
LARGEST_PUSH = 3.0
#: Draws over which scalars are averaged.
DRAWS = 64


@dataclass(frozen=True)
class Guidance:
    """Pushes a velocity away from the one without ratings (Ho and Salimans, arXiv 2207.12598).

    Args:
        scale (`float` or `dict[int, float]`): 1.0 = off. A number pushes away from the velocity without any rating; a
            dict, axis to number, from the velocity without that axis alone: v + sum_a (s_a - 1) (v - v_without_a).
        rescale (`float`): how far, 0 to 1, the spread of the predicted clean state is brought back to that of the
            unguided one (Lin et al., arXiv 2305.08891), for each kind of channel apart: levels stay within the data's.
    """

    scale: float | dict = 1.0
    rescale: float = 0.0

    @property
    def active(self):
        """Whether DALE is evaluated with more than the given ratings."""
        return self.scale != 1.0 if not isinstance(self.scale, dict) else any(s != 1.0 for s in self.scale.values())

    def conditions(self, ratings):
        """Weights and ratings of the velocities that are added, the unguided one last: n floats, and (n * batch, axes).

        Weights sum to one. An axis that no row specifies is not evaluated again.
        """
        if not isinstance(self.scale, dict):
            steered = self.active and not torch.isnan(ratings).all()
            pushes = [(self.scale - 1, torch.full_like(ratings, torch.nan))] if steered else []
        else:
            pushes = []
            for axis, scale in self.scale.items():
                if scale != 1.0 and not torch.isnan(ratings[:, axis]).all():
                    without = ratings.clone()
                    without[:, axis] = torch.nan
                    pushes.append((scale - 1, without))
        weights = [*(-push for push, _ in pushes), 1 + sum(push for push, _ in pushes)]
        return weights, torch.cat([*(without for _, without in pushes), ratings])

    def velocity(self, dale, scheduler, state, t, conditions, weights):
        """DALE's guided velocity, from one batched forward.

        Args:
            dale, scheduler: the pipeline's; the scheduler turns velocities into clean states for `rescale`.
            state, t (`torch.Tensor`): (batch, in_channels, frames) at the timestep t, a scalar.
            conditions (`torch.Tensor` or `DALEConditions`): (n * batch, axes) ratings of `conditions`, or what
                `dale.condition` computed from them for this timestep.
            weights (`list[float]`): of the n velocities.
        """
        if len(weights) == 1:
            return dale(state, t, conditions, return_dict=False)[0]
        states = torch.cat([state] * len(weights))
        velocities = dale(states, t, conditions, return_dict=False)[0].chunk(len(weights))
        guided = sum(weight * velocity for weight, velocity in zip(weights, velocities, strict=True))
        if dale.scalar_network is not None:
            ratings = getattr(conditions, "ratings", conditions)
            guided = _held(dale, _along_means(dale, guided, velocities[-1], ratings, weights), velocities[-1])
        return self._rescaled(dale, scheduler, state, t, guided, velocities[-1]) if self.rescale else guided

    def _rescaled(self, dale, scheduler, state, t, guided, plain):
        clean = [scheduler.get_original_sample(velocity, state, t) for velocity in (guided, plain)]
        guided_spread, plain_spread = (_spreads(dale, dale.pool_state(x)) for x in clean)
        factor = 1 + self.rescale * (plain_spread / guided_spread.clamp_min(1e-6) - 1)
        angle = scheduler.angle(t).to(state)
        # at angle 0, the clean end, the velocity does not determine the clean state; no step is evaluated there
        return (angle.cos() * state - factor[..., None] * clean[0]) / angle.sin().clamp_min(1e-3)


def mean_scalars(dale, ratings):
    """Mean of what DALE's scalar network draws for ratings (batch, axes), the same noise for each: (batch, scalars)."""
    noise = torch.randn(DRAWS, dale.num_scalars, generator=torch.Generator("cpu").manual_seed(0))
    noise = noise.to(ratings.device, dale.dtype).repeat(len(ratings), 1)
    means = dale(noise, None, ratings.repeat_interleave(DRAWS, dim=0), return_dict=False)[0]
    means, shift = means.unflatten(0, (-1, DRAWS)).mean(1), scalar_shift(dale.config, ratings)
    return means if shift is None else means + shift


def _along_means(dale, guided, plain, ratings, weights):
    """A guided velocity whose scalars move as their means over takes do.

    The same noise means another quantile with ratings than without: what is extrapolated take by take moves some takes
    the wrong way, and spreads them.
    """
    means = mean_scalars(dale, ratings).chunk(len(weights))
    push = sum(weight * (mean - means[-1]) for weight, mean in zip(weights, means, strict=True))
    return dale.append_scalars(dale.split_scalars(guided)[0], dale.split_scalars(plain)[1] - push.to(plain))


def _held(dale, guided, plain):
    """A guided velocity at the only step there is: no later one would bring back what is pushed too far."""
    plain = dale.pool_state(plain)
    push = dale.pool_state(guided) - plain
    return dale.unpool_state(plain + LARGEST_PUSH * torch.tanh(push / LARGEST_PUSH))


def _spreads(dale, pooled):
    """Root mean square of each kind of number, for every channel of the state: (batch, in_channels)."""
    levels, scalars = dale.config.level_channels, dale.num_scalars
    channels = (dale.config.in_channels - levels - scalars, levels, scalars)
    parts = zip(pooled.split(dale.channel_groups, dim=1), channels, strict=True)
    return torch.cat([part.square().mean((1, 2)).sqrt()[:, None].expand(-1, count) for part, count in parts], dim=1)

"""The training step of a distilled DALE: energy scores of what its few steps make."""

from torch import nn

from ..schedulers import VDDIMScheduler
from .energy import StateViews, energy_score
from .steps import DALETrainingStep


def sample(model, scheduler, state, condition, steps):
    """The end of a path of `steps` from noise (batch, channels, length)."""
    scheduler.set_timesteps(steps, device=state.device)
    for t in scheduler.timesteps:
        velocity = model(state, t, condition, return_dict=False)[0]
        state = scheduler.step(velocity, t, state, return_dict=False)[0]
    return state


class LatentStep(nn.Module):
    """Energy score of two states generated from ratings: rows of `training_states` -> (loss, scalars).

    Args:
        model (`DALEModel`): is trained.
        scheduler (`VDDIMScheduler`): DALE's.
        states (`torch.Tensor`): (n, in_channels, frames), from which the scales of the views are taken.
        steps (`int`): that the model takes.
    """

    def __init__(self, model, scheduler, states, steps):
        super().__init__()
        self.model, self.steps, self.views = model, steps, StateViews(model, states)
        self.scheduler = VDDIMScheduler.from_config(scheduler.config)
        self.teaching = DALETrainingStep(model, scheduler, None)  # draws the ratings

    def forward(self, batch, random):
        real, ratings = batch["state"], self.teaching.drawn_ratings(batch, random)
        views = []
        for _ in range(2):
            made = sample(self.model, self.scheduler, random.normal(*real.shape), ratings, self.steps)
            views.append(self.views(made))
        loss = energy_score(*views, self.views(real), batch["weight"])
        return loss, {"energy": loss.detach()}

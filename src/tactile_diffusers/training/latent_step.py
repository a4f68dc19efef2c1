"""The training step of a DALE of one step: energy scores of the fields that it makes for given scalars."""

from torch import nn

from ..models.calibration import scalar_shift
from ..schedulers import VDDIMScheduler
from .decoder_step import one_step
from .energy import energy_score
from .state_views import StateViews
from .steps import drawn_ratings


class LatentStep(nn.Module):
    """Energy score of two states generated from ratings and the real scalars: rows of `training_states` -> (loss,
    scalars to log).

    Args:
        model (`DALEModel`): is trained.
        scheduler (`VDDIMScheduler`): DALE's.
        states (`torch.Tensor`): (n, in_channels, frames), from which the scales of the views are taken.
    """

    def __init__(self, model, scheduler, states):
        super().__init__()
        self.model, self.views = model, StateViews(model, states)
        self.scheduler = VDDIMScheduler.from_config(scheduler.config)

    def forward(self, batch, random):
        real, ratings, views = batch["state"], drawn_ratings(batch, random), []
        scalars = self.model.split_scalars(real)[1]
        shift = scalar_shift(self.model.config, ratings)  # the U-Net knows scalars without it
        known = scalars if shift is None else scalars - shift.to(scalars)
        for _ in range(2):
            noise = self._given(random.normal(*real.shape), known)
            made = one_step(self.model.unet_velocity, self.scheduler, noise, ratings)
            views.append(self.views(self._given(made, scalars)))
        loss = energy_score(*views, self.views(real), batch["weight"])
        return loss, {"energy": loss.detach()}

    def _given(self, state, scalars):
        return self.model.append_scalars(self.model.split_scalars(state)[0], scalars)

"""`RatingEstimator`: ratings that people would give to a texture, estimated from its latents."""

import torch
from diffusers.configuration_utils import ConfigMixin, register_to_config
from diffusers.models.modeling_utils import ModelMixin
from torch import nn

from ..signal import RATING_AXES
from .dale import NUM_SCALARS
from .mixins import SafeLoadingMixin


class RatingEstimator(SafeLoadingMixin, ModelMixin, ConfigMixin):
    r"""
    A small regression from DALE's clean state to ratings.

    It is trained on real latents before DALE, and then frozen: it serves the paper's auxiliary conditioning loss
    (section 2.2) and the pipeline's `estimate_ratings`. It does not judge generated textures, because it helped to
    train their generator. Its estimates are shrunk towards the mean of the training surfaces by about R², as those of
    any regression. This model inherits from [`ModelMixin`].

    Args:
        channel_groups (`list[int]`): sizes of the channel groups of `DALEModel.pool_state`: learned
            latents, departures of the band levels, scalars of the whole texture.
        rating_axes (`list[str]`, *optional*): names of the perceptual axes.
        width (`int`, *optional*, defaults to 96): channels of the convolutions.
    """

    __module__ = "tactile_diffusers"  # as checkpoints name it

    _no_split_modules = ["Sequential"]

    @register_to_config
    def __init__(self, channel_groups: list[int], rating_axes: tuple[str, ...] = RATING_AXES, width: int = 96):
        super().__init__()
        learned, departures, scalars = channel_groups
        if scalars < NUM_SCALARS:
            raise ValueError(
                f"`channel_groups` must end with at least {NUM_SCALARS} scalars, got {list(channel_groups)}."
            )
        self.net = nn.Sequential(
            nn.Conv1d(learned + departures, width, 3, padding=1),
            nn.SiLU(),
            nn.Conv1d(width, width, 3, padding=1),
            nn.SiLU(),
            nn.Conv1d(width, width, 3, padding=1),
        )
        self.out = nn.Sequential(
            nn.Linear(2 * width + scalars + 1, width), nn.SiLU(), nn.Linear(width, len(rating_axes))
        )

    def forward(self, pooled, knows_friction=None):
        """Ratings in z-scores, (batch, axes).

        Args:
            pooled (`torch.Tensor`): (batch, sum of `channel_groups`, positions), of `DALEModel.pool_state`.
            knows_friction (`torch.Tensor`, *optional*): (batch,) bool; `None` = of all. Where it is unknown, the last
                scalar is ignored.
        """
        field, scalars = pooled.split([sum(self.config.channel_groups[:2]), self.config.channel_groups[2]], dim=1)
        hidden_states = self.net(field)
        known = torch.ones_like(scalars[:, :1, 0])
        if knows_friction is not None:
            known = knows_friction.to(scalars)[:, None]
        scalars = scalars.mean(-1)
        scalars = torch.cat([scalars[:, :-1], scalars[:, -1:] * known, known], dim=1)
        # std of a single position is not defined; the small constant keeps its gradient finite
        deviation = (hidden_states.var(-1, correction=0) + 1e-6).sqrt()
        return self.out(torch.cat([hidden_states.mean(-1), deviation, scalars], dim=1))

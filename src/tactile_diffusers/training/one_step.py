"""Training steps of models of one step: energy scores of waveforms decoded from latents, and of DALE's fields."""

import torch
from torch import nn

from ..features.fast_envelope import gain_of_frames
from ..models.calibration import scalar_shift
from ..schedulers import VDDIMScheduler
from .energy import energy_score, waveform_views
from .state_views import StateViews
from .steps import drawn_ratings, drop_detail


def one_step(model, scheduler, noise, condition):
    """Where a single step leads from noise (batch, channels, length); `model` gives the velocity."""
    scheduler.set_timesteps(1, device=noise.device)
    (t,) = scheduler.timesteps
    return scheduler.step(model(noise, t, condition), t, noise, return_dict=False)[0]


class DecoderStep(nn.Module):
    """Energy score of two waveforms decoded from latents: batches of `make_collate` -> (loss, scalars to log).

    Args:
        model (`LCTGModel`): is trained, but for its encoder.
        scheduler (`VDDIMScheduler`): LCTG's.
        extractor (`TactileFeatureExtractor`): the pipeline's.
        detail_dropout (`float`): share of textures without detail layer, which generated ones are.
    """

    def __init__(self, model, scheduler, extractor, detail_dropout):
        super().__init__()
        self.model, self.extractor, self.detail_dropout = model, extractor, detail_dropout
        self.model.encoder.requires_grad_(False)
        self.scheduler = VDDIMScheduler.from_config(scheduler.config)  # a scheduler has state

    def forward(self, batch, random):
        real = batch["waveform"]
        with torch.no_grad():
            latents = self.model.encode(batch["input_features"])
            gain = self.gain(latents, real)
            # from exact to as noisy as the teacher knows: generated latents lie between
            amount = random.uniform(len(latents), 1, 1)
            latents = latents + amount * self.model.config.latent_noise * random.normal(*latents.shape)
            latents = drop_detail(latents, self.model.base_channels, self.detail_dropout, random)
        views = []
        for _ in range(2):
            noise = random.normal(*real[:, None].shape)
            made = one_step(self.velocity, self.scheduler, noise, latents)[:, 0]
            views.append(self.views(made * gain))
        loss = energy_score(*views, self.views(real * gain))
        return loss, {"energy": loss.detach()}

    def velocity(self, *inputs):
        return self.model(*inputs, return_dict=False)[0]

    def gain(self, latents, like):
        """The fast envelope, which what is felt has: (batch, samples), or 1."""
        envelope = self.model.fast_envelope(latents)
        if envelope is None:
            return 1.0
        return torch.from_numpy(gain_of_frames(envelope.double().cpu().numpy(), like.shape[-1])).to(like)

    def views(self, waveform):
        return waveform_views(waveform, self.extractor.sampling_rate, self.extractor.band)


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

"""LCTG without one of its parts: what stands beside it in a report and shows what the part is worth.

A stand-in is decoded by the pipeline as LCTG is: the same latents, noise, restored levels and delivery.
"""

import torch

from tactile_diffusers.features.low_band import sample_low_band, synthesize
from tactile_diffusers.models.lctg import LCTGModel, LCTGOutput


class NoNetwork(LCTGModel):
    """LCTG without its network: the low end that the latents hold, white noise in place of what would be generated.

    Decode it in one step: the solver then returns this texture, and the pipeline restores the levels of bands.
    """

    def condition(self, latents, timesteps):
        """The latents: there is nothing to prepare."""
        return [latents] * len(timesteps)

    def forward(self, sample, timestep, latents, return_dict=True):
        """Velocity that leads to the texture from noise `sample` (batch, 1, samples); other arguments as LCTG's."""
        detail = self._layers(latents)[1] if latents[:, self.base_channels :].any() else None
        clean = sample
        if detail is not None:
            stride = self.config.latent_hop // self.config.detail_channels
            low = torch.from_numpy(sample_low_band(sample[:, 0].cpu().numpy(), stride)).to(sample)
            clean = detail + sample - synthesize(low, stride)
        cosine, sine = self._cos_sin(timestep.reshape(-1), sample.dtype)[..., None, None].unbind(1)
        velocity = (cosine * sample - clean) / sine  # of which x0 = cos(phi) sample - sin(phi) v
        return LCTGOutput(sample=velocity) if return_dict else (velocity,)


class NothingImposed(LCTGModel):
    """LCTG as its network decodes: the levels of bands are read as part of the latents, but not restored afterwards."""

    def band_levels(self, latents):
        """None: nothing is restored but the level of the whole texture."""
        return None


def with_stand_in(pipe, stand_in):
    """A pipeline that reconstructs with `NoNetwork` or `NothingImposed` in place of the default decoder."""
    decoder = pipe.decoder_of(pipe.resolve_steps()[0])
    lctg = stand_in.from_config(decoder.config)
    lctg.load_state_dict(decoder.state_dict())
    made = type(pipe)(
        lctg=lctg.to(pipe.lctg.device).eval(), feature_extractor=pipe.feature_extractor, scheduler=pipe.scheduler
    )
    made.set_progress_bar_config(disable=True)
    return made


def used_channels(lctg, layers):
    """Channels that a decoder reads of "all_layers" or the "base_layer": list of indices. The rate counts these."""
    last = lctg.base_channels if layers == "base_layer" else lctg.config.latent_channels
    learned = range(lctg.passed_channels, lctg.base_channels)  # which the network alone reads
    return [channel for channel in range(last) if not (isinstance(lctg, NoNetwork) and channel in learned)]

"""What LCTG's network and the restored levels are worth: reconstructions with and without them, at equal rate too."""

import numpy as np
import torch
from scipy import optimize

from tactile_diffusers.evaluation.metrics.errors import snr_db
from tactile_diffusers.evaluation.metrics.statistics import leaf, number
from tactile_diffusers.signal import nine_band_error_db

from ..baselines import latent_rate
from ..sampling import encode, reconstruct
from ..stand_ins import NoNetwork, NothingImposed, used_channels, with_stand_in
from .context import HALF_PRECISION, spaced_training

#: Standard deviations of the noise on latents between which one of equal rate is looked for.
_SIGMAS = (1e-5, 1e2)


def measure_decoders(context, measure, textures=None):
    """Rows without a part of LCTG beside those with it, from all layers and from the base layer alone.

    `measure` makes leaves of textures (n, samples) and their embeddings; `textures` are LCTG's from all layers in
    `context.steps`, if known. Returns "decoders": row ("lctg", "no_network", "nothing_imposed", each with "_base" where
    there is a detail layer) -> leaves; "equal_rate": likewise, from latents with the noise of LCTG's training, or what
    leaves as many bits for "no_network", which reads fewer channels; "network": layers -> LCTG minus "no_network",
    paired.
    """
    decoders, rows, noisy, network = _Decoders(context), {}, {}, {}
    embed = context.data.reference.embed
    for layers, suffix in (("all_layers", ""), ("base_layer", "_base")):
        if suffix and not context.pipe.lctg.config.detail_channels:
            continue
        made = {}
        for name, pipe in decoders.pipes.items():
            known = textures if name + suffix == "lctg" else None
            known = decoders.decode(pipe, layers) if known is None else known
            made[name] = (known, embed(known))
            rows[name + suffix] = measure(*made[name])
            if name != "nothing_imposed" and (sigma := decoders.sigma(pipe, layers)):  # it has LCTG's latents
                known = decoders.decode(pipe, layers, sigma)
                noisy[name + suffix] = measure(known, embed(known)) | decoders.rate(layers) | {"sigma": number(sigma)}
        network[layers] = _differences(context.data, made["lctg"], made["no_network"])
    return {"decoders": rows, "equal_rate": noisy, "network": network}


class _Decoders:
    """The pipelines that are compared, and the latents that their rates are counted on."""

    def __init__(self, context):
        self.context, lctg = context, context.pipe.lctg
        self.pipes = {"lctg": context.pipe, "no_network": with_stand_in(context.pipe, NoNetwork)}
        if lctg.config.level_bands:
            self.pipes["nothing_imposed"] = with_stand_in(context.pipe, NothingImposed)
        self.latents = encode(context.pipe, spaced_training(context.data), context.data.rate)

    def decode(self, pipe, layers, sigma=0.0):
        """(n, samples) of the held-out segments; `sigma` of the noise on the latents that the decoder reads."""
        context, channels = self.context, used_channels(pipe.lctg, layers)
        rng = context.rng(f"latent noise, {layers}")

        def change(latents):
            noise = torch.from_numpy(rng.standard_normal(latents.shape).astype(np.float32)).to(latents)
            changed = torch.zeros_like(latents)
            changed[:, channels] = latents[:, channels] + sigma * noise[:, channels]
            return changed

        segments = (context.data.real, context.data.rate)
        return reconstruct(pipe, *segments, self._steps(pipe), context.seed, quiet=context.quiet, change=change)

    def _steps(self, pipe):
        return 1 if isinstance(pipe.lctg, NoNetwork) else self.context.steps

    def rate(self, layers):
        """Leaf "kilobits_per_second": what LCTG's latents carry through the noise that it was trained with."""
        return {"kilobits_per_second": number(self._bits(used_channels(self.context.pipe.lctg, layers)) / 1000)}

    def sigma(self, pipe, layers):
        """Standard deviation of noise through which a decoder's channels carry LCTG's rate; None without channels."""
        channels, bits = used_channels(pipe.lctg, layers), self.rate(layers)["kilobits_per_second"]["mean"] * 1000
        if channels:
            return float(np.exp(optimize.brentq(lambda x: self._bits(channels, np.exp(x)) - bits, *np.log(_SIGMAS))))
        return None

    def _bits(self, channels, sigma=None):
        """Bits per second of some channels."""
        lctg, extractor = self.context.pipe.lctg, self.context.pipe.feature_extractor
        numbers = len(channels) * extractor.sampling_rate / lctg.config.latent_hop
        return numbers * latent_rate(self.latents[:, channels], sigma or lctg.config.latent_noise or HALF_PRECISION)


def _differences(data, made, others):
    """Leaves of one decoder minus another, (textures, embeddings) each: errors segment by segment, and KTD."""
    (textures, points), (other_textures, other_points) = made, others
    errors = {"nine_band_db": lambda rows: nine_band_error_db(rows, data.real, data.rate, data.edges)}
    if data.dataset.unit == "N":
        errors["snr_db"] = lambda rows: snr_db(rows, data.real)
    found = {name: leaf(error(textures) - error(other_textures), data.surfaces) for name, error in errors.items()}
    return found | {"ktd": data.reference.paired_ktd(points, other_points, data.surfaces)}

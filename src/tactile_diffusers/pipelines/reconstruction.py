"""Encoding, decoding and reconstruction of textures, and an estimate of their ratings."""

import numpy as np
import torch
from diffusers.utils import logging

from ..signal.checks import texture_rows
from .components import check_scheduler
from .inputs import (
    check_decoding,
    check_generator,
    check_noise,
    check_steps,
    warn_of_distilled_steps,
    warn_of_other_units,
)
from .pipeline_output import TactileLatents

#: Steps of both stages. `examples/research/sampler.py`: with the second order, nine-band error
#: and KTD of held-out textures stop improving at 3; at 5 the solver's error is half of DDIM's at 10, and weak bands
#: have settled. Of models that are not distilled.
DEFAULT_STEPS = 5
_ADAPTER = (
    "`lctg` has an adapter, but `lctg_distilled` decodes in so few steps: the adapter does nothing. Ask for "
    "`num_inference_steps=5`, or add it to `pipe.lctg_distilled`."
)
_ESTIMATOR = "The checkpoint was adapted, its `rating_estimator` was not: it estimates as it was trained to."
#: Friction coefficient beyond which a warning is logged: 50 is per cent.
LARGEST_FRICTION = 5.0
logger = logging.get_logger(__name__)


class ReconstructionMixin:
    """The part of `TactileTexturePipeline` that needs no ratings."""

    def resolve_steps(self, num_inference_steps=None, num_latent_inference_steps=None):
        """Steps that a call with these arguments takes, of LCTG and of DALE: (int, int).

        Raises:
            ValueError: if one is no whole number >= 1.
        """
        few = None if self.lctg_distilled is None else self.lctg_distilled.config.distilled_steps
        decoding = self._steps("num_inference_steps", num_inference_steps, self.lctg, few or DEFAULT_STEPS)
        undistilled = decoding if self.decoder_of(decoding).config.distilled_steps is None else DEFAULT_STEPS
        latent = self._steps("num_latent_inference_steps", num_latent_inference_steps, self.dale, undistilled)
        return decoding, latent

    def _steps(self, name, steps, model, default):
        """Steps of one stage: as asked, but no more than the model was distilled to, or the default."""
        most = None if model is None else model.config.distilled_steps
        if steps is None:
            return default if most is None else most
        steps = check_steps(name, steps)
        if most is None or steps <= most:
            return steps
        self._warn_once(name, steps, warn_of_distilled_steps, name, steps, type(model).__name__, most)
        return most

    def decoder_of(self, steps):
        """The [`LCTGModel`] that decodes in so many steps: `lctg_distilled` in few, `lctg` in more."""
        few = self.lctg_distilled
        if few is None or steps > few.config.distilled_steps:
            return self.lctg
        if getattr(self.lctg, "peft_config", None) and not getattr(few, "peft_config", None):
            self._warn_once("adapter", True, logger.warning, _ADAPTER)
        return few

    @torch.no_grad()
    def encode(self, texture, sampling_rate):
        """Latents and level of textures; the gain is kept beside the shape.

        Args:
            texture (`np.ndarray` or `torch.Tensor`): (samples,) or (batch, samples), N, band-passed and zero mean.
            sampling_rate (`int`): Hz.

        Returns:
            [`TactileLatents`]: the friction coefficient is NaN, because a texture does not hold it.
        """
        features = self.feature_extractor(texture, sampling_rate, return_tensors="pt")
        device = self._execution_device
        latents = self.lctg.encode(features["input_features"].to(device=device, dtype=self.lctg.dtype))
        level = features["level"].to(device)
        if self.dale is not None:
            loudest = features["level"].max().item()
            self._warn_once("unit", round(loudest), warn_of_other_units, loudest, self.dale.config)
        return TactileLatents(latents=latents, level=level, friction_coefficient=torch.full_like(level, torch.nan))

    @torch.no_grad()
    def decode(
        self,
        latents: torch.Tensor,
        level: torch.Tensor,
        friction_coefficient: torch.Tensor | None = None,
        num_inference_steps: int | None = None,
        generator: torch.Generator | list[torch.Generator] | None = None,
        output_type: str = "np",
        samples: int | None = None,
        noise: torch.Tensor | None = None,
    ):
        """Textures from latents.

        Args:
            latents (`torch.Tensor`): (N, latent_channels, frames), of `encode` or of `output_type="latent"`; zeros in
                the detail layer (the last `detail_channels`) = unknown, generated from the noise.
            level (`torch.Tensor`): (N,), natural log of the RMS in N.
            friction_coefficient (`torch.Tensor`, *optional*): (N,), passed on; `None` = NaN.
            num_inference_steps (`int`, *optional*): steps of LCTG; `None` = what `lctg_distilled` takes, or 5.
            generator (`torch.Generator` or list, *optional*): draws LCTG's noise; a list has N entries.
            output_type (`str`, *optional*, defaults to `"np"`): `"np"`, or `"pt"`: on the pipeline's device.
            samples (`int`, *optional*): delivered samples to keep; `None` = all.
            noise (`torch.Tensor`, *optional*): LCTG's initial noise in place of the generator's,
                (N, 1, frames x lctg.config.latent_hop).

        Returns:
            [`TactileTexturePipelineOutput`]

        Raises:
            ValueError: for any impossible argument, before any work starts.
        """
        check_scheduler("scheduler", self.scheduler)
        num_inference_steps, _ = self.resolve_steps(num_inference_steps)
        channels = self.lctg.config.latent_channels
        check_decoding(latents, level, friction_coefficient, channels, num_inference_steps, output_type, samples)
        generator = check_generator(generator, len(latents))
        shape = (len(latents), 1, latents.shape[-1] * self.lctg.config.latent_hop)
        if noise is not None:
            check_noise("noise", noise, shape)
        self._interrupt = False
        latents = latents.to(self._execution_device)
        self.scheduler.set_timesteps(num_inference_steps, device=latents.device)
        if friction_coefficient is None:
            friction_coefficient = torch.full_like(level, torch.nan)
        with self.progress_bar(total=len(self.scheduler.timesteps)) as bar:
            decoded = self._decode(self.decoder_of(num_inference_steps), latents, noise, generator, bar)
        out = self._postprocess(*decoded, level, friction_coefficient, samples, output_type)
        self.maybe_free_model_hooks()
        return out

    def reconstruct(self, texture, sampling_rate, num_inference_steps=None, generator=None, output_type="np"):
        """Encodes and decodes textures: the same length and level, at the delivery rate; friction coefficient NaN.

        Arguments are those of `encode` and `decode`.
        """
        num_inference_steps, _ = self.resolve_steps(num_inference_steps)
        encoded = self.encode(texture, sampling_rate)
        samples = max(1, round(np.shape(texture)[-1] * self.feature_extractor.delivery_rate / sampling_rate))
        return self.decode(
            encoded.latents, encoded.level, None, num_inference_steps, generator, output_type, samples=samples
        )

    @torch.no_grad()
    def estimate_ratings(self, texture, sampling_rate, friction_coefficient=None):
        """Estimates the ratings that people would give to textures, by a regression on latents (`RatingEstimator`).

        For round trips in tools; it is no judge of a generator, because it helped to train DALE. Estimates are shrunk
        towards the middle, as those of any regression are.

        Args:
            texture (`np.ndarray` or `torch.Tensor`): (samples,) or (batch, samples), N, band-passed and zero mean.
            sampling_rate (`int`): Hz.
            friction_coefficient (`float`, `np.ndarray` or `torch.Tensor`, *optional*): one, or (batch,); `None` or NaN
                = unknown, which costs most of what is known about slipperiness.

        Returns:
            `np.ndarray`: (batch, axes) float32, z-scores in the order of `dale.config.rating_axes`; NaN on axes that
            the estimator does not know.

        Raises:
            ValueError: if the checkpoint has no estimator, or friction coefficients are not above 0, or another number.
        """
        if self.dale is None or self.rating_estimator is None:
            raise ValueError("This checkpoint has no `rating_estimator`: examples/train_dale.py trains one with DALE.")
        friction = friction_of(friction_coefficient, len(texture_rows(texture)))
        return self._estimate(self.encode(texture, sampling_rate), friction)

    def _estimate(self, encoded, friction):
        """`estimate_ratings` of what `encode` returned, and friction coefficients, (batch,)."""
        if self.dale.config.calibration is not None:
            self._warn_once("estimator", True, logger.warning, _ESTIMATOR)
        friction, size = friction.to(encoded.level), self.dale.config.patch_size
        latents = encoded.latents[:, : self.lctg.base_channels]
        if (missing := size - latents.shape[-1]) > 0:
            latents = torch.cat([latents, latents[..., -1:].expand(-1, -1, missing)], dim=-1)
        latents = latents[..., : latents.shape[-1] // size * size]
        state = self.dale.pack(latents, encoded.level, friction, self.dale.config.estimator_statistics)
        pooled = self.dale.pool_state(state).to(self.rating_estimator.dtype)
        ratings = self.rating_estimator(pooled, torch.isfinite(friction)).float().cpu().numpy()
        self.maybe_free_model_hooks()
        further = len(self.dale.config.rating_axes) - ratings.shape[1]  # an adapted DALE's own axes
        return np.pad(ratings, ((0, 0), (0, max(0, further))), constant_values=np.nan)


def friction_of(friction_coefficient, count):
    """Friction coefficients of so many textures, of one number or one for each, NaN or None = unknown: (count,) float.

    Raises:
        ValueError: if they are no numbers above 0, or another number of them.
    """
    try:
        if not isinstance(friction_coefficient, torch.Tensor):
            friction_coefficient = np.asarray(friction_coefficient, dtype=np.float32)  # None becomes NaN
        friction = torch.as_tensor(friction_coefficient).float()
    except (TypeError, ValueError, RuntimeError) as error:
        raise ValueError(f"`friction_coefficient` must be numbers, got {friction_coefficient!r}.") from error
    if friction.ndim and friction.shape != (count,):
        raise ValueError(f"`friction_coefficient` must be one number or {count}, got shape {tuple(friction.shape)}.")
    if len(wrong := friction[(friction <= 0) | friction.isinf()]):
        raise ValueError(f"`friction_coefficient` must be finite and above 0, or NaN = unknown, got {wrong[0]:g}.")
    if (friction > LARGEST_FRICTION).any():
        logger.warning(f"`friction_coefficient` {friction.nan_to_num().max():g} is more than skin has: is it per cent?")
    return friction.expand(count)

"""The pipeline: perceptual ratings in, a touchable texture out."""

import math
from collections import deque

import numpy as np
import torch
from diffusers import DiffusionPipeline
from diffusers.callbacks import MultiPipelineCallbacks, PipelineCallback
from diffusers.utils import replace_example_docstring

from ..features import TactileFeatureExtractor
from ..models import DALEModel, LCTGModel, RatingEstimator
from ..models.mixins import has_hooks
from ..schedulers import VDDIMScheduler, draw_noise
from ..signal import level as measured_level
from ..signal.checks import check_number, check_whole_number
from .components import check_classes, check_fit, check_scheduler, step_arguments
from .guidance import Guidance
from .inputs import (
    LONGEST_SECONDS,
    check_callback,
    check_generator,
    check_noise,
    parse_guidance,
    parse_ratings,
    warn_of_novel_ratings,
    warn_of_strong_guidance,
)
from .loading import LoadingMixin
from .pipeline_output import TactileLatents, TactileTexturePipelineOutput
from .reconstruction import ReconstructionMixin
from .velocities import rating_velocity, texture_velocity

EXAMPLE_DOC_STRING = """
    Examples:
        ```py
        >>> import torch
        >>> from tactile_diffusers import TactileTexturePipeline, bundled_checkpoint

        >>> pipe = TactileTexturePipeline.from_pretrained(bundled_checkpoint())
        >>> generator = torch.Generator("cpu").manual_seed(0)
        >>> out = pipe(ratings=[[1.5, 0.0, -1.0]], num_inference_steps=10, generator=generator)
        >>> out.textures.shape, out.sampling_rate  # newtons at 10 kHz
        ((1, 16384), 10000)
        ```
"""


class TactileTexturePipeline(ReconstructionMixin, LoadingMixin, DiffusionPipeline):
    r"""
    Generates textures from perceptual ratings: DALE generates latents, LCTG decodes them to a waveform of force.

    This pipeline inherits from [`DiffusionPipeline`]: loading, saving, moving and offloading are described there. It
    serves one thread at a time, because its schedulers have state: every thread needs a pipeline of its own, which may
    share the models but not the schedulers. A forked process calls `torch.set_num_threads(1)` before it: PyTorch's
    threads do not survive a fork, and the pipeline would wait for them for ever.

    Args:
        lctg ([`LCTGModel`]): encoder and decoder between textures and latents.
        feature_extractor ([`TactileFeatureExtractor`]): the input of LCTG's encoder, and the way back to newtons.
        scheduler ([`VDDIMScheduler`]): sampler of LCTG. Schedulers of diffusers for v-prediction work, too, if they are
            made by `Scheduler.from_config(pipe.scheduler.config)`.
        dale ([`DALEModel`], *optional*): ratings to latents; `None` = a pipeline that only reconstructs.
        dale_scheduler ([`VDDIMScheduler`], *optional*): sampler of DALE, not the same object as `scheduler`.
        rating_estimator ([`RatingEstimator`], *optional*): textures to ratings, for `estimate_ratings` alone.
        lctg_distilled ([`LCTGModel`], *optional*): decodes in the place of `lctg` where no more steps are asked for
            than it was distilled to, which is the default then.

    Raises:
        ValueError: if a component is missing, of a wrong class, or does not fit the others.
    """

    __module__ = "tactile_diffusers"  # as checkpoints name it

    model_cpu_offload_seq = "dale->lctg->lctg_distilled->rating_estimator"
    _optional_components = ["dale", "dale_scheduler", "rating_estimator", "lctg_distilled"]
    _callback_tensor_inputs = ["latents"]

    def __init__(
        self,
        lctg: LCTGModel,
        feature_extractor: TactileFeatureExtractor,
        scheduler: VDDIMScheduler,
        dale: DALEModel = None,
        dale_scheduler: VDDIMScheduler = None,
        rating_estimator: RatingEstimator = None,
        lctg_distilled: LCTGModel = None,
    ):
        super().__init__()
        self._warned_of = deque(maxlen=100)
        models = {"lctg": lctg, "dale": dale, "rating_estimator": rating_estimator, "lctg_distilled": lctg_distilled}
        check_classes({"feature_extractor": feature_extractor, **models})
        if dale is not None and dale_scheduler is None:
            raise ValueError("`dale_scheduler` is missing: DALE needs a scheduler of its own, beside `scheduler`.")
        if scheduler is not None and scheduler is dale_scheduler:
            raise ValueError("`scheduler` and `dale_scheduler` must be two objects: a scheduler has state.")
        check_fit(lctg, feature_extractor, dale, lctg_distilled)
        self.register_modules(
            feature_extractor=feature_extractor, scheduler=scheduler, dale_scheduler=dale_scheduler, **models
        )

    @property
    def _execution_device(self):
        # diffusers' own searches all modules for hooks, once for each component and more: half a step of DALE
        models = [self.lctg, self.dale, self.rating_estimator, self.lctg_distilled]
        if any(has_hooks(model) for model in models if model is not None):
            return super()._execution_device
        return next(self.lctg.parameters()).device

    @property
    def guidance_scale(self):
        """Guidance scale of the current or last call. A callback may change it: `pipe._guidance_scale = 1.0`."""
        return self._guidance_scale

    @property
    def _guidance(self):
        return Guidance(parse_guidance(self._guidance_scale, self.dale.config.rating_axes), self._guidance_rescale)

    @property
    def do_classifier_free_guidance(self):
        """Whether the current or last call evaluates DALE without ratings, or without some, too."""
        return self._guidance.active

    @property
    def num_timesteps(self):
        """Network evaluations (steps) of the current or last call, both stages together."""
        return self._num_timesteps

    @property
    def interrupt(self):
        """Set by a callback (`pipe._interrupt = True`) to skip the remaining steps."""
        return self._interrupt

    def check_inputs(
        self, num_textures_per_rating=1, duration_s=None, output_type="np", guidance_scale=1.0, guidance_rescale=0.0
    ):
        """Refuses impossible arguments of `__call__`, and schedulers that cannot sample the models.

        Ratings, steps, generators and latents are checked where they are read.

        Raises:
            ValueError: naming the argument, the value and what is allowed.
        """
        if self.dale is None:
            raise ValueError("This pipeline has no `dale`: it reconstructs (`pipe.reconstruct`), it cannot generate.")
        check_scheduler("dale_scheduler", self.dale_scheduler)
        check_scheduler("scheduler", self.scheduler)
        check_whole_number("num_textures_per_rating", num_textures_per_rating)
        parse_guidance(guidance_scale, self.dale.config.rating_axes)
        check_number("guidance_rescale", guidance_rescale, at_least=0, at_most=1)
        if guidance_rescale and not isinstance(self.dale_scheduler, VDDIMScheduler):
            found = type(self.dale_scheduler).__name__
            raise ValueError(f"`guidance_rescale` needs a VDDIMScheduler as `dale_scheduler`, got {found}.")
        if duration_s is not None:
            check_number("duration_s", duration_s, "seconds", above=0, at_most=LONGEST_SECONDS)
        if output_type not in ("np", "pt", "latent"):
            raise ValueError(f'`output_type` must be "np", "pt" or "latent", got {output_type!r}.')

    def _warn_once(self, topic, value, warn, *arguments):
        """Calls `warn(*arguments)` unless it was called for this value before: a stream calls the pipeline often."""
        if (topic, value) not in self._warned_of:
            self._warned_of.append((topic, value))
            warn(*arguments)

    def _warn_of_novel(self, ratings):
        self._warn_once("ratings", ratings.numpy().tobytes(), warn_of_novel_ratings, ratings, self.dale.config)

    def prepare_latents(self, shape, generator, device, dtype, latents=None, name="latents"):
        """The initial noise of a stage: drawn, or the caller's own, cast and moved. `_denoise` scales it.

        Raises:
            ValueError: if the caller's, the argument `name`, is not finite, not real or has another shape.
        """
        if latents is None:
            return draw_noise(shape, generator, device, dtype)
        check_noise(name, latents, shape)
        return latents.to(device=device, dtype=dtype)

    def _denoise(self, scheduler, velocity, latents, generator, bar, callback=None, callback_inputs=(), first_index=0):
        """The sampling loop of both stages, from standard normal noise to data.

        `velocity(model_input, step)` is the model's output at step 0, 1, ...; the callback counts from `first_index`.
        The state is float32 at least: half precision would round it at every step.
        """
        latents = latents.to(torch.promote_types(latents.dtype, torch.float32)) * scheduler.init_noise_sigma
        extra_step_kwargs = step_arguments(scheduler, generator)
        for step, t in enumerate(scheduler.timesteps):
            if self._interrupt:
                break
            model_output = velocity(scheduler.scale_model_input(latents, t), step)
            latents = scheduler.step(model_output, t, latents, **extra_step_kwargs, return_dict=False)[0]
            if callback is not None:
                tensors = {"latents": latents} if "latents" in callback_inputs else {}
                changed = (callback(self, first_index + step, t, tensors) or {}).pop("latents", latents)
                if not torch.is_tensor(changed) or changed.shape != latents.shape:
                    found = tuple(changed.shape) if torch.is_tensor(changed) else type(changed).__name__
                    raise ValueError(
                        f"`callback_on_step_end` must return `latents` as a tensor {tuple(latents.shape)}, got {found}."
                    )
                latents = changed
            bar.update()
        return latents

    @torch.no_grad()
    @replace_example_docstring(EXAMPLE_DOC_STRING)
    def __call__(
        self,
        ratings,
        num_inference_steps: int | None = None,
        num_latent_inference_steps: int | None = None,
        guidance_scale: float | dict[str, float] = 1.0,
        num_textures_per_rating: int = 1,
        duration_s: float | None = None,
        generator: torch.Generator | list[torch.Generator] | None = None,
        latents: torch.Tensor | None = None,
        output_type: str = "np",
        return_dict: bool = True,
        callback_on_step_end=None,
        callback_on_step_end_tensor_inputs: list[str] = ["latents"],  # noqa: B006 (diffusers' signature; never mutated)
        rating_scale: str = "z",
        guidance_rescale: float = 0.0,
    ):
        r"""
        Generates textures from ratings.

        Args:
            ratings: `[r, b, s]`, `[[r, b, s], ...]`, `{"roughness": 1.2}`, `[dict, ...]`, array, tensor or pandas, on
                `rating_scale`: roughness, bumpiness, slipperiness, larger = rougher, bumpier, more slippery. NaN or
                None = not specified; `None` for all = nothing specified.
            num_inference_steps (`int`, *optional*): steps of LCTG; `None` = what `lctg_distilled` takes, or 5 without
                one. More steps than those are `lctg`'s.
            num_latent_inference_steps (`int`, *optional*): steps of DALE; `None` = what it was distilled to, else
                `num_inference_steps`, or 5 if that is left out or a distilled decoder's.
            guidance_scale (`float` or `dict[str, float]`, *optional*, defaults to 1.0): above 1 exaggerates the
                ratings; 1.0 = off. A dict, `{"bumpiness": 1.5}`, does so for these axes alone. Above 3, levels leave
                the range of the training data (a warning says so).
            num_textures_per_rating (`int`, *optional*, defaults to 1): takes of each rating.
            duration_s (`float`, *optional*): seconds, at most an hour; `None` = one segment. Longer textures are
                continuous.
            generator (`torch.Generator` or list, *optional*): one generator draws (N, ...) noise for DALE, then for
                LCTG; a list has N entries, each draws its own DALE noise, then its own LCTG noise: as N single calls.
                Schedulers that add noise at every step, such as DDPM, draw it from the same generators.
            latents (`torch.Tensor`, *optional*): initial noise of DALE, (N, dale.config.in_channels, latent_frames).
            output_type (`str`, *optional*, defaults to `"np"`): `"np"`; `"pt"`, tensors on the pipeline's device; or
                `"latent"` for DALE's result as [`TactileLatents`] (LCTG is not run).
            return_dict (`bool`, *optional*, defaults to `True`): `False` gives a plain tuple of the same fields.
            callback_on_step_end (`Callable`, *optional*): `callback(pipe, step_index, timestep, callback_kwargs)` after
                each step of either stage; may return changed tensors, and may change the guidance for the steps that
                follow (`pipe._guidance_scale = 1.0`). Subclasses of diffusers' `PipelineCallback` work if their
                `tensor_inputs` are among those of this pipeline.
            callback_on_step_end_tensor_inputs (`list[str]`, *optional*): `["latents"]`: the current stage's state, of
                DALE (N, in_channels, frames), then of LCTG (N, 1, samples).
            rating_scale (`str`, *optional*, defaults to `"z"`): `"z"`, one rater's z-scores; `"raw"`, the 0-8 scale as
                the typical rater uses it; `"percentile"`, 0-100 % of the training surfaces' ratings.
            guidance_rescale (`float`, *optional*, defaults to 0.0): 0 to 1, how far the spread of what guidance
                predicts is brought back to that without guidance, so that levels stay in range.

        Returns:
            [`TactileTexturePipelineOutput`] with `textures` of shape (N, samples) in newtons, N = ratings x
            `num_textures_per_rating`; [`TactileLatents`] for `output_type="latent"`; or a tuple of their fields.

        Raises:
            ValueError: for any impossible argument, before any work starts.
            FloatingPointError: if textures overflow: a large `guidance_scale`, or `latents` far from unit variance.

        Examples:
        """
        if isinstance(callback_on_step_end, PipelineCallback | MultiPipelineCallbacks):
            callback_on_step_end_tensor_inputs = callback_on_step_end.tensor_inputs

        # 1. Check the arguments
        self.check_inputs(num_textures_per_rating, duration_s, output_type, guidance_scale, guidance_rescale)
        check_callback(callback_on_step_end, callback_on_step_end_tensor_inputs, self._callback_tensor_inputs)
        decoding_steps, latent_steps = self.resolve_steps(num_inference_steps, num_latent_inference_steps)
        self._warn_once("guidance_scale", guidance_scale, warn_of_strong_guidance, guidance_scale)
        self._guidance_scale, self._guidance_rescale = guidance_scale, float(guidance_rescale)
        self._interrupt = False

        # 2. Encode the ratings
        ratings = parse_ratings(ratings, self.dale.config, rating_scale)
        self._warn_of_novel(ratings)
        ratings = ratings.repeat_interleave(int(num_textures_per_rating), dim=0)
        generator = check_generator(generator, len(ratings))
        device, dtype = self._execution_device, self.dale.dtype
        ratings = ratings.to(device)

        # 3. Prepare timesteps and DALE's noise
        frames, samples = self._sizes(duration_s)
        shape = (len(ratings), self.dale.config.in_channels, frames)
        latents = self.prepare_latents(shape, generator, device, dtype, latents)
        self.dale_scheduler.set_timesteps(latent_steps, device=device)
        self._num_timesteps = dale_steps = len(self.dale_scheduler.timesteps)
        if output_type != "latent":
            self.scheduler.set_timesteps(decoding_steps, device=device)
            self._num_timesteps += len(self.scheduler.timesteps)

        with self.progress_bar(total=self._num_timesteps) as bar:
            loop = (generator, bar, callback_on_step_end, callback_on_step_end_tensor_inputs)
            # 4. DALE: from ratings to latents, level and friction coefficient
            velocity = rating_velocity(self.dale, self.dale_scheduler, ratings, frames, lambda: self._guidance)
            latents = self._denoise(self.dale_scheduler, velocity, latents, *loop)
            generated = TactileLatents(*self.dale.unpack(latents))
            generated.latents = self.lctg.pad_detail(generated.latents.to(dtype))
            if output_type == "latent":
                self.maybe_free_model_hooks()
                return generated if return_dict else generated.to_tuple()
            # 5. LCTG: from latents to the waveform
            decoder = self.decoder_of(decoding_steps)
            decoded = self._decode(decoder, generated.latents, None, *loop, dale_steps)

        # 6. Post-process: newtons at the delivery rate
        out = self._postprocess(*decoded, generated.level, generated.friction_coefficient, samples, output_type)
        self.maybe_free_model_hooks()
        return out if return_dict else out.to_tuple()

    def _sizes(self, duration_s):
        """Latent frames to generate and samples to deliver."""
        hop, rate = self.lctg.config.latent_hop, self.feature_extractor.sampling_rate
        if duration_s is None:
            frames = self.dale.config.latent_frames
            duration_s = frames * hop / rate
        else:
            # at least one window of the trained length; what is too much is cut off at the end
            size = self.dale.config.patch_size
            frames = max(self.dale.config.latent_frames, math.ceil(duration_s * rate / hop / size - 1e-6) * size)
        return frames, max(1, round(duration_s * self.feature_extractor.delivery_rate))

    def _decode(self, decoder, latents, noise, generator, bar, *callback):
        """LCTG's loop: latents (N, channels, frames) to waveforms (N, samples) at the working rate.

        Returns them with what they are to be given back (`LCTGModel.restored`).
        """
        dtype = decoder.dtype
        latents = latents.to(dtype)
        shape = (len(latents), 1, latents.shape[-1] * self.lctg.config.latent_hop)
        noise = self.prepare_latents(shape, generator, latents.device, dtype, noise, "noise")
        velocity = texture_velocity(decoder, latents, self.scheduler.timesteps)
        waveform = self._denoise(self.scheduler, velocity, noise, generator, bar, *callback)[:, 0]
        return waveform, decoder.restored(latents)

    def _postprocess(self, waveform, restored, level, friction_coefficient, samples, output_type):
        textures = self.feature_extractor.denormalize(waveform, level, samples, **restored)
        if not np.isfinite(textures).all():
            raise FloatingPointError(
                f"Textures overflow at `level` of up to {level.max():.4g} (log RMS in N). Look for a large "
                "`guidance_scale`, `latents` far from unit variance or a broken checkpoint."
            )
        if self.feature_extractor.fixed_scale:  # nothing was restored: the level is what was decoded
            level = torch.from_numpy(measured_level(textures)).to(level)
        numbers = textures, friction_coefficient, level
        return self._output(*numbers, self.feature_extractor.delivery_rate, output_type, waveform.device)

    def _output(self, textures, friction_coefficient, level, sampling_rate, output_type, device):
        """The output of textures (an array) and their numbers (tensors), as arrays or as tensors on a device."""
        numbers = torch.from_numpy(textures), friction_coefficient.float(), level.float()
        speed = None if self.dale is None else self.dale.config.reference_speed
        return TactileTexturePipelineOutput(
            *(values.to(device) if output_type == "pt" else values.cpu().numpy() for values in numbers),
            sampling_rate=sampling_rate,
            reference_speed=math.nan if speed is None else float(speed),
        )

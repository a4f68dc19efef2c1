"""The pipeline of what comes after the first texture: edit, mend, continue, close, vary."""

import math

import numpy as np
import torch
from diffusers.utils import replace_example_docstring

from ..schedulers import draw_noise
from ..signal import level as measured_level
from ..signal import resample
from ..signal.checks import check_number, check_whole_number, texture_rows
from .filling import LEAST_SECONDS, guessed, joined, lay_out, share_drawn
from .guidance import mean_scalars
from .inputs import LARGEST_RATING, check_generator, parse_ratings
from .pipeline_tactile_texture import TactileTexturePipeline
from .reconstruction import friction_of
from .recordings import check_recording, target_ratings

#: Powers of `strength`, beyond 1 for late: how a recording gives up its waveform and course; and its character, the
#: scalars that set it apart from others of its ratings.
COURSE_POWER, CHARACTER_POWER = 5, 20
#: How far the scalars are moved, in units of what DALE's scalars move by on average: one that is not calibrated falls
#: short of real surfaces (`examples/research/editing.py`).
GAIN = 1.25
#: The strength at which a take's scalars differ from the recording's as those of two real takes of a surface do.
VARIATION = 0.95
#: Draws over which the scalars of ratings are averaged where all of DALE draws them.
FEW_DRAWS = 8
#: Latent frames over which what is drawn anew takes over inside of a gap: of band levels, which are slow, 0.4 s; of the
#: rest, 0.1 s.
LEVEL_RAMP, RAMP = 16, 4

EXAMPLE_DOC_STRING = """
    Examples:
        ```py
        >>> from tactile_diffusers import TactileTextureEditPipeline, TactileTexturePipeline, bundled_checkpoint

        >>> pipe = TactileTexturePipeline.from_pretrained(bundled_checkpoint())
        >>> recording = pipe([[0.5, 0.0, 0.0]]).textures[0]  # or your own: N, band-passed
        >>> edit = TactileTextureEditPipeline.from_pipe(pipe)
        >>> rougher = edit(recording, 10000, {"roughness": +0.5}, rating_scale="difference", strength=0.5)
        >>> mended = edit(recording, 10000, mask=[(0.8, 0.9)])
        >>> longer, loop = edit(recording, 10000, continue_s=1.0), edit(recording, 10000, loop=True)
        >>> longer.textures.shape
        (1, 26384)
        ```
"""


class TactileTextureEditPipeline(TactileTexturePipeline):
    r"""
    Changes recordings by ratings, and fills, continues, closes and varies them, as diffusers' image-to-image and
    inpainting pipelines do. Components are those of [`TactileTexturePipeline`]; `from_pipe` leads there and back.

    A recording becomes DALE's state: scalars of the whole texture and fields of unit variance. The scalars are moved by
    what ratings move them on average, so that what is not asked for stays. The fields, and the decoded waveform, are
    turned from the recording's own towards those of a fresh take, by an angle that keeps their variance.
    """

    __module__ = "tactile_diffusers"  # as checkpoints name it

    @torch.no_grad()
    @replace_example_docstring(EXAMPLE_DOC_STRING)
    def __call__(
        self,
        texture: np.ndarray | torch.Tensor,
        sampling_rate: int,
        ratings=None,
        strength: float = 0.5,
        rating_scale: str = "z",
        source_ratings=None,
        friction_coefficient=None,
        mask=None,
        continue_s: float | None = None,
        loop: bool = False,
        num_inference_steps: int | None = None,
        num_latent_inference_steps: int | None = None,
        generator: torch.Generator | list[torch.Generator] | None = None,
        output_type: str = "np",
        return_dict: bool = True,
    ):
        r"""
        Edits recordings by ratings; or, with `mask`, `continue_s` or `loop`, fills what is missing of them.

        Args:
            texture (`np.ndarray` or `torch.Tensor`): (samples,) or (n, samples), N, band-passed; masked samples may be
                NaN. At least 0.25 s.
            sampling_rate (`int`): Hz.
            ratings (*optional*): those to be reached, of one texture or each, in any form that the texture pipeline
                takes; axes that are not specified stay, and so does all else as far as `strength` leaves it.
            strength (`float`, *optional*, defaults to 0.5): 0 = the reconstruction, 1 = a fresh take of the target
                ratings; in between, the change grows and the likeness falls. Of ratings alone: what is filled is new.
            rating_scale (`str`, *optional*, defaults to `"z"`): a scale of the texture pipeline, or `"difference"`:
                z-scores that are added to the recording's.
            source_ratings (*optional*): the recording's own, z-scores; `None`, or an axis that is not specified =
                estimated from it (`estimate_ratings`), unknown without an estimator.
            friction_coefficient (`float` or array, *optional*): of the recording, one number or (n,); `None` or NaN =
                unknown, and stays so below a strength of 1.
            mask (*optional*): what to make anew: pairs of start and stop in s, `[(0.8, 0.9), ...]`, or bool (samples,).
            continue_s (`float`, *optional*): s to append.
            loop (`bool`, *optional*, defaults to `False`): whether the end is to lead into the beginning. Up to 0.1 s
                on either side of the seam is made anew, or, with `continue_s`, what is appended and nothing else.
            num_inference_steps, num_latent_inference_steps (`int`, *optional*): as of the texture pipeline.
            generator (`torch.Generator` or list, *optional*): draws as that of the texture pipeline; a list has n.
            output_type (`str`, *optional*, defaults to `"np"`): `"np"`, or `"pt"`, tensors on the pipeline's device.
            return_dict (`bool`, *optional*, defaults to `True`): `False` gives a plain tuple of the same fields.

        Returns:
            [`TactileTexturePipelineOutput`]: edited textures at the delivery rate, as long as the recording; filled
            ones at the rate of the recording, whose known samples are the same bit for bit.

        Raises:
            ValueError: for any impossible argument, before any work starts.

        Examples:
        """
        strength = check_number("strength", strength, at_least=0, at_most=1)
        self.check_inputs(output_type=output_type)
        if output_type == "latent":
            raise ValueError('`output_type` must be "np" or "pt", got "latent": an edit mixes waveforms, too.')
        steps = {"num_inference_steps": num_inference_steps, "num_latent_inference_steps": num_latent_inference_steps}
        self.resolve_steps(**steps)
        filling = mask is not None or continue_s is not None or loop
        if filling and ratings is not None:
            raise ValueError("`ratings` must be left out with `mask`, `continue_s` or `loop`: edit in a call before.")
        extractor, config = self.feature_extractor, self.dale.config
        extractor.check_sampling_rate(sampling_rate)
        guesses = rows = texture_rows(texture)
        generator, friction = check_generator(generator, len(rows)), friction_of(friction_coefficient, len(rows))
        if rows.shape[-1] < LEAST_SECONDS * sampling_rate:
            seconds = rows.shape[-1] / sampling_rate
            raise ValueError(f"`texture` must last at least {LEAST_SECONDS} s, got {seconds:.3g} s.")
        if filling:
            laid_out = [lay_out(row, sampling_rate, mask, continue_s, loop) for row in rows]
            guesses = np.stack([guessed(row, missing) for row, missing, _ in laid_out])
        encoded = self.encode(guesses, sampling_rate)  # refuses NaN
        check_recording(guesses, sampling_rate, extractor, config)
        encoded.friction_coefficient = friction.to(encoded.level)
        given, source = self._source(source_ratings, encoded)
        target = source if filling else target_ratings(ratings, rating_scale, source, config)
        super()._warn_of_novel(torch.where(target == source, given, target))
        if filling:
            generators = generator if isinstance(generator, list) else [generator] * len(rows)
            filled = []
            for k in range(len(rows)):
                own = guesses[k], sampling_rate, _row(encoded, k), source[[k]], generators[k], steps
                filled.append(self._filled(*laid_out[k], *own))
            out = self._as_output(np.stack(filled), texture, sampling_rate, encoded, output_type)
        else:
            samples = max(1, round(rows.shape[-1] * extractor.delivery_rate / sampling_rate))
            common = {**steps, "generator": generator, "output_type": output_type}
            if strength == 1:
                out = super().__call__(target, duration_s=samples / extractor.delivery_rate, **common)
            else:
                out = self._edited(encoded, source, target, strength, samples, **common)
        self.maybe_free_model_hooks()
        return out if return_dict else out.to_tuple()

    def variations(self, texture, sampling_rate, n=4, strength=VARIATION, **options):
        """Other takes of a recording; by default they differ from it as real takes of one surface do.

        Args:
            texture (`np.ndarray` or `torch.Tensor`): (samples,), N.
            sampling_rate (`int`): Hz.
            n (`int`, *optional*, defaults to 4): how many.
            strength (`float`, *optional*, defaults to 0.95): less keeps more of the recording.
            options: of a call: `source_ratings`, `friction_coefficient`, `generator` (one, or a list of n), ...

        Returns:
            [`TactileTexturePipelineOutput`] of n textures.

        Raises:
            ValueError: as of a call, and for more than one texture.
        """
        n, row = check_whole_number("n", n), texture_rows(texture)
        if len(row) != 1:
            raise ValueError(f"`texture` must be one, (samples,), got {len(row)}.")
        return self(np.repeat(row, n, axis=0), sampling_rate, strength=strength, **options)

    def _warn_of_novel(self, ratings):
        """Nothing: takes inside of an edit are of estimates, too, and a call warns of what its caller gave."""

    def _source(self, ratings, encoded):
        """The recordings' own ratings, those that are given, and with estimates beside: (n, axes) each, on the CPU."""
        try:
            given = parse_ratings(ratings, self.dale.config)
        except ValueError as error:
            raise ValueError(str(error).replace("`ratings`", "`source_ratings`")) from error
        if len(given) not in (1, len(encoded.level)):
            raise ValueError(f"`source_ratings` must be of one texture or {len(encoded.level)}, got {len(given)}.")
        given = given.expand(len(encoded.level), -1)
        if self.rating_estimator is None or not given.isnan().any():
            return given, given
        estimated = torch.from_numpy(self._estimate(encoded, encoded.friction_coefficient))
        return given, torch.where(given.isnan(), estimated.clamp(-LARGEST_RATING, LARGEST_RATING), given)

    def _edited(self, encoded, source, target, strength, samples, generator, output_type, **steps):
        """Recordings on the way to fresh takes of the target ratings."""
        decoding, latent = self.resolve_steps(**steps)
        level, friction = encoded.level, encoded.friction_coefficient
        if strength == 0:
            return self.decode(encoded.latents, level, friction, decoding, generator, output_type, samples)
        frames, asked = encoded.latents.shape[-1], math.sin(0.5 * math.pi * strength)
        cos, sin = _turned(strength**COURSE_POWER)
        fresh = self._take(target, frames, generator, latent)
        (field, scalars, rest), (new_field, new_scalars, new_rest) = self._packed(encoded), self._packed(fresh)
        before, after = self._mean_scalars(torch.cat([source, target]), latent).chunk(2)
        keep, draw = _turned(strength**CHARACTER_POWER)
        character = keep * (scalars - before) + draw * (new_scalars - after)
        gain = GAIN if self.dale.config.calibration is None else 1.0
        scalars = before + gain * asked * (after - before) + character
        state = self.dale.append_scalars(cos * field + sin * new_field, scalars)
        latents, level, moved = self.dale.unpack(state)
        latents = self.lctg.pad_detail((latents + cos * rest + sin * new_rest)[..., :frames])

        decoder, device = self.decoder_of(decoding), latents.device
        self.scheduler.set_timesteps(decoding, device=device)
        shape = (len(latents), 1, frames * self.lctg.config.latent_hop)
        noise = self.prepare_latents(shape, generator, device, decoder.dtype).repeat(2, 1, 1)
        with self.progress_bar(total=len(self.scheduler.timesteps)) as bar:
            both = torch.cat([encoded.latents, latents.to(encoded.latents)])
            waveform, restored = self._decode(decoder, both, noise, None, bar)
        own, new = waveform.chunk(2)
        restored = {name: values if values is None else values.chunk(2)[1] for name, values in restored.items()}
        if restored["modulation_gain"] is not None:  # that of the share that is drawn anew
            restored["modulation_gain"] = 1 + sin**2 * (restored["modulation_gain"] - 1)
        friction = torch.where(friction.isnan(), friction, moved)
        return self._postprocess(cos * own + sin * new, restored, level, friction, samples, output_type)

    def _take(self, ratings, frames, generator, latent_steps):
        """DALE's latents of a fresh take, base layer: [`TactileLatents`] of so many frames."""
        seconds = frames * self.lctg.config.latent_hop / self.feature_extractor.sampling_rate
        options = {"num_latent_inference_steps": latent_steps, "duration_s": seconds, "output_type": "latent"}
        take = super().__call__(ratings, generator=generator, **options)
        take.latents = take.latents[..., :frames]
        return take

    def _packed(self, encoded):
        """Field and scalars of DALE's state of latents, and what of their base layer the state does not hold."""
        base = encoded.latents[:, : self.lctg.base_channels].to(self.dale.dtype)
        missing = -base.shape[-1] % self.dale.config.patch_size
        base = torch.cat([base, base[..., -1:].expand(-1, -1, missing)], dim=-1)
        state = self.dale.pack(base, encoded.level, encoded.friction_coefficient)
        return *self.dale.split_scalars(state), base - self.dale.unpack(state)[0]

    def _mean_scalars(self, ratings, latent_steps):
        """Mean of the scalars that DALE generates for ratings (n, axes), over the same noise for each: (n, scalars)."""
        dale, random = self.dale, torch.Generator("cpu").manual_seed(0)
        if dale.scalar_network is not None:
            return mean_scalars(dale, ratings.to(self._execution_device))
        noise = draw_noise((FEW_DRAWS, dale.config.in_channels, dale.config.latent_frames), random, "cpu", dale.dtype)
        options = {"num_latent_inference_steps": latent_steps, "num_textures_per_rating": FEW_DRAWS}
        takes = super().__call__(ratings, latents=noise.repeat(len(ratings), 1, 1), output_type="latent", **options)
        return self._packed(takes)[1].unflatten(0, (len(ratings), FEW_DRAWS)).mean(1)

    def _filled(self, texture, missing, shift, guess, sampling_rate, encoded, source, generator, steps):
        """A texture (samples,) whose missing samples are made anew, rolled back."""
        frames = encoded.latents.shape[-1]
        decoding, latent = self.resolve_steps(**steps)
        fresh = self._take(source, frames, generator, latent)
        (_, scalars, _), (new_field, _, new_rest) = self._packed(encoded), self._packed(fresh)
        drawn = self.dale.unpack(self.dale.append_scalars(new_field, scalars))[0] + new_rest
        own = encoded.latents[:, : self.lctg.base_channels].to(drawn)
        levels, rest = (torch.from_numpy(share_drawn(missing, frames, ramp)).to(own) for ramp in (LEVEL_RAMP, RAMP))
        share = torch.stack([levels] * self.lctg.level_channels + [rest] * (own.shape[1] - self.lctg.level_channels))
        share = share * math.pi / 2
        mean = own.mean(-1, keepdim=True)
        mixed = mean + share.cos() * (own - mean) + share.sin() * (drawn[..., :frames] - mean)
        out = self.decode(self.lctg.pad_detail(mixed), encoded.level, None, decoding, generator)
        drawn = resample(out.textures[0], out.sampling_rate, sampling_rate)[: len(texture)]
        centre = texture[~missing].mean()
        filled = joined(texture - centre, drawn, missing, guess - centre, sampling_rate) + centre
        return np.roll(np.where(missing, filled, texture), shift)

    def _as_output(self, textures, original, sampling_rate, encoded, output_type):
        """Filled textures in the dtype of the original, whose known samples are the same bit for bit."""
        dtype = original.numpy(force=True).dtype if isinstance(original, torch.Tensor) else np.asarray(original).dtype
        textures = textures.astype(np.float32 if dtype in (np.float16, np.float32) else np.float64)
        level = torch.from_numpy(measured_level(textures))
        numbers = textures, encoded.friction_coefficient, level
        return self._output(*numbers, sampling_rate, output_type, encoded.level.device)


def _turned(share):
    """Weights of what is kept and of what is drawn, whose squares add up to 1, for a share of the way."""
    return math.cos(0.5 * math.pi * share), math.sin(0.5 * math.pi * share)


def _row(encoded, k):
    """One texture of [`TactileLatents`], as a batch."""
    return type(encoded)(**{name: values[[k]] for name, values in encoded.items()})

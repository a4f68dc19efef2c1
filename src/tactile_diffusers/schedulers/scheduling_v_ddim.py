"""Sampling with v-prediction in the angle variable: DDIM as an exact rotation, and a second order at the same price."""

import math
from dataclasses import dataclass

import numpy as np
import torch
from diffusers.configuration_utils import ConfigMixin, FrozenDict, register_to_config
from diffusers.schedulers.scheduling_utils import SchedulerMixin
from diffusers.utils import BaseOutput
from diffusers.utils.torch_utils import randn_tensor

from ..signal.checks import check_whole_number
from .angles import to_angle, to_timestep

#: What `examples/research/sampler.py` found best on whitened textures: for new checkpoints.
RECOMMENDED = {"multistep_order": 2, "spacing": "both_ends"}
#: A damaged config may ask for any number, and the timesteps are a table.
MOST_TIMESTEPS = 1_000_000
SPACINGS = ("uniform", "both_ends")
#: "both_ends" lies half way between even and cosine steps: with more, order 2 amplifies components that are stronger
#: than average (by 1.5 dB at 4 steps for a plain cosine); with less, weak and strong ones fade.
COSINE_SHARE = 0.5
#: Largest difference in rad to the angles of another scheduler that counts as the same schedule: diffusers' cosine
#: schedule is offset by 0.008 of the way, 0.0125 rad.
SAME_SCHEDULE = 0.02
#: Largest weight of the second order; the spacings reach 1.5.
MOST_WEIGHT = 2.0
# arguments that say to diffusers' schedulers what was trained
_FOR_DIFFUSERS = ("prediction_type", "beta_schedule", "rescale_betas_zero_snr", "timestep_spacing", "clip_sample")
# largest distance at which a timestep counts as one of the scheduler's
_TOLERANCE = 1e-3


def draw_noise(shape, generator, device, dtype):
    """Standard normal noise, the same for every dtype: drawn as float32.

    Drawn as bfloat16, a seed gives other numbers where the count is no multiple of 16, and in torch 2.8 always.
    """
    return randn_tensor(shape, generator=generator, device=device, dtype=torch.float32).to(dtype)


def is_cosine(alphas_cumprod):
    """Whether a schedule, (n,), is that of cos^2 over n timesteps, to `SAME_SCHEDULE` rad."""
    angles = np.arccos(np.sqrt(np.clip(np.asarray(alphas_cumprod, dtype=np.float64), 0, 1)))
    return np.abs(angles - to_angle(np.arange(len(angles)), len(angles))).max() < SAME_SCHEDULE


@dataclass
class VDDIMSchedulerOutput(BaseOutput):
    """Output of `VDDIMScheduler.step`.

    Args:
        prev_sample (`torch.Tensor`): the sample at the next, less noisy time; feed it to the model.
        pred_original_sample (`torch.Tensor`): the clean sample x0 that the model predicts now.
    """

    prev_sample: torch.Tensor
    pred_original_sample: torch.Tensor | None = None


class VDDIMScheduler(SchedulerMixin, ConfigMixin):
    r"""
    Sampler for the v-objective (Salimans and Ho 2022, arXiv 2202.00512; DDIM: Song et al. 2021, arXiv 2010.02502).

    Time is the angle phi in [0, pi/2]: x = cos(phi) x0 + sin(phi) noise, v = dx/dphi = cos(phi) noise - sin(phi) x0.
    `timesteps` hold t = num_train_timesteps * phi / (pi/2) - 1, in [-1, num_train_timesteps - 1]. Fractions are exact:
    any number of steps starts at pure noise (zero terminal signal-to-noise ratio) and ends at clean data.

    In this variable x'' + x = g, where g vanishes while the model's prediction of data and noise stays the same. Order
    1 (DDIM) is the exact solution for g = 0, a rotation of (x, v). Order 2 takes the g that explains the last step and
    holds it for the next one (variation of constants). It needs no further network evaluation, and with the spacing
    `"both_ends"` it amplifies no component of the data by more than 0.3 dB from 4 steps on. The first step is of order
    1. The schedule is float64; the update has at least float32, whatever the model's dtype.

    This scheduler inherits from [`SchedulerMixin`] and [`ConfigMixin`]. Its config tells diffusers' schedulers what
    they need: `DDIMScheduler.from_config(scheduler.config)` samples the same model on diffusers' cosine schedule, which
    lags by up to 0.0125 rad; with `trained_betas=scheduler.betas.tolist()` on exactly this schedule.

    Args:
        num_train_timesteps (`int`, *optional*, defaults to 1000): length of the time axis.
        multistep_order (`int`, *optional*, defaults to 1): 1 is DDIM, 2 the second order.
        spacing (`str`, *optional*, defaults to `"uniform"`): of the angles: `"uniform"`, or `"both_ends"`, denser near
            pure noise and near clean data.
        prediction_type (`str`, *optional*, defaults to `"v_prediction"`): nothing else is possible.
        beta_schedule (`str`, *optional*, defaults to `"squaredcos_cap_v2"`): diffusers' name of the nearest schedule;
            nothing else is possible, unless `trained_betas` are given.
        trained_betas (`list[float]`, *optional*): of another scheduler's config; refused if their angles are not ours.
        rescale_betas_zero_snr, timestep_spacing, clip_sample (*optional*): for diffusers' schedulers; not used here.

    Attributes:
        betas, alphas_cumprod (`torch.Tensor`): (num_train_timesteps,) float32, this schedule as diffusers describes it.

    Raises:
        ValueError: if an argument is out of range, or a config of another scheduler belongs to another schedule.
    """

    __module__ = "tactile_diffusers"  # as checkpoints name it

    order = 1  # network evaluations per step
    _compatibles = ["DDIMScheduler", "DPMSolverMultistepScheduler"]

    @register_to_config
    def __init__(
        self,
        num_train_timesteps: int = 1000,
        multistep_order: int = 1,
        spacing: str = "uniform",
        prediction_type: str = "v_prediction",
        beta_schedule: str = "squaredcos_cap_v2",
        trained_betas: list[float] | None = None,
        rescale_betas_zero_snr: bool = True,
        timestep_spacing: str = "trailing",
        clip_sample: bool = False,
    ):
        check_whole_number("num_train_timesteps", num_train_timesteps, at_most=MOST_TIMESTEPS)
        if multistep_order not in (1, 2):
            raise ValueError(f"`multistep_order` must be 1 (DDIM) or 2, got {multistep_order}.")
        if spacing not in SPACINGS:
            raise ValueError(f"`spacing` must be one of {SPACINGS}, got {spacing!r}.")
        if prediction_type != "v_prediction":
            raise ValueError(f"`prediction_type` must be 'v_prediction', got {prediction_type!r}: train with v.")
        self._check_schedule(num_train_timesteps, beta_schedule, trained_betas)
        self._keep_for_diffusers()
        self.init_noise_sigma = 1.0
        self.num_inference_steps = None
        self.timesteps = torch.linspace(num_train_timesteps - 1, 0, num_train_timesteps)
        self._angles = None  # (steps + 1,) float64, from the first to 0
        self._begin_index = None
        self._restart()
        angles = to_angle(np.arange(-1, num_train_timesteps), num_train_timesteps)
        alphas_cumprod = np.append(np.square(np.cos(angles[:-1])), 0.0)  # exactly 0 at pure noise
        self.alphas_cumprod = torch.from_numpy(alphas_cumprod[1:].astype(np.float32))
        self.betas = torch.from_numpy((1 - alphas_cumprod[1:] / alphas_cumprod[:-1]).astype(np.float32))

    def _keep_for_diffusers(self):
        """Lets other classes replace defaults, as diffusers does, but not those that say what was trained."""
        left = set(self.config.get("_use_default_values", ())) - set(_FOR_DIFFUSERS)
        config = {name: value for name, value in self.config.items() if name != "_use_default_values"}
        self._internal_dict = FrozenDict({**config, "_use_default_values": sorted(left)} if left else config)

    def _restart(self):
        self._step_index = None
        self._last = None  # angle, x and v of the last step
        self._finite = None  # on accelerators: whether all model outputs were, a tensor there

    @classmethod
    def from_config(cls, config=None, return_unused_kwargs=False, **kwargs):
        """As [`ConfigMixin.from_config`], but what another scheduler left at its defaults counts as well.

        Raises:
            ValueError: if it is a scheduler of another prediction or schedule.
        """
        if isinstance(config, dict):
            config = {key: value for key, value in config.items() if key != "_use_default_values"}
        return super().from_config(config, return_unused_kwargs, **kwargs)

    @staticmethod
    def _check_schedule(length, beta_schedule, trained_betas):
        if trained_betas is None:
            if beta_schedule != "squaredcos_cap_v2":
                raise ValueError(
                    f"`beta_schedule` must be 'squaredcos_cap_v2', got {beta_schedule!r}: a model trained on another "
                    "schedule would be given the wrong times."
                )
            return
        alphas = np.cumprod(1 - np.asarray(trained_betas, dtype=np.float64))
        if len(alphas) != length or not is_cosine(alphas):
            raise ValueError(
                f"`trained_betas` must be those of cos^2 over {length} timesteps (`betas`), to {SAME_SCHEDULE} rad: "
                "a model trained on another schedule would be given the wrong times."
            )

    def __len__(self):
        return self.config.num_train_timesteps

    @property
    def step_index(self):
        """Index of the next step, `None` before the first."""
        return self._step_index

    @property
    def begin_index(self):
        """Index of the first step, set by a pipeline that starts part-way; `None` = found from the timestep."""
        return self._begin_index

    def set_begin_index(self, begin_index=0):
        """Starts the next loop at `timesteps[begin_index]`."""
        if begin_index is not None and not begin_index >= 0:
            raise ValueError(f"`begin_index` must be at least 0, got {begin_index}.")
        self._begin_index = begin_index
        self._restart()

    def angle(self, timesteps):
        """phi of timesteps, in their dtype if it is floating, else float32."""
        timesteps = timesteps if torch.is_floating_point(timesteps) else timesteps.float()
        # `to_angle`, rounded otherwise: guided textures of one seed stay the same bit for bit
        return (timesteps + 1) * (math.pi / 2 / self.config.num_train_timesteps)

    def timestep(self, angles):
        """Timesteps of angles phi in rad: the inverse of `angle`."""
        return to_timestep(angles, self.config.num_train_timesteps)

    def set_timesteps(self, num_inference_steps=None, device=None, timesteps=None):
        """Chooses the angles at which the model is evaluated; the end, 0, is not evaluated.

        Args:
            num_inference_steps (`int`, *optional*): any number >= 1, also above `num_train_timesteps`.
            device (`str` or `torch.device`, *optional*): where `timesteps` live.
            timesteps (`Sequence[float]`, *optional*): one's own, in place of a number of steps: falling, in
                (-1, num_train_timesteps - 1]. If the first is not the last trained one, sampling starts part-way.

        Raises:
            ValueError: if not exactly one of the two is given, `num_inference_steps` is not a whole number >= 1, or
                `timesteps` are not falling or out of range.
        """
        if (num_inference_steps is None) == (timesteps is None):
            raise ValueError("Give either `num_inference_steps` or `timesteps`, and not both.")
        if timesteps is None:
            if not (num_inference_steps >= 1 and num_inference_steps % 1 == 0):  # NaN and infinity fail too
                raise ValueError(f"`num_inference_steps` must be a whole number >= 1, got {num_inference_steps}.")
            angles = spaced_angles(int(num_inference_steps), self.config.spacing)
        else:
            angles = self._custom_angles(timesteps)
        self._angles = angles
        self.num_inference_steps = len(angles) - 1
        self.timesteps = torch.from_numpy(self.timestep(angles[:-1]).astype(np.float32)).to(device)
        self._begin_index = None
        self._restart()

    def _custom_angles(self, timesteps):
        values = torch.as_tensor(timesteps, dtype=torch.float64).cpu().numpy()
        last = self.config.num_train_timesteps - 1
        inside = values.ndim == 1 and len(values) and np.all((values > -1) & (values <= last + 1e-6))
        if not inside or not np.all(np.diff(values) < 0):
            raise ValueError(f"`timesteps` must fall, without repeats, inside (-1, {last}], got {values.tolist()}.")
        return np.append(to_angle(np.minimum(values, last), last + 1), 0.0)

    def scale_model_input(self, sample, timestep=None):
        """Returns `sample`: its variance is one at every angle."""
        return sample

    def _init_step_index(self, timestep):
        if self._begin_index is not None:
            self._step_index = self._begin_index
            return
        distance = (self.timesteps - torch.as_tensor(timestep).to(self.timesteps)).abs()
        index = int(distance.argmin())
        if not distance[index] <= _TOLERANCE:  # NaN fails too
            raise ValueError(f"`timestep` must be one of the timesteps {self.timesteps.tolist()}, got {timestep}.")
        self._step_index = index

    def step(self, model_output, timestep, sample, eta=0.0, generator=None, return_dict=True):
        """One step from the angle of `timestep` to the next smaller one.

        Args:
            model_output (`torch.Tensor`): the predicted velocity, any shape.
            timestep (`float` or `torch.Tensor`): the current entry of `timesteps`.
            sample (`torch.Tensor`): the current sample, the shape of `model_output`.
            eta (`float`, *optional*, defaults to 0.0): share of fresh noise, 0 (deterministic) to 1 (ancestral
                sampling), as in Song et al. 2021, equation 16; of order 1 only.
            generator (`torch.Generator` or list, *optional*): draws that noise.
            return_dict (`bool`, *optional*, defaults to `True`): `VDDIMSchedulerOutput` or `(prev_sample, x0)`.

        Raises:
            ValueError: before `set_timesteps`, after the last step, if the first timestep is not one of `timesteps`
                (comparing at every step would make an accelerator wait), or `eta` is out of range.
            FloatingPointError: if the model output is not finite: on the CPU at once, on accelerators, which would
                have to wait, after the last step.
        """
        if self.num_inference_steps is None:
            raise ValueError(
                "Number of inference steps is 'None', you need to run 'set_timesteps' after creating the scheduler"
            )
        if eta and (self.config.multistep_order != 1 or not 0 <= eta <= 1):
            raise ValueError(
                f"`eta` must be between 0 and 1, and 0 for multistep_order 2, got {eta} for multistep_order "
                f"{self.config.multistep_order}: fresh noise breaks what the second order continues."
            )
        # Notation of DDIM (arXiv 2010.02502) with alpha_bar = cos^2(phi), and of the v-objective (arXiv 2202.00512):
        # - angle -> phi
        # - following -> phi', the angle of the next step; turn -> phi - phi'
        # - sample (x) -> "x_phi"
        # - model_output (v) -> "v_theta(x_phi, phi)"
        # - pred_original_sample (x0) -> "x0_hat" = cos(phi) x_phi - sin(phi) v
        # - pred_epsilon (noise) -> "eps_hat" = sin(phi) x_phi + cos(phi) v
        # - prev_sample -> "x_phi'" = cos(phi') x0_hat + sin(phi') eps_hat = cos(turn) x_phi - sin(turn) v
        # - eta -> share of fresh noise; std_dev -> sigma of equation 16 in DDIM
        if self._step_index is None:
            self._init_step_index(timestep)
        if self._step_index >= self.num_inference_steps:
            raise ValueError("`step` was called after the last timestep; call `set_timesteps` to start again.")
        self._check_finite(model_output)
        angle, following = (float(value) for value in self._angles[self._step_index : self._step_index + 2])
        dtype = torch.promote_types(sample.dtype, torch.float32)
        x, v = sample.to(dtype), model_output.to(dtype)
        x0 = math.cos(angle) * x - math.sin(angle) * v
        if eta:
            prev_sample = self._noisy_step(angle, following, x, v, x0, eta, generator)
        else:
            prev_sample = self._rotation(angle, following, x, v)
        self._last = None
        if self.config.multistep_order == 2:
            past = angle - following
            # a tensor of our own: the caller may write into x and v
            self._last = (past, math.cos(past) * v + math.sin(past) * x)
        self._step_index += 1
        prev_sample, x0 = prev_sample.to(sample.dtype), x0.to(sample.dtype)
        if not return_dict:
            return (prev_sample, x0)
        return VDDIMSchedulerOutput(prev_sample=prev_sample, pred_original_sample=x0)

    def _rotation(self, angle, following, x, v):
        """The solution of x'' + x = g for the forcing g that explains the last step, 0 if there was none.

        g = (cos(past) v_last + sin(past) x_last - v) / sin(past), times 1 - cos(turn). A long step after a very short
        one would divide the model's errors by the short one: it is of order 1.
        """
        turn = angle - following
        a, b = math.cos(turn), -math.sin(turn)
        if self._last is None or not 1 - a <= MOST_WEIGHT * math.sin(self._last[0]):
            return a * x + b * v
        past, turned = self._last
        share = (1 - a) / math.sin(past)
        return a * x + (b - share) * v + share * turned

    def _noisy_step(self, angle, following, x, v, x0, eta, generator):
        """DDIM with fresh noise in place of a part of the predicted one."""
        ratio = math.sin(following) / math.sin(angle)
        std_dev = eta * ratio * math.sqrt(max(0.0, 1 - (math.cos(angle) / math.cos(following)) ** 2))
        noise = math.sin(angle) * x + math.cos(angle) * v
        fresh = draw_noise(x.shape, generator, x.device, x.dtype)
        kept = math.sqrt(max(0.0, math.sin(following) ** 2 - std_dev**2))
        return math.cos(following) * x0 + kept * noise + std_dev * fresh

    def _check_finite(self, model_output):
        finite = torch.isfinite(model_output).all()
        if model_output.device.type != "cpu":  # reading it now would make the accelerator wait at every step
            self._finite = finite if self._finite is None else self._finite & finite
            if self._step_index < self.num_inference_steps - 1:
                return
            finite = self._finite
        if not finite:
            where = (
                f"step {self._step_index} of {self.num_inference_steps} (timestep {self.timesteps[self._step_index]:g})"
            )
            if model_output.device.type != "cpu":
                where = f"one of the {self.num_inference_steps} steps"
            raise FloatingPointError(
                f"`model_output` holds NaN or infinity at {where}. Look for overflow (half precision, a large guidance "
                "scale) or a broken checkpoint."
            )

    def _cos_sin(self, timesteps, like):
        timesteps = torch.as_tensor(timesteps).to(like.device)
        angle = self.angle(timesteps.double() if like.device.type != "mps" else timesteps.float())
        shape, dtype = (-1, *([1] * (like.ndim - 1))), torch.promote_types(like.dtype, torch.float32)
        return angle.cos().to(dtype).reshape(shape), angle.sin().to(dtype).reshape(shape)

    def _mix(self, first, second, timesteps, inverse=False):
        """cos(phi) first + sin(phi) second, or minus, in at least float32; the dtype of `first`."""
        cos, sin = self._cos_sin(timesteps, first)
        first_, second_ = first.to(cos.dtype), second.to(cos.dtype)
        return (cos * first_ - sin * second_ if inverse else cos * first_ + sin * second_).to(first.dtype)

    def add_noise(self, original_samples, noise, timesteps):
        """x = cos(phi) x0 + sin(phi) noise.

        Args:
            original_samples, noise (`torch.Tensor`): (batch, ...), the same shape.
            timesteps (`torch.Tensor`): (batch,) or scalar, t in [-1, num_train_timesteps - 1], fractions allowed.
        """
        return self._mix(original_samples, noise, timesteps)

    def get_velocity(self, sample, noise, timesteps):
        """v = cos(phi) noise - sin(phi) x0 for the clean `sample` x0; shapes as in `add_noise`."""
        return self._mix(noise, sample, timesteps, inverse=True).to(sample.dtype)

    def get_original_sample(self, model_output, sample, timesteps):
        """x0 = cos(phi) x - sin(phi) v for the noisy `sample` x; shapes as in `add_noise`."""
        return self._mix(sample, model_output, timesteps, inverse=True)

    def get_noise(self, model_output, sample, timesteps):
        """noise = cos(phi) v + sin(phi) x for the noisy `sample` x; shapes as in `add_noise`."""
        return self._mix(model_output, sample, timesteps).to(sample.dtype)


def spaced_angles(steps, spacing="uniform"):
    """Angles from pi/2 to 0: (steps + 1,) float64, falling; both ends exact.

    Args:
        steps (`int`): at least 1.
        spacing (`str`): one of `SPACINGS`.
    """
    fractions = np.linspace(1.0, 0.0, steps + 1)
    if spacing == "both_ends":
        fractions = (1 - COSINE_SHARE) * fractions + COSINE_SHARE * (1 - np.cos(math.pi * fractions)) / 2
    return math.pi / 2 * fractions

"""DDIM for v-prediction, in the angle variable: each step is an exact rotation."""

import math
from dataclasses import dataclass

import numpy as np
import torch
from diffusers.configuration_utils import ConfigMixin, register_to_config
from diffusers.schedulers.scheduling_utils import SchedulerMixin
from diffusers.utils import BaseOutput


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
    Deterministic sampler for the v-objective (Salimans and Ho 2022, arXiv 2202.00512; DDIM: Song et al. 2021).

    Time is the angle phi in [0, pi/2]: x = cos(phi) x0 + sin(phi) noise, v = dx/dphi = cos(phi) noise - sin(phi) x0.
    `timesteps` hold t = num_train_timesteps * phi / (pi/2) - 1, in [-1, num_train_timesteps - 1]; fractions are exact,
    so that any number of steps starts at pure noise (zero terminal signal-to-noise ratio) and ends at clean data.
    The schedule is float64, the update float32 whatever the model's dtype. This scheduler inherits from
    [`SchedulerMixin`] and [`ConfigMixin`].

    Args:
        num_train_timesteps (`int`, *optional*, defaults to 1000): length of the time axis.
        solver_order (`int`, *optional*, defaults to 1): 1 is DDIM. No other order is available yet.
    """

    order = 1
    _compatibles = []

    @register_to_config
    def __init__(self, num_train_timesteps: int = 1000, solver_order: int = 1):
        if num_train_timesteps < 1:
            raise ValueError(f"`num_train_timesteps` must be at least 1, got {num_train_timesteps}.")
        if solver_order != 1:
            raise ValueError(f"`solver_order` must be 1 (DDIM), got {solver_order}.")
        self.init_noise_sigma = 1.0
        self.num_inference_steps = None
        self.timesteps = torch.linspace(num_train_timesteps - 1, 0, num_train_timesteps)
        self._angles = None  # (num_inference_steps + 1,) float64, from pi/2 to 0
        self._step_index = None
        self._begin_index = None

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
        self._begin_index = begin_index

    def angle(self, timesteps):
        """phi = pi/2 * (t + 1) / num_train_timesteps, in the dtype of `timesteps` if floating, else float32."""
        timesteps = timesteps if torch.is_floating_point(timesteps) else timesteps.float()
        return (timesteps + 1) * (math.pi / 2 / self.config.num_train_timesteps)

    def set_timesteps(self, num_inference_steps, device=None):
        """Chooses `num_inference_steps` angles, evenly spaced from pi/2 down (the end, 0, is not evaluated).

        Args:
            num_inference_steps (`int`): any number >= 1, also above `num_train_timesteps`.
            device (`str` or `torch.device`, *optional*): where `timesteps` live.

        Raises:
            ValueError: if `num_inference_steps` is not a whole number >= 1.
        """
        if not (num_inference_steps >= 1 and num_inference_steps % 1 == 0):  # NaN and infinity fail too
            raise ValueError(f"`num_inference_steps` must be a whole number >= 1, got {num_inference_steps}.")
        self.num_inference_steps = int(num_inference_steps)
        self._angles = np.linspace(math.pi / 2, 0.0, self.num_inference_steps + 1)
        timesteps = self._angles[:-1] / (math.pi / 2) * self.config.num_train_timesteps - 1
        self.timesteps = torch.from_numpy(timesteps.astype(np.float32)).to(device)
        self._step_index = None
        self._begin_index = None

    def scale_model_input(self, sample, timestep=None):
        """Returns `sample`: its variance is one at every angle."""
        return sample

    def _init_step_index(self, timestep):
        if self._begin_index is not None:
            self._step_index = self._begin_index
            return
        distance = (self.timesteps - torch.as_tensor(timestep).to(self.timesteps)).abs()
        self._step_index = int(distance.argmin())
        if not distance[self._step_index] <= 1e-3:  # NaN fails too
            raise ValueError(
                f"`timestep` must be one of the scheduler's timesteps {self.timesteps.tolist()}, got {timestep}."
            )

    def step(self, model_output, timestep, sample, return_dict=True):
        """One step from the angle of `timestep` to the next smaller one.

        Args:
            model_output (`torch.Tensor`): the predicted velocity v, any shape.
            timestep (`float` or `torch.Tensor`): the current entry of `timesteps`.
            sample (`torch.Tensor`): the current sample x, the shape of `model_output`.
            return_dict (`bool`, *optional*, defaults to `True`): `VDDIMSchedulerOutput` or `(prev_sample, x0)`.

        Raises:
            ValueError: before `set_timesteps`, after the last step, or if the first timestep is not one of `timesteps`
                (comparing at every step would make an accelerator wait).
        """
        if self.num_inference_steps is None:
            raise ValueError(
                "Number of inference steps is 'None', you need to run 'set_timesteps' after creating the scheduler"
            )
        if self._step_index is None:
            self._init_step_index(timestep)
        if self._step_index >= self.num_inference_steps:
            raise ValueError("`step` was called after the last timestep; call `set_timesteps` to start again.")
        angle, next_angle = self._angles[self._step_index], self._angles[self._step_index + 1]
        turn = angle - next_angle
        x, v = sample.float(), model_output.float()
        # x0 = cos(phi) x - sin(phi) v and noise = sin(phi) x + cos(phi) v, put together again at the next angle:
        # a rotation of (x, v), with no division that could reach zero
        prev_sample = math.cos(turn) * x - math.sin(turn) * v
        pred_original_sample = math.cos(angle) * x - math.sin(angle) * v
        self._step_index += 1
        prev_sample = prev_sample.to(sample.dtype)
        if not return_dict:
            return (prev_sample, pred_original_sample)
        return VDDIMSchedulerOutput(prev_sample=prev_sample, pred_original_sample=pred_original_sample)

    def _cos_sin(self, timesteps, like):
        timesteps = torch.as_tensor(timesteps).to(like.device)
        angle = self.angle(timesteps.double() if like.device.type != "mps" else timesteps.float())
        shape = (-1, *([1] * (like.ndim - 1)))
        return angle.cos().float().reshape(shape), angle.sin().float().reshape(shape)

    def add_noise(self, original_samples, noise, timesteps):
        """x = cos(phi) x0 + sin(phi) noise.

        Args:
            original_samples, noise (`torch.Tensor`): (batch, ...), the same shape.
            timesteps (`torch.Tensor`): (batch,) or scalar, t in [-1, num_train_timesteps - 1], fractions allowed.
        """
        cos, sin = self._cos_sin(timesteps, original_samples)
        return (cos * original_samples.float() + sin * noise.float()).to(original_samples.dtype)

    def get_velocity(self, sample, noise, timesteps):
        """v = cos(phi) noise - sin(phi) x0 for the clean `sample` x0; shapes as in `add_noise`."""
        cos, sin = self._cos_sin(timesteps, sample)
        return (cos * noise.float() - sin * sample.float()).to(sample.dtype)

    def get_original_sample(self, model_output, sample, timesteps):
        """x0 = cos(phi) x - sin(phi) v for the noisy `sample` x; shapes as in `add_noise`."""
        cos, sin = self._cos_sin(timesteps, sample)
        return (cos * sample.float() - sin * model_output.float()).to(sample.dtype)

"""Which schedulers of diffusers can sample the models: those for v-prediction on the cosine schedule."""

import inspect

import numpy as np
import torch

from ..schedulers.angles import to_angle
from ..schedulers.scheduling_v_ddim import SAME_SCHEDULE

#: Schedulers of diffusers that look as if they could sample the models, and why they cannot.
_REFUSED = {
    "DDIMInverseScheduler": "it adds noise instead of removing it",
    "DPMSolverMultistepInverseScheduler": "it adds noise instead of removing it",
    "DPMSolverSDEScheduler": "`generator` does not reach its noise",
    "KDPM2AncestralDiscreteScheduler": "it diverges from pure noise",
    "UnCLIPScheduler": "it does not know v-prediction",
}


def check_other_scheduler(name, scheduler):
    """Raises a `ValueError` that says why a scheduler cannot be the component `name`, and which can."""
    kind, config = type(scheduler).__name__, getattr(scheduler, "config", {})
    others = "Use VDDIMScheduler, DDIMScheduler, DPMSolverMultistepScheduler or EulerDiscreteScheduler"
    if kind in _REFUSED:
        raise ValueError(f"`{name}` must not be a {kind}: {_REFUSED[kind]}. {others}.")
    alphas = getattr(scheduler, "alphas_cumprod", None)
    flow = config.get("use_flow_sigmas") or config.get("sigma_data") is not None or "prediction_type" not in config
    if alphas is None or flow or not _takes_three_arguments(scheduler):
        raise ValueError(
            f"`{name}` must not be a {kind}{' with flow sigmas' if config.get('use_flow_sigmas') else ''}: it samples "
            f"models with another objective than v-prediction on the cosine schedule. {others}."
        )
    remedy = f"Make it by `{kind}.from_config(pipe.{name}.config)`."
    if config["prediction_type"] != "v_prediction":
        raise ValueError(
            f"`{name}` must have `prediction_type` 'v_prediction', got a {kind} with {config['prediction_type']!r}. "
            f"{remedy}"
        )
    if kind == "HeunDiscreteScheduler" and not config.use_exponential_sigmas:
        raise ValueError(
            f"`{name}` must have `use_exponential_sigmas` if it is a {kind}: its first step from pure noise diverges "
            f"otherwise. Make it by `{kind}.from_config(pipe.{name}.config, use_exponential_sigmas=True)`."
        )
    angles = np.arccos(np.sqrt(np.clip(np.asarray(torch.as_tensor(alphas).cpu(), np.float64), 0, 1)))
    ours = to_angle(np.arange(len(angles)), len(angles))
    if not np.abs(angles - ours).max() < SAME_SCHEDULE:
        raise ValueError(
            f"`{name}` must have the noise schedule that the models were trained on (`beta_schedule` "
            f"'squaredcos_cap_v2'), got a {kind} with {config.get('beta_schedule')!r}. {remedy}"
        )


def _takes_three_arguments(scheduler):
    """Whether `step` needs nothing but the model's output, the timestep and the sample."""
    further = list(inspect.signature(scheduler.step).parameters.values())[3:]
    return all(each.default is not each.empty or each.kind is each.VAR_KEYWORD for each in further)

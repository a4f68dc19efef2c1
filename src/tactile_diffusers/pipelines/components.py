"""Which components make a pipeline: models that fit each other, and schedulers that can sample them."""

import inspect

import torch

from ..features import TactileFeatureExtractor
from ..models import DALEModel, LCTGModel, RatingEstimator
from ..schedulers import VDDIMScheduler
from ..schedulers.scheduling_v_ddim import is_cosine

#: The class of every component that is not a scheduler; whether it may be missing.
_CLASSES = {
    "lctg": (LCTGModel, False),
    "feature_extractor": (TactileFeatureExtractor, False),
    "dale": (DALEModel, True),
    "lctg_distilled": (LCTGModel, True),
    "rating_estimator": (RatingEstimator, True),
}


def check_classes(components):
    """Raises a `ValueError` naming the component that is missing or of a wrong class.

    Args:
        components (`dict`): name -> component, without schedulers.
    """
    for name, component in components.items():
        cls, optional = _CLASSES[name]
        if component is None and optional:
            continue
        if not isinstance(getattr(component, "_orig_mod", component), cls):  # what torch.compile has wrapped
            raise ValueError(f"`{name}` must be a {cls.__name__}, got {type(component).__name__}.")


def check_fit(lctg, feature_extractor, dale, lctg_distilled=None):
    """Raises a `ValueError` naming the component that does not fit the others."""
    for model, decoder in (("lctg", lctg), ("lctg_distilled", lctg_distilled)):
        for name, expected in feature_extractor.lctg_geometry.items():
            if decoder is not None and decoder.config[name] != expected:
                raise ValueError(
                    f"`feature_extractor` does not fit `{model}`: it asks for `{name}` = {expected}, "
                    f"{model}.config.{name} is {decoder.config[name]}. They belong to different checkpoints."
                )
    if lctg_distilled is not None and lctg_distilled.config.distilled_steps is None:
        raise ValueError("`lctg_distilled` must be a distilled decoder (examples/distill.py): it has no steps.")
    if dale is not None and dale.latent_channels != lctg.base_channels:
        raise ValueError(
            f"`dale` does not fit `lctg`: it generates {dale.latent_channels} latent channels, LCTG decodes from "
            f"{lctg.base_channels}. They belong to different checkpoints."
        )


def check_scheduler(name, scheduler):
    """Raises a `ValueError` unless a scheduler can sample the models: v-prediction on the cosine schedule.

    `VDDIMScheduler` can. So can most of diffusers' schedulers if they are made by
    `Scheduler.from_config(pipe.scheduler.config)`; those for flow matching, EDM and other objectives cannot.
    """
    if not isinstance(scheduler, VDDIMScheduler):
        check_other_scheduler(name, scheduler)


def step_arguments(scheduler, generator):
    """Keyword arguments of `scheduler.step` beside the usual three, as far as this scheduler takes them."""
    return {"generator": generator} if "generator" in inspect.signature(scheduler.step).parameters else {}


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
    if not is_cosine(torch.as_tensor(alphas).cpu()):
        raise ValueError(
            f"`{name}` must have the noise schedule that the models were trained on (`beta_schedule` "
            f"'squaredcos_cap_v2'), got a {kind} with {config.get('beta_schedule')!r}. {remedy}"
        )


def _takes_three_arguments(scheduler):
    """Whether `step` needs nothing but the model's output, the timestep and the sample."""
    further = list(inspect.signature(scheduler.step).parameters.values())[3:]
    return all(each.default is not each.empty or each.kind is each.VAR_KEYWORD for each in further)

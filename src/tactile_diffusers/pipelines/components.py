"""Which components make a pipeline: models that fit each other, and schedulers that can sample them."""

import inspect

from ..features import TactileFeatureExtractor
from ..models import DALEModel, LCTGModel, RatingEstimator
from ..schedulers import VDDIMScheduler

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
        from .other_schedulers import check_other_scheduler

        check_other_scheduler(name, scheduler)


def step_arguments(scheduler, generator):
    """Keyword arguments of `scheduler.step` beside the usual three, as far as this scheduler takes them."""
    return {"generator": generator} if "generator" in inspect.signature(scheduler.step).parameters else {}

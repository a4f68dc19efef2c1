"""tactile_diffusers: touchable surface textures from perceptual ratings.

Public names are imported when they are first asked for: playing and exporting need neither torch nor diffusers, which
take seconds. The classes name `tactile_diffusers` as their module, as checkpoints do, so that files may move without
breaking them. diffusers' loader looks for its base classes in this namespace, too.
"""

import importlib
from typing import TYPE_CHECKING

from .checkpoints import bundled_checkpoint
from .version import __version__

if TYPE_CHECKING:  # for editors and type checkers
    from .features import TactileFeatureExtractor
    from .models import DALEModel, LCTGModel, RatingEstimator
    from .pipelines import (
        TactileLatents,
        TactileTextureEditPipeline,
        TactileTexturePipeline,
        TactileTexturePipelineOutput,
    )
    from .schedulers import VDDIMScheduler

#: Public name, or base class that the loader looks for -> its module.
_PLACES = {
    "DALEModel": ".models",
    "LCTGModel": ".models",
    "RatingEstimator": ".models",
    "TactileFeatureExtractor": ".features",
    "TactileLatents": ".pipelines",
    "TactileTextureEditPipeline": ".pipelines",
    "TactileTexturePipeline": ".pipelines",
    "TactileTexturePipelineOutput": ".pipelines",
    "VDDIMScheduler": ".schedulers",
    "ModelMixin": "diffusers.models.modeling_utils",
    "SchedulerMixin": "diffusers.schedulers.scheduling_utils",
    "FeatureExtractionMixin": "transformers.feature_extraction_utils",
}
__all__ = [
    "DALEModel",
    "LCTGModel",
    "RatingEstimator",
    "TactileFeatureExtractor",
    "TactileLatents",
    "TactileTextureEditPipeline",
    "TactileTexturePipeline",
    "TactileTexturePipelineOutput",
    "VDDIMScheduler",
    "__version__",
    "bundled_checkpoint",
]


def __getattr__(name):
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = globals()[name] = getattr(importlib.import_module(_PLACES[name], __name__), name)
    return found


def __dir__():
    return sorted({*globals(), *__all__})

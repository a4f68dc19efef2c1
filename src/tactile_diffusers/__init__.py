"""tactile_diffusers: touchable surface textures from perceptual ratings.

Public names are imported when they are first asked for: playing and exporting need neither torch nor diffusers, which
take seconds. The classes name `tactile_diffusers` as their module, as checkpoints do, so that files may move without
breaking them. diffusers' loader looks for its base classes in this namespace, too.
"""

from typing import TYPE_CHECKING

from .checkpoints import bundled_checkpoint
from .lazy import importing
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

#: Module -> public names, or base classes that the loader looks for.
_PLACES = {
    ".features": ("TactileFeatureExtractor",),
    ".models": ("DALEModel", "LCTGModel", "RatingEstimator"),
    ".pipelines": (
        *("TactileLatents", "TactileTextureEditPipeline", "TactileTexturePipeline", "TactileTexturePipelineOutput"),
    ),
    ".schedulers": ("VDDIMScheduler",),
    "diffusers.models.modeling_utils": ("ModelMixin",),
    "diffusers.schedulers.scheduling_utils": ("SchedulerMixin",),
    "transformers.feature_extraction_utils": ("FeatureExtractionMixin",),
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


__getattr__ = importing(__name__, _PLACES)


def __dir__():
    return sorted({*globals(), *__all__})

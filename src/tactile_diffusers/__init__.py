"""tactile_diffusers: touchable surface textures from perceptual ratings.

Public classes are imported eagerly: diffusers loads only what is already imported, and a checkpoint names them as
`tactile_diffusers.<Class>`, so that files may move without breaking saved checkpoints. For that the loader looks for
the base classes in this namespace too.
"""

from diffusers.models.modeling_utils import ModelMixin  # noqa: F401 (the loader's base classes, see above)
from diffusers.schedulers.scheduling_utils import SchedulerMixin  # noqa: F401
from transformers.feature_extraction_utils import FeatureExtractionMixin  # noqa: F401

from .checkpoints import bundled_checkpoint
from .features import TactileFeatureExtractor
from .models import DALEModel, LCTGModel, RatingEstimator
from .pipelines import (
    TactileLatents,
    TactileTextureEditPipeline,
    TactileTexturePipeline,
    TactileTexturePipelineOutput,
)
from .schedulers import VDDIMScheduler
from .version import __version__

_PIPELINES = (TactileTexturePipeline, TactileTextureEditPipeline)
for _public in (DALEModel, LCTGModel, RatingEstimator, TactileFeatureExtractor, VDDIMScheduler, *_PIPELINES):
    _public.__module__ = __name__
del _public

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

"""The pipeline, its outputs and ratings to start from."""

from .loading import find_decoders
from .pipeline_output import TactileLatents, TactileTexturePipelineOutput
from .pipeline_tactile_texture import TactileTexturePipeline
from .presets import PRESETS

__all__ = ["PRESETS", "TactileLatents", "TactileTexturePipeline", "TactileTexturePipelineOutput", "find_decoders"]

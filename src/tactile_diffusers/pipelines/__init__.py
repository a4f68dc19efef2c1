"""The pipeline and its outputs."""

from .pipeline_output import TactileLatents, TactileTexturePipelineOutput
from .pipeline_tactile_texture import TactileTexturePipeline

__all__ = ["TactileLatents", "TactileTexturePipeline", "TactileTexturePipelineOutput"]

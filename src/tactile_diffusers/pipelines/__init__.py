"""The pipeline, its outputs and ratings to start from."""

from .pipeline_output import TactileLatents, TactileTexturePipelineOutput
from .pipeline_tactile_texture import TactileTexturePipeline
from .pipeline_tactile_texture_edit import TactileTextureEditPipeline

__all__ = [
    "PRESETS",
    "TactileLatents",
    "TactileTextureEditPipeline",
    "TactileTexturePipeline",
    "TactileTexturePipelineOutput",
]


def __getattr__(name):
    """Imports what generating does not use when it is first asked for."""
    if name == "PRESETS":
        from .presets import PRESETS

        return PRESETS
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

"""The pipelines, their outputs and ratings to start from, each imported when it is first asked for."""

import importlib

_PLACES = {
    "PRESETS": ".presets",
    "TactileLatents": ".pipeline_output",
    "TactileTextureEditPipeline": ".pipeline_tactile_texture_edit",
    "TactileTexturePipeline": ".pipeline_tactile_texture",
    "TactileTexturePipelineOutput": ".pipeline_output",
}
__all__ = list(_PLACES)


def __getattr__(name):
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = globals()[name] = getattr(importlib.import_module(_PLACES[name], __name__), name)
    return found

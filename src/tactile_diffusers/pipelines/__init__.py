"""The pipelines and their outputs, each imported when it is first asked for, and ratings to start from."""

import importlib

_PLACES = {
    "TactileLatents": ".pipeline_output",
    "TactileTextureEditPipeline": ".pipeline_tactile_texture_edit",
    "TactileTexturePipeline": ".pipeline_tactile_texture",
    "TactileTexturePipelineOutput": ".pipeline_output",
}
__all__ = ["PRESETS", *_PLACES]

#: Name -> (roughness, bumpiness, slipperiness) in z-scores; `None` = not specified. Chosen by hand for what such a
#: surface may feel like, within what the bundled checkpoint was trained on. They are not measurements.
PRESETS = {
    "glass": (-1.5, -0.9, -0.9),
    "polished metal": (-1.2, -0.7, 0.3),
    "writing paper": (-0.5, -0.8, 0.9),
    "planed wood": (0.2, -0.3, 0.5),
    "denim": (0.9, 0.5, 0.3),
    "sandpaper": (1.6, 0.1, -0.6),
    "rubber": (-0.2, -0.3, -1.5),
    "corduroy": (0.4, 1.1, 0.3),
    "engraved grating": (0.5, 1.6, 0.4),
    "rough, whatever else": (1.3, None, None),
}


def __getattr__(name):
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = globals()[name] = getattr(importlib.import_module(_PLACES[name], __name__), name)
    return found

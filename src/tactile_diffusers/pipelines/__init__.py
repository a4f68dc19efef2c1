"""The pipelines and their outputs, each imported when it is first asked for, and ratings to start from."""

from ..lazy import importing

_PLACES = {
    ".pipeline_output": ("TactileLatents", "TactileTexturePipelineOutput"),
    ".pipeline_tactile_texture": ("TactileTexturePipeline",),
    ".pipeline_tactile_texture_edit": ("TactileTextureEditPipeline",),
}
__all__ = sorted(("PRESETS", *(name for names in _PLACES.values() for name in names)))
__getattr__ = importing(__name__, _PLACES)

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

"""The sections of a report: each measures one thing on one `Context` and returns leaves under top-level keys."""

from . import control, generation, latents, long_textures, novel, paper, reconstruction, regression, robustness, speed
from .anchors import Anchor
from .context import FULL, QUICK, Context, Settings

#: name -> function of a context that returns `{top-level key: ...}`
SECTIONS = {
    "reconstruction": reconstruction.run,
    "generation": generation.run,
    "control": control.run,
    "regression": regression.run,
    "novel": novel.run,
    "paper": paper.run,
    "speed": speed.run,
    "long_textures": long_textures.run,
    "latents": latents.run,
    "robustness": robustness.run,
}
#: sections that a pipeline without DALE has, and data without ratings allow
WITHOUT_RATINGS = ("reconstruction", "speed", "latents", "robustness")

__all__ = ["Anchor", "FULL", "QUICK", "SECTIONS", "WITHOUT_RATINGS", "Context", "Settings"]

"""Virtual surfaces: physically grounded friction recordings and ratings, after published laws of finger friction.

They prove the machinery (controllability, spectra, dependence on speed), not perception.
"""

from .collection import Collection
from .exploration import VELOCITY_RATE, Exploration, Explorer, explorer, free_exploration, steady_exploration
from .generate_recordings import generate_recordings
from .raters import RATING_CORRELATION
from .recipe import RECIPE_VERSION, SurfaceParameters
from .surface import VirtualSurface

__all__ = [
    "RATING_CORRELATION",
    "RECIPE_VERSION",
    "VELOCITY_RATE",
    "Collection",
    "Exploration",
    "Explorer",
    "SurfaceParameters",
    "VirtualSurface",
    "explorer",
    "free_exploration",
    "generate_recordings",
    "steady_exploration",
]

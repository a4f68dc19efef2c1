"""Virtual surfaces: physically grounded friction recordings and ratings, after published laws of finger friction.

They prove the machinery (controllability, spectra, dependence on speed), not perception.
"""

from .exploration import VELOCITY_RATE, Exploration, explorer, free_exploration, steady_exploration
from .fresh import FIRST_FRESH, fresh_ratings, fresh_textures
from .generate import VirtualSurface, generate_recordings
from .percepts import CALIBRATION_FILE, calibrate
from .recipe import RECIPE_VERSION, SurfaceParameters

__all__ = [
    "CALIBRATION_FILE",
    "FIRST_FRESH",
    "RECIPE_VERSION",
    "VELOCITY_RATE",
    "Exploration",
    "SurfaceParameters",
    "VirtualSurface",
    "calibrate",
    "explorer",
    "free_exploration",
    "fresh_ratings",
    "fresh_textures",
    "generate_recordings",
    "steady_exploration",
]

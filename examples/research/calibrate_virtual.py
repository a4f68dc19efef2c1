"""Recomputes the constants of the virtual percepts, after a change of the recipe: `python calibrate_virtual.py`."""

import json
from pathlib import Path

import numpy as np

from tactile_diffusers.virtual import RECIPE_VERSION, percepts
from tactile_diffusers.virtual.percepts import CALIBRATION_FILE, combine, further_inputs, percept_inputs
from tactile_diffusers.virtual.recipe import draw_surface
from tactile_diffusers.virtual.streams import Stream, stream

SURFACES, SEED = 10_000, 20_260_000


def calibrate():
    """Means and standard deviations that normalise percepts, from one population of surfaces: about ten seconds.

    Returns:
        `dict`: what `calibration.json` holds.
    """
    drawn = [draw_surface(stream(SEED, Stream.SURFACE, k)) for k in range(SURFACES)]
    population = [percept_inputs(surface) for surface in drawn]
    inputs = {name: np.array([item[name] for item in population]) for name in population[0]}
    constants = {}

    def standardise(name, values):
        mean, scale = float(np.mean(values)), float(np.std(values))
        constants[name] = {"mean": round(mean, 6), "scale": round(scale, 6)}
        return (values - mean) / scale

    correlation = np.corrcoef(combine(inputs, standardise))
    return {
        "recipe_version": RECIPE_VERSION,
        "surfaces": SURFACES,
        "seed": SEED,
        "constants": constants,
        "correlation": correlation.round(6).tolist(),
        "further": _further_constants(drawn),
    }


def _further_constants(surfaces):
    """Mean and scale of `further_inputs` over a population: name -> dict."""
    found = [further_inputs(surface) for surface in surfaces]
    columns = {name: [one[name] for one in found] for name in found[0]}
    return {k: {"mean": round(float(np.mean(v)), 6), "scale": round(float(np.std(v)), 6)} for k, v in columns.items()}


if __name__ == "__main__":
    path = Path(percepts.__file__).with_name(CALIBRATION_FILE)
    path.write_text(json.dumps(calibrate(), indent=2) + "\n")
    print(f"wrote {path}")

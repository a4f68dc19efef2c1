"""Virtual surfaces, explored and rated, streamed to `recordings.h5`."""

from functools import cached_property

import numpy as np
from tqdm import tqdm

from ...signal import DEVICE_RATE, RATING_AXES, SEGMENT_SECONDS
from ..recordings import RecordingsWriter
from .exploration import VELOCITY_RATE, explorer, free_exploration
from .friction import contact_force
from .percepts import percepts
from .profile import surface_profile, unit_slope
from .raters import RATERS, draw_raters, rate_surface
from .recipe import RECIPE_VERSION, draw_surface


class VirtualSurface:
    """Surface number `index` of a seed: the same whatever the number of surfaces.

    Args:
        seed (`int`): of the whole collection.
        index (`int`): 0, 1, ...

    Attributes:
        name (`str`): index and material.
        parameters (`SurfaceParameters`): its laws' parameters.
        percepts (`np.ndarray`): (3,) roughness, bumpiness, slipperiness in standard deviations.
    """

    def __init__(self, seed, index):
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(0, index)))
        self.seed, self.index = seed, index
        self.parameters = draw_surface(rng)
        self.name = f"{index:04d}-{self.parameters.material}"
        self.percepts = percepts(self.parameters)
        self._rng = rng

    @cached_property
    def _tables(self):
        """Profile and unit slope: (GRID_POINTS, 2); made when a finger first meets them, a rating needs none."""
        profile = surface_profile(self.parameters, self._rng)
        return np.stack([profile, unit_slope(profile)], axis=-1)

    def explore(self, explorer_index, seconds, trial=0):
        """Free exploration.

        Returns:
            `tuple[np.ndarray, np.ndarray]`: contact force (n, 3) float32 in N at 10 kHz, velocity (m, 2) mm/s at
            500 Hz.
        """
        rng = np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(1, self.index, explorer_index, trial)))
        who = explorer(explorer_index, self.seed)
        exploration = free_exploration(rng, who, seconds)
        return self.record(exploration, rng, who.moisture, who.gain), exploration.velocity

    def record(self, exploration, rng, moisture=1.0, gain=1.0):
        """Contact force of any `Exploration`, for example `steady_exploration`: (n, 3) float32, N, at 10 kHz."""
        return contact_force(rng, self.parameters, self._tables, exploration, moisture, gain)

    def answers(self, raters, agreement=1.0):
        """(raters, 3) answers on the 0-8 scale."""
        rng = np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(3, self.index)))
        return rate_surface(rng, self.percepts, raters, agreement)


def generate_recordings(path, surfaces, seconds, explorers=2, seed=0, agreement=1.0, quiet=False):
    """Writes recordings and ratings of virtual surfaces.

    Args:
        path (`str` or `Path`): `recordings.h5` to write.
        surfaces (`int`): number of surfaces.
        seconds (`float`): duration of each recording.
        explorers (`int`): recordings per surface.
        seed (`int`): of everything.
        agreement (`float`): of the raters; see `rate_surface`.
        quiet (`bool`): no progress bar.

    Raises:
        ValueError: if an argument is out of range.
    """
    for name, value in (("surfaces", surfaces), ("explorers", explorers)):
        if int(value) != value or value < 1:
            raise ValueError(f"`{name}` must be a whole number of at least 1, got {value}.")
    if not SEGMENT_SECONDS <= seconds < float("inf"):
        raise ValueError(f"`seconds` must be at least one segment, {SEGMENT_SECONDS} s, got {seconds}.")
    if not agreement > 0:
        raise ValueError(f"`agreement` must be positive (1 is the recipe), got {agreement}.")
    if int(seed) != seed or seed < 0:
        raise ValueError(f"`seed` must be a whole number of at least 0, got {seed}.")
    raters = draw_raters(seed)
    facts = dict(recipe_version=RECIPE_VERSION, seed=seed, agreement=agreement)
    with RecordingsWriter(path, source="virtual surfaces", licence="CC0-1.0", **facts) as writer:
        names, answers = [], []
        for index in tqdm(range(surfaces), desc="virtual surfaces", unit="surface", disable=quiet):
            surface = VirtualSurface(seed, index)
            for number in range(explorers):
                force, velocity = surface.explore(number, seconds)
                writer.add_recording(
                    surface.name,
                    f"explorer-{number}",
                    "0",
                    force=force,
                    force_rate=DEVICE_RATE,
                    velocity=velocity,
                    velocity_rate=VELOCITY_RATE,
                )
            names.append(surface.name)
            answers.append(surface.answers(raters, agreement))
        raters_names = [f"rater-{number}" for number in range(RATERS)]
        writer.set_ratings(np.stack(answers, axis=1), raters_names, names, RATING_AXES)

"""One virtual surface: its parameters, its profile under a finger, and the raters' answers about it."""

from functools import cached_property

from .exploration import explorer, free_exploration
from .friction import contact_force
from .percepts import percepts
from .raters import RATING_CORRELATION, rate_surface
from .recipe import draw_surface
from .relief import profile_tables
from .streams import Stream, stream


class VirtualSurface:
    """Surface number `index` of a seed: the same whatever the number of surfaces.

    Args:
        seed (`int`): of the whole collection.
        index (`int`): 0, 1, ...
        impulsiveness (`float`): of `draw_surface`.

    Attributes:
        name (`str`): index and material.
        parameters (`SurfaceParameters`): its laws' parameters.
        percepts (`np.ndarray`): (3,) roughness, bumpiness, slipperiness in standard deviations.
    """

    def __init__(self, seed, index, impulsiveness=1.0):
        rng = stream(seed, Stream.SURFACE, index)
        self.seed, self.index = seed, index
        self.parameters = draw_surface(rng, impulsiveness)
        self.name = f"{index:04d}-{self.parameters.material}"
        self.percepts = percepts(self.parameters)
        self._rng = rng

    @cached_property
    def _tables(self):
        """Profile tables, computed when a finger first explores the surface: a rating needs none."""
        return profile_tables(self.parameters, self._rng)

    def explore(self, explorer_index, seconds, trial=0):
        """Free exploration, adapted to the surface's roughness.

        Returns:
            `tuple[np.ndarray, np.ndarray]`: contact force (n, 3) float32 in N at 10 kHz, velocity (m, 2) mm/s at
            500 Hz.
        """
        rng = stream(self.seed, Stream.EXPLORATION, self.index, explorer_index, trial)
        who = explorer(explorer_index, self.seed)
        exploration = free_exploration(rng, who, seconds, roughness=self.percepts[0])
        return self.record(exploration, rng, who.moisture, who.gain, who.cutoff), exploration.velocity

    def record(self, exploration, rng, moisture=1.0, gain=1.0, cutoff=1.0):
        """Contact force of any `Exploration`, for example `steady_exploration`: (n, 3) float32, N, at 10 kHz.

        Args:
            exploration (`Exploration`): speed, force and heading of the hand.
            rng (`np.random.Generator`): the trial.
            moisture, gain, cutoff (`float`): of the `Explorer`.
        """
        return contact_force(rng, self.parameters, self._tables, exploration, moisture, gain, cutoff)

    def answers(self, raters, agreement=1.0, rating_correlation=RATING_CORRELATION, trial=0):
        """Answers on the 0-8 scale; settings as in `rate_surface`.

        Args:
            raters (`tuple[np.ndarray, np.ndarray]`): from `draw_raters`.
            trial (`int`): a rater who is asked again gives another answer about the same impression.

        Returns:
            `np.ndarray`: (raters, 3) float32; a rater's answers do not depend on how many raters there are.
        """
        rng, trial_rng = (
            stream(self.seed, Stream.ANSWERS, self.index),
            stream(self.seed, Stream.TRIAL, self.index, trial),
        )
        return rate_surface(rng, trial_rng, self.percepts, raters, agreement, rating_correlation)

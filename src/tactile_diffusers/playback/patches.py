"""Places of the surfaces of a scene: rectangles on a screen, or intervals on a line."""

from collections.abc import Mapping

import numpy as np

#: The longest patch, mm: a longer one is probably in another unit.
LONGEST_MM = 10_000.0


class Patches:
    """Patches in mm, each a corner and a size: (x, y, width, height), or (start, length) on a line.

    They may overlap: the later one of `names`, which lists all surfaces, lies above. A ValueError for a patch of
    another form, of an unknown surface, without extent, or longer than `LONGEST_MM`.

    Attributes:
        boxes (`dict[str, tuple[float, ...]]`): the patches, from below.
        dimensions (`int`): of a position, 1 or 2; 0 = there are no patches.
    """

    def __init__(self, patches, names):
        if not isinstance(patches, Mapping):
            raise ValueError(f"`patches` must map names to patches, got {type(patches).__name__}.")
        unknown = sorted(map(str, set(patches) - set(names)))
        if unknown:
            raise ValueError(f"`patches` names {unknown}, not among `surfaces`.")
        self.boxes = {name: _checked(name, patches[name]) for name in names if name in patches}
        sizes = {len(box) for box in self.boxes.values()}
        if len(sizes) > 1:
            raise ValueError("`patches` must all be (x, y, width, height), or all (start, length), in mm; got both.")
        self.dimensions = max(sizes, default=0) // 2
        boxes = np.array(list(self.boxes.values())).reshape(-1, 2, max(self.dimensions, 1))
        self._low, self._high = boxes[:, 0], boxes[:, 0] + boxes[:, 1]

    def extent(self, name):
        """The longest straight stroke within a patch, mm; 0 for a surface without one."""
        box = self.boxes.get(name, ())
        return float(np.linalg.norm(box[len(box) // 2 :]))

    def at(self, position):
        """Name of the patch under a position, the uppermost, or `None`."""
        place = self._vector("position", position)
        inside = np.flatnonzero(((self._low <= place) & (place < self._high)).all(1))
        return list(self.boxes)[inside[-1]] if len(inside) else None

    def near(self, position, velocity, margin, seconds):
        """Names of the patches that a finger on a straight way comes within `margin` mm of, in this order."""
        place = self._vector("position", position)
        velocity = self._vector("velocity", np.zeros(self.dimensions) if velocity is None else velocity)
        # the way through a box, axis by axis, as rays are cut with boxes; a resting axis is in it always or never
        slow = np.where(np.abs(velocity) < 1e-9, 1e-9, velocity)
        ends = (self._low - margin - place) / slow, (self._high + margin - place) / slow
        enter, leave = np.minimum(*ends).max(1), np.maximum(*ends).min(1)
        met = np.flatnonzero((enter <= leave) & (enter <= seconds) & (leave >= 0))
        away = np.linalg.norm(np.maximum(0, np.maximum(self._low - place, place - self._high)), axis=1)
        order = np.lexsort((away[met], np.maximum(enter[met], 0)))
        names = list(self.boxes)
        return [names[index] for index in met[order]]

    def _vector(self, name, value):
        if not self.dimensions:
            raise ValueError("This scene has no `patches`: give them to TextureScene, or ask for surfaces by name.")
        vector = np.atleast_1d(np.asarray(value, dtype=np.float64))
        if vector.shape != (self.dimensions,) or not np.isfinite(vector).all():
            form = "on a plane: (x, y)" if self.dimensions == 2 else "on a line"
            raise ValueError(f"`{name}` must be {self.dimensions} finite number(s), got {value!r}: patches lie {form}.")
        return vector


def _checked(name, patch):
    try:
        box = tuple(float(value) for value in patch)
    except (TypeError, ValueError):
        box = ()
    half = len(box) // 2
    if len(box) not in (2, 4) or not np.isfinite(box).all() or min(box[half:]) <= 0:
        raise ValueError(
            f"`patches[{name!r}]` must be (x, y, width, height), or (start, length) on a line, in mm and of positive "
            f"size, got {patch!r}."
        )
    if np.linalg.norm(box[half:]) > LONGEST_MM:
        raise ValueError(f"`patches[{name!r}]` must be at most {LONGEST_MM:g} mm long, got {patch!r}: give mm.")
    return box

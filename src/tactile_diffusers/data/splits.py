"""Splits by surface, and the hard split: surfaces, explorers and raters that training never sees."""

from dataclasses import dataclass
from fnmatch import fnmatchcase

import numpy as np

from ..signal.checks import check_whole_number

#: Ordinary splits, and windows of what a `HoldOut` keeps apart.
SPLITS = ("train", "validation", "test", "hard")
_LISTED = 8
#: Evaluation needs two held-out surfaces: of so many surfaces, a share of a tenth or more is two at least.
ENOUGH_FOR_TWO, SHARE_FOR_TWO = 8, 0.1


@dataclass(frozen=True)
class HoldOut:
    """Surfaces, explorers and raters that no ordinary split holds; shell patterns (`fnmatch`), matched with case.

    The split "hard" holds segments that are new in every respect: of held-out surfaces by held-out explorers, with the
    ratings of held-out raters. A field without patterns restricts nothing. Segments that are new in some respects only
    (a held-out surface by an ordinary explorer) are in no split.

    Attributes:
        surfaces (`tuple[str, ...]`): for example ("*-rubber",), one whole class of virtual surfaces.
        explorers (`tuple[str, ...]`): an unseen finger.
        raters (`tuple[str, ...]`): raters whose answers make the ratings of the hard split and of no other.

    Raises:
        ValueError: if there is no pattern, or one is not text.
    """

    surfaces: tuple[str, ...] = ()
    explorers: tuple[str, ...] = ()
    raters: tuple[str, ...] = ()

    def __post_init__(self):
        for kind in ("surfaces", "explorers", "raters"):
            patterns = getattr(self, kind)
            if isinstance(patterns, str) or not all(isinstance(p, str) and p for p in patterns):
                raise ValueError(f"`{kind}` must be a sequence of patterns such as ('*-rubber',), got {patterns!r}.")
            object.__setattr__(self, kind, tuple(patterns))
        if not (self.surfaces or self.explorers or self.raters):
            raise ValueError("`hold_out` must have a pattern for `surfaces`, `explorers` or `raters`, got none.")

    def held(self, kind, names):
        """Which of `names` a pattern of this kind matches, none and all allowed: (names,) bool."""
        return np.array([any(fnmatchcase(name, pattern) for pattern in getattr(self, kind)) for name in names], bool)

    def matches(self, kind, names):
        """Which of `names` are held out: (names,) bool.

        Args:
            kind (`str`): "surfaces", "explorers" or "raters".
            names (`Sequence[str]`): all of that kind.

        Raises:
            ValueError: if the patterns of this kind match none or all of the names, or one of them matches none.
        """
        patterns, held = getattr(self, kind), self.held(kind, names)
        there_are = ", ".join(names[:_LISTED]) + (", ..." if len(names) > _LISTED else "")
        for pattern in patterns:
            if not any(fnmatchcase(name, pattern) for name in names):
                raise ValueError(f"`hold_out.{kind}`: {pattern!r} matches none of the {len(names)}: {there_are}.")
        if patterns and held.all():
            raise ValueError(
                f"`hold_out.{kind}` {patterns} match all {len(names)} ({there_are}): nothing is left for training."
            )
        return held


def check_split(validation, test, seed):
    """Raises a `ValueError` if these arguments of `split_surfaces` are out of range for any number of surfaces."""
    for name, size in (("validation", validation), ("test", test)):
        if not (0 <= size < 1 or (size >= 1 and float(size).is_integer())):
            raise ValueError(f"`{name}` must be a share below 1 or a whole number of surfaces, got {size}.")
    check_whole_number("split_seed", seed, at_least=0)


def split_surfaces(surfaces, validation=0.1, test=0.1, seed=0):
    """Splits surfaces, never segments, into training, validation and test.

    Args:
        surfaces (`int`): how many.
        validation, test (`float` or `int`): a share below 1 (at least one surface if above 0; at least two of 8
            surfaces or more if 0.1 or above), or a number of surfaces.
        seed (`int`): of the draw.

    Returns:
        `np.ndarray`: (surfaces,) int64 index into `SPLITS`.

    Raises:
        ValueError: if an argument is out of range or no surface is left for training.
    """
    check_split(validation, test, seed)
    counts = []
    for size in (validation, test):
        least = 2 if surfaces >= ENOUGH_FOR_TWO and size >= SHARE_FOR_TWO else 1
        counts.append(int(size) if size >= 1 or size == 0 else max(least, round(size * surfaces)))
    if sum(counts) >= surfaces:
        raise ValueError(
            f"`validation` ({counts[0]}) and `test` ({counts[1]}) leave none of {surfaces} surfaces for "
            "training: lower them."
        )
    order = np.random.default_rng(seed).permutation(surfaces)
    split = np.zeros(surfaces, dtype=np.int64)
    split[order[: counts[0]]] = SPLITS.index("validation")
    split[order[counts[0] : sum(counts)]] = SPLITS.index("test")
    return split


@dataclass
class Splits:
    """Which split everything belongs to.

    Attributes:
        surfaces (`np.ndarray`): (surfaces,) int64 index into `SPLITS`; "hard" = held out.
        owners (`np.ndarray`): (recordings,) int64, the surface of each.
        withheld (`np.ndarray`): (recordings,) bool, of a held-out surface or explorer: in no ordinary split.
        hard (`np.ndarray`): (recordings,) bool, in the split "hard"; if only raters are held out, also in another.
    """

    surfaces: np.ndarray
    owners: np.ndarray
    withheld: np.ndarray
    hard: np.ndarray

    def members(self, split):
        """Recordings of a split by name, or of "all", every ordinary one: (recordings,) bool."""
        if split == "hard":
            return self.hard
        return ~self.withheld & (True if split == "all" else self.surfaces[self.owners] == SPLITS.index(split))


def assign_splits(names, surfaces, validation, test, seed, hold_out=None):
    """Splits surfaces, and recordings by their names "surface/explorer/trial": `Splits`.

    The surfaces that are not held out are split by `split_surfaces`. Raises a `ValueError` if a pattern matches
    nothing, or training or the hard split is left without a recording.
    """
    owners = [name.split("/")[:2] for name in names]
    surface = np.array([surfaces.index(owner) for owner, _ in owners])
    if hold_out is None:
        none = np.zeros(len(names), dtype=bool)
        return Splits(split_surfaces(len(surfaces), validation, test, seed), surface, none, none)
    held = hold_out.matches("surfaces", surfaces)
    split = np.full(len(surfaces), SPLITS.index("hard"))
    split[~held] = split_surfaces(int(np.sum(~held)), validation, test, seed)
    explorers, explorer = np.unique([who for _, who in owners], return_inverse=True)
    by_unseen = hold_out.matches("explorers", explorers.tolist())[explorer]
    # a field without patterns restricts nothing
    hard = (held[surface] | (not hold_out.surfaces)) & (by_unseen | (not hold_out.explorers))
    splits = Splits(split, surface, held[surface] | by_unseen, hard)
    for name in ("train", "hard"):
        if not splits.members(name).any():
            raise ValueError(f"{hold_out} leaves no recording for the split {name!r}: hold out less.")
    return splits

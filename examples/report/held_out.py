"""The data of an evaluation: held-out segments, and the training segments that they are compared with."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tactile_diffusers.data import PreparedDataset
from tactile_diffusers.data.splits import SPLITS
from tactile_diffusers.evaluation.metrics.distances import Reference
from tactile_diffusers.signal import band_edges, band_levels_db

from .baselines import BaselineRequest, TrainingTextures


def random_generator(seed, purpose):
    """A NumPy generator of its own for each purpose (`str`): sections do not depend on each other's order."""
    return np.random.default_rng([seed, *purpose.encode()])


@dataclass(frozen=True, eq=False)
class HeldOutData:
    """Held-out segments and the reference; make it with `open_held_out`. Arrays are computed when first used.

    `dataset` and `train` are the held-out and the training split; `rows`, `other_rows` (n,) held-out segments, and for
    each another take of its surface; `per_surface` the non-overlapping segments of each training surface in the
    reference.
    """

    dataset: PreparedDataset
    train: PreparedDataset
    rows: np.ndarray
    other_rows: np.ndarray
    per_surface: int
    seed: int

    def unseen_rows(self, per_surface):
        """Up to so many segments of each held-out surface that share no sample, and none with training."""
        return _unseen_rows(self.dataset, self.train, per_surface, self.seed)

    @property
    def rate(self):
        """Sampling rate, Hz."""
        return self.dataset.sampling_rate

    @property
    def edges(self):
        """(10,) edges of the nine bands, Hz."""
        return band_edges(9, self.dataset.band)

    @property
    def surfaces(self):
        """(n,) surface of each held-out segment."""
        return self.dataset.surface_ids[self.rows]

    @property
    def ratings(self):
        """(n, 3) z-scores of the surface of each held-out segment."""
        return self.dataset.ratings.mean[self.surfaces]

    @cached_property
    def real(self):
        """(n, samples) the held-out segments, N."""
        return self.dataset.textures(self.rows)

    @cached_property
    def bands(self):
        """(n, 9) their band levels, dB re 1 N^2."""
        return band_levels_db(self.real, self.rate, self.edges)

    @cached_property
    def points(self):
        """(n, features) their embeddings."""
        return self.reference.embed(self.real)

    @cached_property
    def distances(self):
        """FTD and KTD of the held-out segments to the reference: the best that a generator can be expected to reach."""
        return self.reference.distances(self.points, self.surfaces)

    @cached_property
    def frictions(self):
        """(n,) friction coefficients; all NaN unless every held-out and training segment has one."""
        return self._frictions(self.dataset, self.rows)

    @property
    def has_friction(self):
        """Whether friction is compared."""
        return bool(np.isfinite(self.frictions).all())

    @cached_property
    def training(self):
        """`TrainingTextures`: non-overlapping segments of the training surfaces, for reference, judge and baselines."""
        train = self.train
        rows = train.non_overlapping(self.per_surface, self.seed)
        surfaces = train.surface_ids[rows]
        frictions = self._frictions(train, rows)
        return TrainingTextures(
            train.textures(rows), train.ratings.mean[surfaces], frictions, surfaces, self.rate, train.band
        )

    @cached_property
    def reference(self):
        """`Reference`: the embedded training segments."""
        return Reference(self.training.textures, self.rate, self.training.surface_ids)

    @cached_property
    def request(self):
        """`BaselineRequest`: the held-out segments as the baselines see them."""
        return BaselineRequest(self.ratings, self.real, self.dataset.textures(self.other_rows))

    def _frictions(self, dataset, rows):
        chosen = np.concatenate([self.rows, self.other_rows])
        known = (self.dataset.friction_coefficients[chosen], self.train.friction_coefficients)
        if not all((values > 0).all() for values in known):  # NaN fails too
            return np.full(len(rows), np.nan)
        return dataset.friction_coefficients[rows]


def open_held_out(data, split, per_surface, seed=0):
    """`HeldOutData` of a prepared data set; `split` is "validation", "test" or, where the data have it, "hard".

    Where "hard" holds out explorers or raters alone, training has the surfaces too, but not the recordings. A
    ValueError if the split is not held out, shares surfaces otherwise, or has fewer than two with two segments each
    that share no sample.
    """
    if split not in SPLITS[1:]:
        raise ValueError(f"`split` must be held out, one of {SPLITS[1:]}, got {split!r}.")
    dataset, train = PreparedDataset(data, split), PreparedDataset(data, "train")
    if split != "hard" or dataset.attributes["hold_out"]["surfaces"]:
        check_unseen(dataset, train)
    rows, other_rows = _two_halves(dataset, _unseen_rows(dataset, train, 2 * per_surface, seed), seed)
    if len(np.unique(dataset.surface_ids[rows])) < 2:
        raise ValueError(
            f"`data` must have two surfaces or more with two segments each that share no sample in the split "
            f"{split!r}, to compare with another take and another surface. Record longer, or hold more out: `--test 2` "
            "or more of examples/prepare_data.py; then train again, since what is held out now was trained on."
        )
    return HeldOutData(dataset, train, rows, other_rows, per_surface, seed)


def _unseen_rows(dataset, train, per_surface, seed):
    rows = dataset.non_overlapping(per_surface, seed)
    return rows[~np.isin(dataset.recording_ids[rows], train.recording_ids)]


def _two_halves(dataset, rows, seed):
    """Indices of segments, and of another take for each: two arrays (n,). No two of them share a sample."""
    rows = random_generator(seed, "halves").permutation(rows)
    first, second = [], []
    for surface in np.unique(dataset.surface_ids[rows]):
        own = rows[dataset.surface_ids[rows] == surface]
        half = len(own) // 2
        first, second = [*first, *own[:half]], [*second, *own[half : 2 * half]]
    return np.array(first, dtype=int), np.array(second, dtype=int)


def check_unseen(held_out, train):
    """Raises a ValueError if two views of a data set share a surface: one held out, one of training."""
    shared = np.intersect1d(held_out.surface_ids, train.surface_ids)
    if len(shared):
        raise ValueError(
            f"{held_out.path} has {len(shared)} surfaces of the split {held_out.split!r} in training too, first "
            f"{held_out.surfaces[shared[0]]!r}: nothing would be unseen. Hold out surfaces when preparing the data."
        )

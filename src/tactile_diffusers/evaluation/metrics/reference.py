"""The training surfaces as the fixed reference of distances between sets."""

import numpy as np
from scipy.spatial.distance import cdist

from .distances import frechet_tactile_distance, within_similarity
from .embedding import TactileEmbedding
from .statistics import estimate, number


class Reference:
    """Embedded textures (n, samples) of the training surfaces `groups` (n,), to which sets of textures are compared.

    Feature scales and kernel width are taken from them and frozen: `embedding` is the fitted `TactileEmbedding`,
    `points` (n, features) are theirs. Take non-overlapping segments, few of each surface.
    """

    def __init__(self, textures, sampling_rate, groups=None):
        self.sampling_rate = sampling_rate
        self.embedding = TactileEmbedding.fit(textures, sampling_rate)
        self.points = self.embedding(textures, sampling_rate)
        self._within = within_similarity(self.points, self.embedding.width, groups)

    def embed(self, textures):
        """(n, samples) N -> (n, features)."""
        return self.embedding(textures, self.sampling_rate)

    def distances(self, points, groups, real=None):
        """FTD and KTD of a set, points (n, features) of `groups` (n,), to the reference: leaves "ftd" and "ktd".

        FTD is empty for sets too small for a covariance, KTD, which leaves out pairs of one group, for a single group.
        Intervals over groups hold the set's own randomness, not the reference's. `real`, points and groups of real
        held-out textures, adds "ftd_excess" and "ktd_excess", how much less theirs are; a group is left out of both
        sets.
        """
        leaves = {}
        for name, measure in (("ftd", self._frechet_distance), ("ktd", self._kernel_distance)):
            distance = measure(points, np.asarray(groups))
            leaves[name] = number() if distance is None else estimate(distance, groups)
            if real is not None:
                beside = measure(real[0], np.asarray(real[1]))
                known = None not in (distance, beside)
                over = estimate(lambda a, b, d=distance, r=beside: d(a) - r(b), groups, real[1]) if known else number()
                leaves[f"{name}_excess"] = over
        return leaves

    def paired_ktd(self, points, others, groups):
        """KTD of a set minus that of another of the same groups (n,), row by row: a leaf, its interval over groups."""
        first, second = (self._kernel_distance(values, np.asarray(groups)) for values in (points, others))
        return number() if first is None else estimate(lambda mask: first(mask) - second(mask), groups)

    def _frechet_distance(self, points, groups):
        """`frechet_tactile_distance` of a mask of the points; None where a group less leaves too few."""
        fewest = len(points) - (max(np.unique(groups, return_counts=True)[1]) if len(points) else 0)
        if min(fewest, len(self.points) - 1) <= points.shape[1]:
            return None
        return lambda mask: frechet_tactile_distance(points[mask], self.points)

    def _kernel_distance(self, points, groups):
        """`kernel_tactile_distance` of a mask of the points, each kernel computed once; None for a single group."""
        if len(np.unique(groups)) < 2:
            return None
        width = self.embedding.width
        kernel = np.exp(-cdist(points, points, "sqeuclidean") / width**2)
        other = groups[:, None] != groups[None, :]
        between = np.exp(-cdist(points, self.points, "sqeuclidean") / width**2).mean(1)

        def distance(mask):
            pairs = other[np.ix_(mask, mask)]
            if not pairs.any():
                return np.nan
            return 1000 * (kernel[np.ix_(mask, mask)][pairs].mean() + self._within - 2 * between[mask].mean())

        return distance

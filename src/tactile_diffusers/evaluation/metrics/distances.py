"""Distances between two sets of textures, on their embeddings (`TactileEmbedding`)."""

import numpy as np
from scipy.spatial.distance import cdist

from .embedding import TactileEmbedding
from .statistics import estimate, number
from .texture_checks import check_sets, in_blocks


def frechet_tactile_distance(a, b):
    """Fréchet distance of the Gaussians fitted to two sets of embeddings (n, features), (m, features) (FTD).

    `|mean_a - mean_b|^2 + tr(C_a + C_b - 2 (C_a^1/2 C_b C_a^1/2)^1/2)`, as in the Fréchet audio distance of Kilgour et
    al. (2019). Estimated from samples it is too large, the more so the fewer there are: compare it only with the
    distance of two real sets of the same sizes. A ValueError if a set is not finite, or has no more members than
    features.
    """
    a, b = check_sets(a=a, b=b)
    for name, members in (("a", a), ("b", b)):
        if len(members) <= members.shape[1]:
            raise ValueError(
                f"`{name}` must have more than {members.shape[1]} members for a covariance of {members.shape[1]} "
                f"features, got {len(members)}. Use more textures, or `kernel_tactile_distance`."
            )
    covariance_a, covariance_b = np.cov(a, rowvar=False), np.cov(b, rowvar=False)
    root_a = covariance_root(np.atleast_2d(covariance_a))
    cross = np.linalg.eigvalsh(root_a @ np.atleast_2d(covariance_b) @ root_a)
    shift = ((a.mean(0) - b.mean(0)) ** 2).sum()
    spread = np.trace(np.atleast_2d(covariance_a + covariance_b)) - 2 * np.sqrt(np.maximum(cross, 0)).sum()
    return float(shift + spread)


def covariance_root(covariance):
    """Symmetric square root (d, d), also of a singular covariance: normal numbers times it have that covariance."""
    # symmetric: eigenvalues are real, and tiny negative ones are rounding
    values, vectors = np.linalg.eigh(covariance)
    return (vectors * np.sqrt(np.maximum(values, 0))) @ vectors.T


def kernel_tactile_distance(a, b, width, a_groups=None, b_groups=None):
    """1000 times the unbiased squared maximum mean discrepancy of two sets of embeddings (n, features), (m, features)
    (KTD).

    Gaussian kernel `exp(-d^2 / width^2)`, the width that of the fitted `TactileEmbedding` (as the kernel audio
    distance, arXiv 2502.15602). Two sets of one distribution give zero on average at any size, so single values may be
    negative. Pairs of one group, (n,) or (m,) surfaces, are left out. A ValueError if the sets do not fit or are too
    small.
    """
    a, b = check_sets(a=a, b=b)
    if not (np.isfinite(width) and width > 0):
        raise ValueError(f"`width` must be above zero, got {width}. Use that of the fitted `TactileEmbedding`.")
    if min(len(a), len(b)) < 2:
        raise ValueError(f"`a` and `b` must have at least 2 members each, got {len(a)} and {len(b)}.")
    between = _kernel_sum(a, b, width) / (len(a) * len(b))
    return float(1000 * (within_similarity(a, width, a_groups) + within_similarity(b, width, b_groups) - 2 * between))


def within_similarity(points, width, groups=None):
    """Mean kernel over pairs of different members, or of different groups; a ValueError if there is one group only."""
    # a member's kernel with itself is 1, and does not belong in an unbiased estimate
    groups = np.arange(len(points)) if groups is None else np.asarray(groups)
    names, counts = np.unique(groups, return_counts=True)
    if len(names) < 2:
        raise ValueError("`groups` must name at least 2 groups: without pairs of different ones nothing is compared.")
    alike = (
        len(points)
        if len(names) == len(points)
        else sum(_kernel_sum(points[groups == name], points[groups == name], width) for name in names)
    )
    return (_kernel_sum(points, points, width) - alike) / (len(points) ** 2 - np.square(counts).sum())


def _kernel_sum(a, b, width):
    """Sum of the kernel over all pairs, a block of rows at a time."""
    return sum(np.exp(-cdist(block, b, "sqeuclidean") / width**2).sum() for block in in_blocks(a, 512))


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

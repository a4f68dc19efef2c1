"""Distances between two sets of textures, on their embeddings (`TactileEmbedding`)."""

import numpy as np
from scipy.spatial.distance import cdist

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

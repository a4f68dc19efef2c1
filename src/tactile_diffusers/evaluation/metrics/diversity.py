"""Does a generator cover the real textures, and do its takes differ as real ones do?"""

import numpy as np
from scipy.spatial.distance import cdist

from .statistics import jackknife
from .texture_checks import check_sets, check_textures, in_blocks

#: Standard deviation of the kernel over all three ratings by which real surfaces count as alike, z-scores.
RATING_WIDTH = 0.3
#: Fewest effective real surfaces near a rating for its spread to be known.
FEWEST_NEAR = 20


def covered(points, members, k=5):
    """Share of points (n, features) in a ball of a member (m, features) up to its k-th nearest other member.

    Improved precision and recall (Kynkäänniemi et al. 2019, arXiv 1904.06991): precision is the share of generated
    points that real members cover (are they plausible?), recall the share of real points that generated members cover
    (are all there?). Two sets of one distribution do not reach 1: compare with two real sets of the same sizes. A
    ValueError if the sets do not fit together, or there are not more than `k` members.
    """
    points, members = check_sets(points=points, members=members)
    if not 1 <= k < len(members):
        raise ValueError(f"`k` must be at least 1 and below the number of members, {len(members)}, got {k}.")
    # the nearest member to a member is itself
    radii = np.concatenate([np.partition(cdist(block, members), k, axis=-1)[:, k] for block in in_blocks(members)])
    return float(np.mean(np.concatenate([(cdist(block, members) <= radii).any(-1) for block in in_blocks(points)])))


def take_spread_db(band_levels, groups):
    """How much takes of one surface, or of one rating, differ: standard deviation of their band levels, dB.

    For each band (n, bands) the unbiased variance inside the groups (n,), pooled over the groups of two takes and more;
    the mean over bands of its root. A ValueError if shapes do not fit, or no group has two takes.
    """
    band_levels = check_textures("band_levels", band_levels, rank=2).astype(np.float64)
    groups = np.asarray(groups)
    if groups.shape != band_levels.shape[:1]:
        raise ValueError(
            f"`groups` must name the group of each of the {len(band_levels)} rows of `band_levels`, "
            f"got the shape {groups.shape}."
        )
    _, group, takes = np.unique(groups, return_inverse=True, return_counts=True)
    freedom = (takes - 1).sum()
    if freedom == 0:
        raise ValueError(f"`groups` must hold a group of at least 2 takes, got {len(takes)} groups of one.")
    means = np.zeros((len(takes), band_levels.shape[-1]))
    np.add.at(means, group, band_levels)
    deviations = band_levels - (means / takes[:, None])[group]
    return float(np.sqrt((deviations**2).sum(0) / freedom).mean())


def diversity(generated_levels, generated_groups, real_levels, real_groups):
    """Spread of generated takes over that of real ones: 1 = takes differ as much as real takes, 0 = all the same.

    Band levels are (n, bands), (m, bands) in dB, groups (n,), (m,) the rating or surface of each take. A ValueError as
    of `take_spread_db`, or if the real takes do not differ.
    """
    real = take_spread_db(real_levels, real_groups)
    if real == 0:
        raise ValueError("`real_levels` must differ within a group, got identical takes.")
    return take_spread_db(generated_levels, generated_groups) / real


def rating_diversity(generated_levels, generated_groups, group_ratings, real_levels, real_ratings, real_groups):
    """Spread of generated takes of one rating over that of real textures with such ratings: 1 = as diverse as the data.

    Ratings do not settle a surface, so takes of a rating should differ by more than takes of a surface do. Real
    surfaces count by a Gaussian kernel over all three ratings; ratings with fewer than 20 of them near are left out.
    Levels are (n, bands), (m, bands) in dB; `generated_groups` (n,) are rows of `group_ratings` (groups, 3);
    `real_ratings` (m, 3) and `real_groups` (m,) belong to surfaces. Returns the ratio and its 95 % interval over
    ratings, or NaN.
    """
    rated = ~np.isnan(real_ratings).any(1)
    real_levels, real_ratings = np.asarray(real_levels)[rated], np.asarray(real_ratings)[rated]
    _, surface, textures = np.unique(np.asarray(real_groups)[rated], return_inverse=True, return_counts=True)
    made, real = [], []
    for group in np.unique(generated_groups):
        own = generated_levels[generated_groups == group]
        squares = np.square((real_ratings - group_ratings[group]) / RATING_WIDTH).sum(1)
        weights = np.exp(-0.5 * squares) / textures[surface]
        total = np.bincount(surface, weights)
        size = total.sum() ** 2 / max(np.square(total).sum(), np.finfo(np.float64).tiny)
        if len(own) < 2 or not size >= FEWEST_NEAR:  # NaN where an axis is not rated
            continue
        # what a straight line over ratings explains is no spread of one rating
        lines = np.concatenate([np.ones((len(real_ratings), 1)), real_ratings - group_ratings[group]], axis=1)
        weights = (weights / weights.sum())[:, None]
        left = real_levels - lines @ np.linalg.lstsq(np.sqrt(weights) * lines, np.sqrt(weights) * real_levels)[0]
        made.append(own.var(0, ddof=1).mean())
        real.append((weights * np.square(left)).sum(0).mean() / (1 - lines.shape[1] / size))
    if not made:
        return np.nan, np.full(2, np.nan)
    made, real = np.array(made), np.array(real)
    return jackknife(lambda mask: np.sqrt(made[mask].mean() / real[mask].mean()), np.arange(len(made)))

"""The training surfaces as the fixed reference of distances between sets."""

import numpy as np
from scipy.spatial.distance import cdist

from .distances import frechet_tactile_distance, kernel_tactile_distance
from .embedding import TactileEmbedding
from .statistics import jackknife, number


class Reference:
    """Embedded textures of the training surfaces, to which sets of textures are compared.

    Feature scales and kernel width are taken from them and frozen.

    Args:
        textures (`np.ndarray`): (n, samples), non-overlapping segments, few of each surface.
        sampling_rate (`float`): Hz.

    Attributes:
        embedding (`TactileEmbedding`): fitted on the textures.
        points (`np.ndarray`): (n, 53).
    """

    def __init__(self, textures, sampling_rate):
        self.sampling_rate = sampling_rate
        self.embedding = TactileEmbedding.fit(textures, sampling_rate)
        self.points = self.embedding(textures, sampling_rate)

    def embed(self, textures):
        """(n, samples) N -> (n, 53)."""
        return self.embedding(textures, self.sampling_rate)

    def distances(self, points, groups):
        """FTD and KTD of a set to the reference, with intervals over the set's groups.

        Args:
            points (`np.ndarray`): (n, 53) embeddings.
            groups (`np.ndarray`): (n,) surface or request of each.

        Returns:
            `dict[str, dict]`: leaves "ftd" and "ktd"; FTD is empty for sets too small for a covariance. The intervals
            hold the set's own randomness, not the reference's.
        """
        groups = np.asarray(groups)
        ktd, ktd_interval = self._kernel_distance(points, groups)
        leaves = {"ftd": number(), "ktd": number(ktd, len(points), ktd_interval)}
        fewest = len(points) - (max(np.unique(groups, return_counts=True)[1]) if len(points) else 0)
        if min(fewest, len(self.points) - 1) > points.shape[1]:
            ftd, interval = jackknife(lambda mask: frechet_tactile_distance(points[mask], self.points), groups)
            leaves["ftd"] = number(ftd, len(points), interval)
        return leaves

    def _kernel_distance(self, points, groups):
        """As `kernel_tactile_distance`, each kernel computed once for all members left out."""
        width = self.embedding.width
        value = kernel_tactile_distance(points, self.points, width)
        kernel = np.exp(-cdist(points, points, "sqeuclidean") / width**2)
        between = np.exp(-cdist(points, self.points, "sqeuclidean") / width**2).mean(1)

        def moving_part(mask):
            count = mask.sum()
            within = (kernel[np.ix_(mask, mask)].sum() - count) / (count * (count - 1))
            return 1000 * (within - 2 * between[mask].mean())

        part, interval = jackknife(moving_part, groups)
        return value, interval + (value - part)  # what lies within the reference is a constant

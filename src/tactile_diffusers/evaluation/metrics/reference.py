"""The training surfaces as the fixed reference of distances between sets."""

import numpy as np
from scipy.spatial.distance import cdist

from .distances import frechet_tactile_distance, within_similarity
from .embedding import TactileEmbedding
from .statistics import jackknife, number


class Reference:
    """Embedded textures of the training surfaces, to which sets of textures are compared.

    Feature scales and kernel width are taken from them and frozen.

    Args:
        textures (`np.ndarray`): (n, samples), non-overlapping segments, few of each surface.
        sampling_rate (`float`): Hz.
        groups (`np.ndarray`, *optional*): (n,) surface of each; each its own by default.

    Attributes:
        embedding (`TactileEmbedding`): fitted on the textures.
        points (`np.ndarray`): (n, 53).
    """

    def __init__(self, textures, sampling_rate, groups=None):
        self.sampling_rate = sampling_rate
        self.embedding = TactileEmbedding.fit(textures, sampling_rate)
        self.points = self.embedding(textures, sampling_rate)
        self._within = within_similarity(self.points, self.embedding.width, groups)

    def embed(self, textures):
        """(n, samples) N -> (n, 53)."""
        return self.embedding(textures, self.sampling_rate)

    def distances(self, points, groups):
        """FTD and KTD of a set to the reference, with intervals over the set's groups: leaves "ftd" and "ktd".

        FTD is empty for sets too small for a covariance, KTD, which leaves out pairs of one group, for sets of one
        group. The intervals hold the set's own randomness, not the reference's.

        Args:
            points (`np.ndarray`): (n, 53) embeddings.
            groups (`np.ndarray`): (n,) surface or request of each.
        """
        groups = np.asarray(groups)
        leaves = {"ftd": number(), "ktd": number()}
        if len(np.unique(groups)) > 1:
            ktd, interval = self._kernel_distance(points, groups)
            leaves["ktd"] = number(ktd, len(points), interval)
        fewest = len(points) - (max(np.unique(groups, return_counts=True)[1]) if len(points) else 0)
        if min(fewest, len(self.points) - 1) > points.shape[1]:
            ftd, interval = jackknife(lambda mask: frechet_tactile_distance(points[mask], self.points), groups)
            leaves["ftd"] = number(ftd, len(points), interval)
        return leaves

    def _kernel_distance(self, points, groups):
        """As `kernel_tactile_distance`, each kernel computed once for all members left out."""
        width = self.embedding.width
        kernel = np.exp(-cdist(points, points, "sqeuclidean") / width**2)
        other = groups[:, None] != groups[None, :]
        between = np.exp(-cdist(points, self.points, "sqeuclidean") / width**2).mean(1)

        def distance(mask):
            pairs = other[np.ix_(mask, mask)]
            if not pairs.any():
                return np.nan
            return 1000 * (kernel[np.ix_(mask, mask)][pairs].mean() + self._within - 2 * between[mask].mean())

        return jackknife(distance, groups)

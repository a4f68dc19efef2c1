"""Where a preference is searched: ratings, and what of a texture's numbers ratings leave open."""

import hashlib
import json

import numpy as np
import torch

from ..models import RatingStatistics
from ..pipelines.inputs import LARGEST_RATING
from ..schedulers import draw_noise
from ..signal import coverage_distance
from ..signal.checks import check_number, check_whole_number

#: Range of an axis, z-scores, where the checkpoint knows none; and of a direction, standard deviations of its noise.
RATING_RANGE, DIRECTION_RANGE = (-2.0, 2.0), (-2.0, 2.0)
#: Most directions: each costs comparisons, and the noise of the tenth is hardly felt.
MOST_DIRECTIONS = 8
_FITTED_ON, _MOST_ROUNDS = 2000, 2000


class SearchSpace:
    """Points (n, dimensions): ratings of the searched axes in z-scores, then the noise of directions.

    Directions are those of the scalar network's noise that move the numbers of a texture most, at right angles to how
    ratings move them: singular vectors of the network's linear part. All other noise is the seed's, the same for every
    point, so that two textures differ in nothing but what is searched.

    Args:
        pipe ([`TactileTexturePipeline`]): with `dale`.
        axes (`Sequence[str]`): that are searched; `None` = all.
        directions (`int`): how many.
        ratings (`dict[str, float]`): of axes that are not searched, z-scores; left out = not specified.
        seed (`int`): of all other noise.

    Raises:
        ValueError: naming the argument.
    """

    def __init__(self, pipe, axes, directions, ratings, seed):
        if getattr(pipe, "dale", None) is None:
            raise ValueError("`pipe` must be a TactileTexturePipeline with `dale`: a search generates textures.")
        known = tuple(pipe.dale.config.rating_axes)
        self.pipe, self.seed = pipe, seed
        self.axes = known if axes is None else tuple(axes)
        unknown = [axis for axis in self.axes if axis not in known]
        if unknown or isinstance(axes, str) or len(set(self.axes)) < len(self.axes):
            raise ValueError(f"`axes` must be a list of different names of {list(known)}, got {axes!r}.")
        self.directions = check_whole_number("directions", directions, at_least=0, at_most=MOST_DIRECTIONS)
        if not self.axes and not self.directions:
            raise ValueError("`axes` is empty and `directions` is 0: there is nothing to search.")
        limits = {"at_least": -LARGEST_RATING, "at_most": LARGEST_RATING}
        self.held = {axis: check_number(f"ratings[{axis!r}]", z, **limits) for axis, z in (ratings or {}).items()}
        wrong = [axis for axis in self.held if axis not in known or axis in self.axes]
        if wrong:
            free = [axis for axis in known if axis not in self.axes]
            raise ValueError(f"`ratings` holds axes that are not searched, of {free}, got {wrong[0]!r}.")
        self._vectors = self._find_directions() if directions else None
        statistics = RatingStatistics.from_config(pipe.dale.config)
        self._columns = [known.index(axis) for axis in self.axes]
        ranges = [(statistics.range or [RATING_RANGE] * len(known))[column] for column in self._columns]
        self.low, self.high = np.array([*ranges, *[DIRECTION_RANGE] * directions], dtype=np.float64).T
        spread = np.sqrt(np.diag(statistics.covariance)) if statistics.covariance else np.ones(len(known))
        self.scale = np.array([*spread[self._columns], *np.ones(directions)])
        self._statistics = statistics
        self.draw(1, np.random.default_rng(0))  # refuses what no point can bring near

    @property
    def names(self):
        """Names of the dimensions."""
        return [*self.axes, *(f"direction {number + 1}" for number in range(self.directions))]

    def _find_directions(self):
        """The directions, (directions, scalars)."""
        network = self.pipe.dale.scalar_network
        if network is None:
            raise ValueError("`directions` needs a DALE with a network of scalars (`scalar_width`). Give 0.")
        generator, parameter = torch.Generator().manual_seed(0), next(network.parameters())
        noise = torch.randn(_FITTED_ON, self.pipe.dale.num_scalars, generator=generator)
        config = self.pipe.dale.config
        ratings = torch.randn(_FITTED_ON, config.network_axes or len(config.rating_axes), generator=generator)
        with torch.no_grad():
            found = network(noise.to(parameter), ratings.to(parameter)).float().cpu().numpy()
        inputs = np.hstack([noise.numpy(), ratings.numpy()])
        slopes = np.linalg.lstsq(inputs, found - found.mean(0), rcond=None)[0]
        by_noise, by_ratings = slopes[: noise.shape[1]], slopes[noise.shape[1] :]
        along = by_noise @ by_ratings.T  # (noise, axes)
        left = by_noise - along @ np.linalg.lstsq(along, by_noise, rcond=None)[0]
        vectors = np.linalg.svd(left)[0].T[: self.directions]
        signs = np.sign(vectors[np.arange(len(vectors)), np.abs(vectors).argmax(1)])
        return torch.from_numpy(vectors * signs[:, None])

    def draw(self, count, rng):
        """Points (count, dimensions), even over the range, amid the training surfaces; a `ValueError` if none is."""
        found, known = np.empty((0, len(self.low))), self._statistics
        for _ in range(_MOST_ROUNDS):
            points = rng.uniform(self.low, self.high, (2 * count, len(self.low)))
            if known.reach is not None:
                away = coverage_distance(self.ratings(points), known.centre, known.covariance)
                points = points[~(away > known.reach)]  # NaN: none is specified
            found = np.concatenate([found, points])
            if len(found) >= count:
                return found[:count]
        raise ValueError(f"`ratings` {self.held} lie beyond all training surfaces: hold values nearer to 0, or none.")

    def ratings(self, points):
        """Ratings of points, (n, axes of the checkpoint); NaN = not specified."""
        known = self.pipe.dale.config.rating_axes
        ratings = np.tile([self.held.get(axis, np.nan) for axis in known], (len(points), 1))
        ratings[:, self._columns] = np.asarray(points)[:, : len(self._columns)]
        return ratings

    def textures(self, points):
        """Textures of points (n, dimensions): the pipeline's output."""
        pipe, dale = self.pipe, self.pipe.dale
        shape = (1, dale.config.in_channels, dale.config.latent_frames)
        noise = draw_noise(shape, torch.Generator("cpu").manual_seed(self.seed), "cpu", torch.float32)
        noise = noise.repeat(len(points), 1, 1)
        if self.directions:
            field, scalars = dale.split_scalars(noise)
            vectors = self._vectors.to(scalars)
            wanted = torch.from_numpy(np.asarray(points)[:, len(self.axes) :]).to(scalars)
            noise = dale.append_scalars(field, scalars + (wanted - scalars @ vectors.T) @ vectors)
        generators = [torch.Generator("cpu").manual_seed(self.seed) for _ in points]
        return pipe(
            self.ratings(points),
            generator=generators[0] if len(points) == 1 else generators,
            latents=noise.to(pipe._execution_device, dale.dtype),
        )

    def fingerprint(self):
        """Digest of the weights and the configs that make the textures: a search belongs to one checkpoint."""
        pipe = self.pipe
        models = pipe.dale, pipe.lctg_distilled or pipe.lctg
        configs = [part.config for part in (*models, pipe.dale_scheduler, pipe.scheduler)]
        # without what says where they lie
        configs = [{k: v for k, v in c.items() if k[0] != "_"} for c in (*configs, pipe.feature_extractor.to_dict())]
        digest = hashlib.sha256(json.dumps(configs, sort_keys=True, default=str).encode())
        for model in models:
            for name, part in sorted(model.state_dict().items()):
                digest.update(name.encode() + part.detach().float().cpu().contiguous().numpy().tobytes())
        return digest.hexdigest()

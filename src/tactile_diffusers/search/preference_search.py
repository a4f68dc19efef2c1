"""Two textures at a time, "this one rather": `PreferenceSearch`."""

import json
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from ..io.files import write_text
from ..io.reading import read_json, reading
from ..pipelines import TactileTexturePipelineOutput
from ..signal.checks import check_seed
from .preference_model import ANSWERS, PreferenceModel
from .search_space import SearchSpace

FORMAT, VERSION = "tactile-preference-search", 2
#: Points of which the next pair is chosen, and how many of them may still be the best: mean and standard deviation of
#: their utility add up to most.
_PAIRED, _LIKELY = 200, 60
#: Points of which the best is chosen; draws of the utility by which it is uncertain.
_TRIED, _DRAWS = 2000, 100
#: Standard deviation of the second round about the best of the first, as a share of the range.
_NEAR = 0.07


@dataclass(frozen=True)
class BestTexture:
    """What a [`PreferenceSearch`] has found.

    Args:
        texture ([`TactileTexturePipelineOutput`]): of one texture.
        point (`dict[str, float]`): ratings in z-scores, and directions in standard deviations.
        uncertainty (`dict[str, float]`): standard deviation of each, by the answers so far. It falls with answers that
            agree, and stays where they contradict each other.
    """

    texture: TactileTexturePipelineOutput
    point: dict
    uncertainty: dict


class PreferenceSearch:
    """Finds the texture that somebody prefers by comparisons of two.

    The model of the taste is a Gaussian process ([`PreferenceModel`](preference_model.py)). The pair that is proposed
    is the one of which the answer tells most about it (BALD, Houlsby et al. 2011), among points that may still be the
    best. That few comparisons suffice for vibrations was shown with people by VPL (UMAP 2026).

        search = PreferenceSearch(pipe, axes=["roughness", "bumpiness"], seed=0)
        for _ in range(20):
            pair = search.propose()  # pair.textures[0], pair.textures[1]
            search.answer(ask(pair))  # "first", "second" or "neither"
        search.best().texture

    Args:
        pipe ([`TactileTexturePipeline`]): makes the textures.
        axes (`Sequence[str]`, *optional*): ratings that are searched; all by default.
        directions (`int`, *optional*, defaults to 2): what is searched beside ratings, of what they leave open
            ([`SearchSpace`](search_space.py)).
        ratings (`dict[str, float]`, *optional*): of axes that are not searched, z-scores; by default not specified.
        seed (`int`, *optional*, defaults to 0): of the textures' other noise, and of the pairs.

    Attributes:
        answers (`list[dict]`): `first` and `second`, points (dimensions,), and `answer`, in the order in which they
            came.
        names (`list[str]`): of the dimensions of a point.

    Raises:
        ValueError: naming the argument: unknown axes, nothing to search, a pipeline without DALE.
    """

    def __init__(self, pipe, axes=None, directions=2, ratings=None, seed=0):
        self.seed = check_seed(seed)
        self.space = SearchSpace(pipe, axes, directions, ratings, self.seed)
        self.names, self.answers = self.space.names, []
        self._pair = self._model = None

    def next_pair(self):
        """The points of the next pair, (2, dimensions): the same until it is answered, also after saving and loading.

        A study that makes its own textures asks for points alone.
        """
        if self._pair is None:
            points = self.space.draw(_PAIRED, np.random.default_rng([self.seed, len(self.answers)]))
            mean, covariance = self._fitted().posterior(points / self.space.scale)
            likely = np.argsort(-(mean + np.sqrt(np.diag(covariance))))[:_LIKELY]
            told = _information(mean[likely], covariance[np.ix_(likely, likely)])
            self._pair = points[likely[list(np.unravel_index(told.argmax(), told.shape))]]
        return self._pair.copy()

    def propose(self):
        """Two textures to compare: a [`TactileTexturePipelineOutput`] with two rows, the points of `next_pair`."""
        return self.space.textures(self.next_pair())

    def answer(self, answer, first=None, second=None):
        """Takes an answer.

        Args:
            answer (`str`): `"first"`, `"second"` or `"neither"`.
            first, second (`Sequence[float]`, *optional*): the points (dimensions,) that were compared, of a recorded
                answer; by default the pair that was proposed.

        Raises:
            ValueError: for another word, a point of another shape or beyond the range, or if nothing was proposed. The
                search is as it was.
        """
        if answer not in ANSWERS:
            raise ValueError(f"`answer` must be one of {list(ANSWERS)}, got {answer!r}.")
        if (first is None) != (second is None):
            raise ValueError("`first` and `second` belong together: give both points of a recorded answer, or neither.")
        if first is None:
            if self._pair is None:
                raise ValueError("Nothing was proposed: call `propose()`, or give the points `first` and `second`.")
            first, second = self._pair
        first, second = self._check_point("first", first), self._check_point("second", second)
        self.answers.append({"first": first.tolist(), "second": second.tolist(), "answer": answer})
        self._pair = self._model = None

    def best_point(self):
        """The point (dimensions,) that is most likely preferred, and the standard deviation of where it is, likewise.

        Before the first answer: the middle.
        """
        rng, space = np.random.default_rng([self.seed, len(self.answers), 1]), self.space
        model, points = self._fitted(), space.draw(_TRIED, rng)
        for _ in range(2):
            point = points[model.mean(points / space.scale).argmax()]
            near = point + _NEAR * (space.high - space.low) * rng.standard_normal(points.shape)
            points = np.clip(np.concatenate([point[None], near]), space.low, space.high)
        places = space.draw(_PAIRED, rng)
        mean, covariance = model.posterior(places / space.scale)
        values, vectors = np.linalg.eigh(covariance)
        draws = mean + rng.standard_normal((_DRAWS, len(places))) @ (vectors * np.sqrt(values.clip(0))).T
        return point, places[draws.argmax(1)].std(0)

    def best(self):
        """The texture that is most likely preferred, as a [`BestTexture`]."""
        point, uncertainty = self.best_point()
        named = (dict(zip(self.names, values.tolist(), strict=True)) for values in (point, uncertainty))
        return BestTexture(self.space.textures(point[None]), *named)

    def save(self, path):
        """Writes the search as JSON: its arguments, the answers with their points, a digest of the checkpoint."""
        space = self.space
        content = {"format": FORMAT, "version": VERSION, "checkpoint_sha256": space.fingerprint()}
        content |= {"axes": list(space.axes), "directions": space.directions, "ratings": space.held}
        content |= {"seed": self.seed, "answers": self.answers}
        write_text(path, json.dumps(content, indent=1, allow_nan=False) + "\n")

    @classmethod
    def load(cls, path, pipe):
        """A search that `save` wrote, to go on with.

        Raises:
            FileNotFoundError: if there is no file.
            ValueError: if it is no such file, is damaged, or belongs to another checkpoint than `pipe`'s.
        """
        with reading(path, "a preference search", "Begin another one, or correct it."):
            content = read_json(path, "a preference search", "Begin another one, or correct it.")
            if (content.get("format"), content.get("version")) != (FORMAT, VERSION):
                earlier = "; version 1 did not tell an adapted checkpoint from the original"
                raise ValueError(f'it has no "format": "{FORMAT}" and "version": {VERSION}{earlier}')
            search = cls(pipe, **{name: content[name] for name in ("axes", "directions", "ratings", "seed")})
            if content["checkpoint_sha256"] != search.space.fingerprint():
                raise ValueError(
                    f"{path} belongs to another checkpoint: its points would be other textures. Load the pipeline that "
                    "it was made with, or begin another search."
                )
            for entry in content["answers"]:
                search.answer(entry["answer"], entry["first"], entry["second"])
        return search

    def _check_point(self, name, point):
        try:
            found = np.array([float(value) for value in point])
        except (TypeError, ValueError, OverflowError):
            found = np.empty(0)
        space = self.space
        if found.shape != space.low.shape or not ((space.low <= found) & (found <= space.high)).all():
            ranges = zip(self.names, space.low, space.high, strict=True)
            wanted = ", ".join(f"{each} {low:.2f} to {high:.2f}" for each, low, high in ranges)
            raise ValueError(f"`{name}` must be a point: {wanted}; got {point!r}.")
        return found

    def _fitted(self):
        if self._model is None:
            pairs = [[entry[name] for entry in self.answers] for name in ("first", "second")]
            first, second = (np.array(rows).reshape(-1, len(self.names)) / self.space.scale for rows in pairs)
            self._model = PreferenceModel.fit(first, second, [entry["answer"] for entry in self.answers])
        return self._model


def _information(mean, covariance):
    """What the answer to each pair tells about the utilities (n,), bits: (n, n); as if there were no "neither".

    Entropy of the answer less what is left of it if the utilities were known (Houlsby et al. 2011, equation 5).
    """
    variance = np.diag(covariance)
    spread = np.maximum(variance[:, None] + variance - 2 * covariance, 0)
    ahead = mean[:, None] - mean
    share = ndtr(ahead / np.sqrt(1 + spread)).clip(1e-9, 1 - 1e-9)
    entropy = -share * np.log2(share) - (1 - share) * np.log2(1 - share)
    width = np.pi * np.log(2) / 2
    return entropy - np.sqrt(width / (spread + width)) * np.exp(-0.5 * ahead**2 / (spread + width))

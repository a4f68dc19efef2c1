"""The second judge: can a generated take of a surface be told from a real one?

It is given two takes of one surface, one of them real, and says which is not: right in half of the cases = chance. It
is fitted on other surfaces (cross-validation), and no training loss may use it, as a test holds: a generator that
learned to please it could pass without being real.

Logistic regression of the difference between the two takes, in few of the features, which have names, so that its
coefficients say what gives a take away. Two kinds: one knows only the two takes, and finds what is wrong with all of
them; one knows other takes of the surface too, and finds what is another surface. The second is the most sensitive to
reconstructions from the base layer; the first alone says what is unreal, since ratings do not settle a surface.
"""

from dataclasses import dataclass

import numpy as np

FOLDS = 5
#: Inverse strength of the L1 penalty, which keeps few features; a surface counts once. Measured on 60 virtual surfaces
#: of recipe 3, beside two takes of each: real takes upside down 0.83 (an L2 penalty: 0.64), base layers decoded by LCTG
#: 0.86 (0.92), real takes 0.51 (0.52). From 0.1 to 0.3 these change by 0.03 or less.
C = 0.15


@dataclass(frozen=True)
class SecondJudge:
    """A fitted judge; make one with `fit`. It refuses surfaces and real takes that it was fitted on.

    Takes are (surfaces, takes, features). `seen` holds the surfaces of the fit, and its real takes as bytes: a surface
    may come under another name. `middle` and `spread` (features,) are of the real takes, `coefficients` (inputs,) of
    the two or three blocks of features that the regression sees.
    """

    seen: frozenset
    middle: np.ndarray
    spread: np.ndarray
    coefficients: np.ndarray

    @classmethod
    def fit(cls, real, fake, surfaces, least, references=None):
        """Fits a judge on all pairs of a real and a fake take of one surface, (surfaces, takes, features) each.

        `surfaces` are their names, `least` (features,) the least spread that counts; `references`, more real takes,
        make a judge that knows the surface. A ValueError if shapes do not fit together or a feature is not finite.
        """
        from sklearn.linear_model import LogisticRegression

        real, fake, references = _checked(surfaces, real, fake, references)
        flat = real.reshape(-1, real.shape[-1])
        middle, spread = flat.mean(0), np.maximum(flat.std(0), least)
        a, b = (_inputs(takes, references, middle, spread) for takes in (real, fake))
        pairs = (b[:, :, None] - a[:, None]).reshape(-1, a.shape[-1])
        scale = np.maximum(pairs.std(0), np.tile(least, pairs.shape[1] // len(least)))
        # which of the two comes first is arbitrary: every other pair is turned round, and there is no intercept
        sign = np.where(np.arange(len(pairs)) % 2, 1, -1)
        model = LogisticRegression(C=C, l1_ratio=1, solver="liblinear", fit_intercept=False, random_state=0)
        model.fit(pairs / scale * sign[:, None], sign > 0, np.full(len(pairs), len(real) / len(pairs)))
        seen = frozenset([*np.asarray(surfaces).tolist(), *_fingerprints(real)])
        return cls(seen, middle, spread, model.coef_[0] / scale)

    def contributions(self, takes, surfaces, references=None):
        """What each feature adds to the log odds that a take is not real: (surfaces, takes, features).

        Only differences between takes of one surface mean something. A ValueError if the judge was fitted on one of the
        surfaces or real takes, or as `fit`.
        """
        takes, references = _checked(surfaces, takes, references)
        leaked = self.seen.intersection([*np.asarray(surfaces).tolist(), *_fingerprints(takes)])
        if leaked:
            raise ValueError(
                f"The judge was fitted on {len(leaked)} of these surfaces and real takes: it would know them. Judge "
                "surfaces that it has not seen."
            )
        inputs = _inputs(takes, references, self.middle, self.spread)
        return (inputs * self.coefficients).reshape(*takes.shape[:2], -1, takes.shape[2]).sum(2)


def tell_apart(real, fake, surfaces, least, references=None, seed=0):
    """How often takes are told apart by judges of other surfaces, in five folds of surfaces, and by what.

    Arguments as of `SecondJudge.fit`. Returns (surfaces,) the share of right answers over all pairs of a surface, which
    is the area under its ROC curve; and (surfaces, features) what each feature contributes to the mean log odds of a
    right answer.
    """
    real, fake, references = _checked(surfaces, real, fake, references)
    surfaces, fold = np.asarray(surfaces), np.random.default_rng(seed).permutation(len(real)) % FOLDS
    shares, contributions = np.zeros(len(real)), np.zeros((len(real), real.shape[-1]))
    for number in range(FOLDS):
        inside, outside = fold != number, fold == number
        known = [None if references is None else references[rows] for rows in (inside, outside)]
        judge = SecondJudge.fit(real[inside], fake[inside], surfaces[inside], least, known[0])
        a, b = (judge.contributions(takes[outside], surfaces[outside], known[1]) for takes in (real, fake))
        margins = b.sum(-1)[:, :, None] - a.sum(-1)[:, None]
        shares[outside] = ((margins > 0) + 0.5 * (margins == 0)).mean((1, 2))
        contributions[outside] = b.mean(1) - a.mean(1)
    return shares, contributions


def _inputs(takes, references, middle, spread):
    """Blocks of features: (surfaces, takes, inputs)."""
    if references is None:  # each feature, and how unusual it is
        return np.concatenate([takes, np.square((takes - middle) / spread) * spread], -1)
    # the deviation from the surface, its size, and its direction towards the middle of all surfaces or away from it
    surface = references.mean(1, keepdims=True)
    deviation = takes - surface
    return np.concatenate([deviation, np.abs(deviation), deviation * (surface - middle) / spread], -1)


def _fingerprints(takes):
    return [take.tobytes() for take in takes.reshape(-1, takes.shape[-1])]


def _checked(surfaces, *takes):
    """Takes as float64 arrays (surfaces, takes, features), None kept."""
    takes = [None if array is None else np.asarray(array, dtype=np.float64) for array in takes]
    known = [array for array in takes if array is not None]
    shapes = [array.shape for array in known]
    if not all(len(shape) == 3 and shape[0] == len(surfaces) and shape[2] == shapes[0][2] for shape in shapes):
        raise ValueError(
            f"Takes must have the shape ({len(surfaces)}, takes, features), a row for each of `surfaces`, got {shapes}."
        )
    if not all(np.isfinite(array).all() for array in known):
        raise ValueError("Takes must have finite features: leave out those that are not.")
    return takes

"""Section "novel": ratings that no surface has, alone and in every combination, beyond what people ever give."""

import itertools

import numpy as np

from ...signal import RATING_AXES
from ..metrics.copying import nearest_distance
from ..metrics.errors import DB_PER_NEPER
from ..metrics.statistics import leaf, number
from ..sampling import noise_seeds

#: Magnitudes of the ratings: of the corners of the cube, and of one axis while the others are not specified.
MAGNITUDES = (1.0, 2.0, 3.0, 4.0)
#: Real held-out textures of which so many per cent are farther from training than a limit set the limit.
FARTHEST_PERCENT = 1.0


def run(context):
    """The section: `{"novel": {name of a set of ratings: leaves}}`; what real held-out textures are stands beside."""
    real = {
        "level_db": leaf(DB_PER_NEPER * context.held_out.levels[context.chosen[0]], context.surfaces),
        "friction": leaf(context.real_frictions, context.surfaces),
    }
    distances = nearest_distance(context.real_points, context.reference.points)
    limit = np.percentile(distances, 100 - FARTHEST_PERCENT)
    trained = context.train.levels * DB_PER_NEPER
    rows = {"real, held out": real | _beyond(context.real, distances, limit, context.surfaces)}
    for scale in context.guidance_scales:
        for magnitude in MAGNITUDES:
            for name, ratings in _requests(magnitude).items():
                entry = _measure(context, ratings, scale, limit, (trained.min(), trained.max()))
                rows[f"{name} ±{magnitude:g}, guidance {scale}"] = entry
    return {"novel": rows | {"range_db": number(trained.mean(), len(trained), None, trained.min(), trained.max())}}


def _requests(magnitude):
    """Ratings of one magnitude: each axis alone, both ways, and all corners of the cube."""
    alone = np.full((2 * len(RATING_AXES), len(RATING_AXES)), np.nan)
    for row, (axis, sign) in enumerate(itertools.product(range(len(RATING_AXES)), (-1, 1))):
        alone[row, axis] = sign * magnitude
    corners = magnitude * np.array(list(itertools.product((-1.0, 1.0), repeat=len(RATING_AXES))))
    return {"one axis": alone, "corners": corners}


def _measure(context, ratings, scale, limit, trained):
    takes = max(2, context.settings.control_takes // 10)
    asked = np.repeat(ratings, takes, axis=0)
    made = context.generate(asked, noise_seeds([context.seed, 7], len(asked)), scale)
    groups = np.repeat(np.arange(len(ratings)), takes)
    finite = np.isfinite(made.textures).all(-1)
    levels = DB_PER_NEPER * made.levels
    inside = (levels >= trained[0]) & (levels <= trained[1])
    entry = {
        "level_db": leaf(levels, groups),
        "friction": leaf(made.friction_coefficients, groups),
        "finite": number(finite.mean(), len(finite)),
        "level_inside": number(inside.mean(), len(inside)),
    }
    if finite.all():
        distances = nearest_distance(context.reference.embed(made.textures), context.reference.points)
        entry |= _beyond(made.textures, distances, limit, groups)
    return entry


def _beyond(textures, distances, limit, groups):
    """Share of textures farther from every training texture than almost all real ones, and how peaked they are."""
    crest = np.abs(textures).max(-1) / np.sqrt(np.mean(np.square(textures, dtype=np.float64), axis=-1))
    return {
        "beyond": number(np.mean(distances > limit), len(distances)),
        "crest": leaf(crest, groups),
    }

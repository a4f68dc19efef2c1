"""Section "novel": textures from ratings outside of training, on one axis and in every combination."""

import itertools

import numpy as np

from ...signal import RATING_AXES
from ..metrics.copying import nearest_distance
from ..metrics.errors import DB_PER_NEPER
from ..metrics.statistics import leaf, number

#: Magnitudes of the ratings: of the corners of the cube, and of one axis while the others are not specified.
MAGNITUDES = (1.0, 2.0, 3.0, 4.0)
#: This many per cent of real held-out textures are farther from training than the limit.
FARTHEST_PERCENT = 1.0


def run(context):
    """The section: `{"novel": {name of a set of ratings: leaves}}`; real held-out textures stand beside."""
    data = context.data
    real = {
        "level_db": leaf(DB_PER_NEPER * data.dataset.levels[data.rows], data.surfaces),
        "friction": leaf(data.frictions, data.surfaces),
    }
    distances = nearest_distance(data.points, data.reference.points)
    limit = np.percentile(distances, 100 - FARTHEST_PERCENT)
    trained = data.train.levels * DB_PER_NEPER
    rows = {"real, held out": real | _beyond(data.real, distances, limit, data.surfaces)}
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
    requested = np.repeat(ratings, takes, axis=0)
    generated = context.generate(requested, context.seeds(7, len(requested)), scale)
    groups = np.repeat(np.arange(len(ratings)), takes)
    finite = np.isfinite(generated.textures).all(-1)
    levels = DB_PER_NEPER * generated.levels
    inside = (levels >= trained[0]) & (levels <= trained[1])
    entry = {
        "level_db": leaf(levels, groups),
        "friction": leaf(generated.friction_coefficients, groups),
        "finite": number(finite.mean(), len(finite)),
        "level_inside": number(inside.mean(), len(inside)),
    }
    if finite.all():
        reference = context.data.reference
        distances = nearest_distance(reference.embed(generated.textures), reference.points)
        entry |= _beyond(generated.textures, distances, limit, groups)
    return entry


def _beyond(textures, distances, limit, groups):
    """Share of textures farther from every training texture than almost all real ones, and how peaked they are."""
    crest = np.abs(textures).max(-1) / np.sqrt(np.mean(np.square(textures, dtype=np.float64), axis=-1))
    return {
        "beyond": number(np.mean(distances > limit), len(distances)),
        "crest": leaf(crest, groups),
    }

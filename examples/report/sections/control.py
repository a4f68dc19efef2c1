"""Section "control": does a change of the ratings change textures as it does between real surfaces.

A condition rates one axis and leaves the others open. The ratings requested are those of the real surfaces that stand
for it, few near ±2: both sides have the same ratings.
"""

from functools import partial

import numpy as np

from tactile_diffusers.data import PreparedDataset
from tactile_diffusers.evaluation.judge import FEWEST_SURFACES, Judge, explained, response_matrix
from tactile_diffusers.evaluation.metrics.rating_effects import shape_change_db, texture_measures
from tactile_diffusers.evaluation.metrics.statistics import estimate, jackknife, leaf, number
from tactile_diffusers.evaluation.truth import KERNEL_WIDTH, LEAST_EFFECTIVE_SIZE
from tactile_diffusers.signal import level

from ..baselines import BaselineRequest, KnnBlend
from ..changes import against_real, comparisons, counted, no_change, null_counts, paired
from ..envelopes import surface_means
from ..figures import plot_control, plot_curves
from ..virtual_truth import can_be_continued, fresh_training, truth_of
from .regression import best_polynomial
from .response import response_curves

# fewest requests for three slopes and an intercept, also with one left out
_FEWEST_REQUESTS = 6
# baselines that work from ratings
_STEERABLE = ("knn_blend", "ridge")


def run(context):
    """The section: `{"control": ...}`; writes control.png and curves.png."""
    data, truth = context.data, _truth(context)
    judge, r2 = _judge(context)
    real = _estimate(judge, data.points, data.frictions)
    result = {
        "judge_r2": r2,
        "response_real": _matrix(real, data.ratings, data.surfaces),
        "truth": _sizes(truth, context),
    }
    for scale in context.guidance_scales:
        result |= _guided(context, scale, truth, judge)
    result["baselines"] = {
        slug: _baseline(context, slug, judge, truth) for slug in _STEERABLE if slug in context.baselines
    }
    result["regression"] = {"axes": _regression(context, truth, data.training)}
    result["equal_data"] = _equal_data(context, truth)
    result["counts"] = _counts(context, result, truth)
    result["curves"] = response_curves(context, lambda points, frictions: _estimate(judge, points, frictions))
    plot_control(result, context.default_guidance, context.output / "control.png")
    plot_curves(result["curves"], context.output / "curves.png")
    return {"control": result}


def _counts(context, result, truth):
    """`{name: leaves}` of the changes that are right, by the model, by what stands beside it, and by real surfaces."""
    ours = result[str(context.default_guidance)]["axes"]
    candidates = {"model": ours, "permuted": result["permuted"]["axes"], "regression": result["regression"]["axes"]}
    candidates |= {slug: entry["axes"] for slug, entry in result["baselines"].items()} | {"none": no_change(ours)}
    candidates |= {f"{name}_equal": entry["axes"] for name, entry in result["equal_data"].items()}
    rows = {name: comparisons(axes, LEAST_EFFECTIVE_SIZE) for name, axes in candidates.items()}
    found = {name: counted(some) | paired(rows["model"], some) for name, some in rows.items()}
    requests = {key: _request(context, key) for key in _conditions(context)[1:]}
    return found | {"null": null_counts(truth, requests, LEAST_EFFECTIVE_SIZE, context.rng("null"))}


def _equal_data(context, truth):
    """Conditions of the blend and of the polynomials on fresh surfaces, as many as the bundled checkpoint learned from.

    None of them is in the truth. Empty where fresh surfaces cannot be had.
    """
    data, settings = context.data, context.settings
    if not can_be_continued(data.dataset):
        return {}
    dataset, after = PreparedDataset(data.dataset.path, "all").set_axes(context.axes), settings.truth_candidates
    options = {"seconds": settings.truth_seconds, "workers": 2, "quiet": context.quiet}
    training = fresh_training(dataset, settings.equal_surfaces, after, **options)
    blend = _of_baseline(context, KnnBlend().fit(training), truth)
    return {
        "knn_blend": compare_conditions(context, blend, truth),
        "regression": {"axes": _regression(context, truth, training)},
    }


def _regression(context, truth, training):
    """Conditions as the best polynomials of one rating predict them, fitted to training surfaces."""
    data = context.data
    training = training.keep(np.isfinite(training.ratings).all(-1))
    measures = _measures(context, training.textures, level(training.textures), training.friction_coefficients)
    targets = np.column_stack([measures[name] for name in ("level_db", "log_friction", "shape_db")])
    ratings, targets = (surface_means(values, training.surface_ids) for values in (training.ratings, targets))
    axes = {axis: {} for axis in context.axes}
    for index, axis in enumerate(context.axes):
        # each target has a degree of its own
        fits = [best_polynomial(ratings[:, [index]], target[:, None], data.seed)[0] for target in targets.T]
        for value in context.settings.control_values:
            requested = truth.draw_ratings(_request(context, (axis, value)), context.settings.control_takes)[:, [index]]
            change = np.array([fit(requested).mean() for fit in fits]) - targets.mean(0)
            changes = {"level_db": change[0], "log_friction": change[1], "shape_db": change[2:]}
            axes[axis][str(value)] = against_real(changes, truth, _request(context, (axis, value)))
    return axes


def _guided(context, scale, truth, judge):
    """Entry of one guidance scale; for the default one also "permuted": the same textures under wrong ratings."""
    ratings, surfaces = context.requests
    conditions = {key: _generated(context, key, scale, truth) for key in _conditions(context)}
    generated = context.generated[scale]
    points = context.data.reference.embed(generated.textures)
    estimated = _estimate(judge, points, generated.friction_coefficients)
    entry = compare_conditions(context, conditions, truth) | {"response": _matrix(estimated, ratings, surfaces)}
    if scale != context.default_guidance:
        return {str(scale): entry}
    shuffled = context.rng("permuted").permutation(len(ratings))
    response = _matrix(None if estimated is None else estimated[shuffled], ratings, surfaces)
    wrong = compare_conditions(context, _permuted(context, conditions), truth)
    return {str(scale): entry, "permuted": wrong | {"response": response}}


def _conditions(context):
    """(axis, value) of every condition; (None, None) is the baseline, nothing specified."""
    values = context.settings.control_values
    return [(None, None), *((axis, value) for axis in context.axes for value in values)]


def _permuted(context, conditions):
    """Conditions under another value: the lower half of each axis changes places with its upper half."""
    values = context.settings.control_values
    half = len(values) // 2
    other = dict(zip(values, [*values[-half:], *values[half : len(values) - half], *values[:half]], strict=True))
    return {key: made if key[0] is None else conditions[key[0], other[key[1]]] for key, made in conditions.items()}


def _request(context, key):
    axis, value = key
    return np.array([value if name == axis else np.nan for name in context.axes], dtype=np.float64)


def _truth(context):
    """`RatedTextures`: measures of real textures, from which the truth of a request is read."""
    settings, data = context.settings, context.data.dataset
    return truth_of(
        PreparedDataset(data.path, "hard" if data.split == "hard" else "all").set_axes(context.axes),
        [_request(context, key) for key in _conditions(context)],
        partial(_measures, context),
        candidates=settings.truth_candidates,
        surfaces=settings.truth_surfaces,
        seconds=settings.truth_seconds,
        workers=2,
        seed=context.seed,
        quiet=context.quiet,
    )


def _measures(context, textures, levels, frictions):
    """`texture_measures` of textures, without friction where the data do not know it."""
    data = context.data
    frictions = frictions if data.has_friction else np.full(len(textures), np.nan)
    return texture_measures(textures, levels, frictions, data.rate, data.edges)


def _judge(context):
    """The judge, fitted on training surfaces, and leaves of its R² on held-out ones; None, with few rated surfaces."""
    data, training = context.data, context.data.training
    rated = np.isfinite(training.ratings).all(-1)
    if len(np.unique(training.surface_ids[rated])) < FEWEST_SURFACES:
        return None, {axis: number() for axis in context.axes}
    frictions = np.log(training.friction_coefficients)
    judge = Judge.fit(
        data.reference.points, frictions, training.ratings, training.surface_ids, context.seed, context.axes
    )
    predicted = _estimate(judge, data.points, data.frictions)
    r2, (low, high) = jackknife(lambda mask: explained(predicted[mask], data.ratings[mask]), data.surfaces)
    return judge, {axis: number(r2[i], len(data.points), (low[i], high[i])) for i, axis in enumerate(context.axes)}


def _estimate(judge, points, frictions):
    return None if judge is None else judge.predict(points, np.log(frictions))


def _matrix(estimated, requested, groups):
    """Leaves, axes x axes: slope of the estimated (row) on the requested (column) rating; empty for few surfaces."""
    rated = np.isfinite(requested).all(-1)
    if estimated is None or len(np.unique(groups[rated])) < _FEWEST_REQUESTS:
        return [[number() for _ in requested.T] for _ in requested.T]
    estimated, requested, groups = estimated[rated], requested[rated], groups[rated]
    slopes, (low, high) = jackknife(lambda mask: response_matrix(estimated[mask], requested[mask]), groups)
    axes = range(len(slopes))
    return [[number(slopes[i, j], len(groups), (low[i, j], high[i, j])) for j in axes] for i in axes]


def _generated(context, key, scale, truth):
    """Measures of the textures of one condition, from the same noise in each."""
    takes = context.settings.control_takes
    out = context.generate(truth.draw_ratings(_request(context, key), takes), context.seeds(3, takes), scale)
    return _measures(context, out.textures, out.levels, out.friction_coefficients)


def _baseline(context, slug, judge, truth):
    """The same figures for a baseline that works from ratings."""
    baseline, data = context.baselines[slug], context.data
    frictions = baseline.friction_coefficients(data.request, context.rng(slug))
    estimated = _estimate(judge, context.baseline_points[slug], frictions)
    response = _matrix(estimated, data.request.ratings, data.surfaces)
    return compare_conditions(context, _of_baseline(context, baseline, truth), truth) | {"response": response}


def _of_baseline(context, baseline, truth):
    """Measures of a fitted baseline's textures, (axis, value) -> dict."""
    conditions, purpose = {}, f"control {baseline.slug}"
    for key in _conditions(context):
        request = BaselineRequest(truth.draw_ratings(_request(context, key), context.settings.control_takes))
        textures = baseline.sample(request, context.rng(purpose))
        # a generator in the same state: the friction that belongs to these textures
        frictions = baseline.friction_coefficients(request, context.rng(purpose))
        conditions[key] = _measures(context, textures, level(textures), frictions)
    return conditions


def compare_conditions(context, conditions, truth):
    """`{"axes": {axis: {value: leaves}}}` of conditions, (axis, value) -> measures, beside real surfaces, `truth`.

    (None, None) is the baseline.
    """
    axes, base = {axis: {} for axis in context.axes}, conditions[None, None]
    for key in _conditions(context)[1:]:
        axes[key[0]][str(key[1])] = _against_truth(conditions[key], base, truth, _request(context, key))
    return {"axes": axes}


def _against_truth(ours, base, truth, request):
    """Leaves of one condition beside those of real surfaces with these ratings."""
    size, takes = truth.effective_size(request), np.arange(len(ours["level_db"]))
    # take by take from the same noise
    changes = {name: values - base[name] for name, values in ours.items()}
    entry = against_real({name: values.mean(0) for name, values in changes.items()}, truth, request)
    for name in ("level_db", "log_friction"):
        entry[name], entry[f"{name}_change"] = leaf(ours[name]), leaf(changes[name])
        entry[f"{name}_truth"] = number(truth.mean(name, request), size, truth.interval(name, request))
    shape, shape_base = ours["shape_db"], base["shape_db"]
    entry["shape_db"] = estimate(lambda mask: shape_change_db(shape[mask].mean(0), shape_base[mask].mean(0)), takes)
    entry["rating_truth"] = number(truth.mean_rating(request)[np.isfinite(request)][0], size)
    return entry


def _sizes(truth, context):
    """Effective number of surfaces behind each condition, and the distance of their mean rating from the request."""
    sizes, offsets = {}, {}
    for axis, value in _conditions(context)[1:]:
        request, name = _request(context, (axis, value)), f"{axis} {value:+g}"
        size = truth.effective_size(request)
        sizes[name] = number(size, len(truth.ratings))
        offsets[name] = number(truth.mean_rating(request)[context.axes.index(axis)] - value, size)
    return {
        "effective_surfaces": sizes,
        "rating_offset": offsets,
        "fewest_surfaces": number(LEAST_EFFECTIVE_SIZE),
        "largest_offset": number(KERNEL_WIDTH),
    }

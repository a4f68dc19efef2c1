"""Section "control": do ratings do what they do in real data, neither less nor more.

A condition rates one axis and leaves the others open. Bounded answers and disagreeing raters leave few surfaces at ±2:
what is asked for are the ratings of the real surfaces that stand for a condition, so that both sides have the same.
"""

import numpy as np
import torch
from scipy.stats import spearmanr

from ...signal import RATING_AXES, level
from ..baselines import BaselineRequest
from ..judge import FEWEST_SURFACES, Judge, response_interval, response_matrix
from ..metrics.rating_effects import d_prime, latent_shift_percent, shape_change_db, texture_measures
from ..metrics.statistics import jackknife, leaf, number
from ..report_figures import plot_control, plot_responses
from ..sampling import noise_seeds
from ..truth import KERNEL_WIDTH, LEAST_EFFECTIVE_SIZE, truth_of

# requests from which three slopes and an intercept can be told, also with one left out
_FEWEST_REQUESTS = 6
# baselines that know ratings and so can be steered
_STEERABLE = ("knn_blend", "ridge")


def run(context):
    """The section: `{"control": ...}`; writes control.png and response.png."""
    truth = _truth(context)
    judge, r2 = _judge(context)
    held_out, frictions = context.held_out, np.log(context.real_frictions)
    real = _recovered(judge, context.real_points, frictions)
    requested = held_out.surface_ratings[context.surfaces]
    result = {
        "judge_r2": r2,
        "response_real": _matrix(real, requested, context.surfaces),
        "estimator_real": _estimator_response(context, context.real, context.real_frictions, requested),
        "truth": _sizes(truth, context),
    }
    ratings, surfaces = context.requests
    for scale in context.guidance_scales:
        made = {key: _generated(context, key, scale, truth) for key in _conditions(context)}
        independent = _generated(context, (None, None), scale, truth, purpose=6)
        textures = context.generated(scale)
        points = context.reference.embed(textures.textures)
        recovered = _recovered(judge, points, np.log(textures.friction_coefficients))
        heard = {key: getattr(textures, key) for key in ("latents", "levels", "friction_coefficients")}
        result[str(scale)] = _axes(context, made, truth, independent) | {
            "response": _matrix(recovered, ratings, surfaces),
            "estimator": _matrix(_estimated(context, **heard), ratings, surfaces),
        }
        if scale == context.default_guidance:
            # the control: the same textures under the wrong labels must fail
            wrong = _axes(context, _permuted(context, made), truth, independent)
            shuffled = context.rng("permuted").permutation(len(ratings))
            response = _matrix(None if recovered is None else recovered[shuffled], ratings, surfaces)
            result["permuted"] = wrong | {"response": response}
    result["baselines"] = {
        slug: _baseline(context, slug, judge, truth) for slug in _STEERABLE if slug in context.baselines
    }
    plot_control(result, context.default_guidance, context.output / "control.png")
    plot_responses(result, context.default_guidance, context.output / "response.png")
    return {"control": result}


def _conditions(context):
    """(axis, value) of every condition; (None, None) is the baseline, nothing specified."""
    values = context.settings.control_values
    return [(None, None), *((axis, value) for axis in RATING_AXES for value in values)]


def _permuted(context, made):
    """Conditions under the label of another value: each axis's lower half changes places with its upper half."""
    values = context.settings.control_values
    half = len(values) // 2
    other = dict(zip(values, [*values[-half:], *values[half : len(values) - half], *values[:half]], strict=True))
    return {key: condition if key[0] is None else made[key[0], other[key[1]]] for key, condition in made.items()}


def _request(key):
    axis, value = key
    return np.array([value if name == axis else np.nan for name in RATING_AXES], dtype=np.float64)


def _truth(context):
    """Real textures, from which what belongs to a request is read."""

    def describe(textures, levels, friction_coefficients):
        latents = context.summarise(textures)
        if not context.knows_friction:
            friction_coefficients = np.full(len(textures), np.nan)
        return texture_measures(textures, levels, friction_coefficients, context.rate, context.edges, latents)

    requests = [_request(key) for key in _conditions(context)]
    settings = context.settings
    return truth_of(
        context.held_out.path,
        requests,
        describe,
        candidates=settings.truth_candidates,
        surfaces=settings.truth_surfaces,
        seconds=settings.truth_seconds,
        workers=2,
        seed=context.seed,
        quiet=context.quiet,
    )


def _judge(context):
    """The judge, fitted on training surfaces, and its R² on held-out ones: leaves by axis.

    With too few rated surfaces for a judge there is none, and its leaves are empty.
    """
    training, held_out = context.training, context.held_out
    rated = np.isfinite(training.ratings).all(-1)
    ratings = held_out.surface_ratings[context.surfaces]
    if len(np.unique(training.surface_ids[rated])) < FEWEST_SURFACES:
        return None, {axis: number() for axis in RATING_AXES}
    frictions = np.log(training.friction_coefficients)
    judge = Judge.fit(context.reference.points, frictions, training.ratings, training.surface_ids, context.seed)
    points, frictions = context.real_points, np.log(context.real_frictions)
    r2 = judge.r2(points, frictions, ratings)
    low, high = judge.r2_interval(points, frictions, ratings, context.surfaces)
    return judge, {axis: number(r2[i], len(points), (low[i], high[i])) for i, axis in enumerate(RATING_AXES)}


def _recovered(judge, points, log_friction):
    return None if judge is None else judge.predict(points, log_friction)


def _estimator_response(context, textures, frictions, requested):
    """What the checkpoint's own estimator hears of real textures: 3 x 3 leaves."""
    if context.pipe.rating_estimator is None:
        return _matrix(None, requested, context.surfaces)
    recovered = context.pipe.estimate_ratings(textures, context.rate, frictions)
    return _matrix(recovered, requested, context.surfaces)


def _estimated(context, latents, levels, friction_coefficients):
    """What the estimator, which helped to train DALE, hears of DALE's own result before it is decoded: (n, 3).

    If it hears more of the ratings than the judge does after decoding, DALE flatters it. `None` without an estimator.
    """
    pipe = context.pipe
    if pipe.rating_estimator is None:
        return None
    parts = (latents[:, : pipe.lctg.base_channels], levels, friction_coefficients)
    state = pipe.dale.pack(*(torch.from_numpy(np.asarray(part, dtype=np.float32)).to(pipe.device) for part in parts))
    with torch.no_grad():
        knows = torch.isfinite(torch.from_numpy(friction_coefficients)).to(pipe.device)
        return pipe.rating_estimator(pipe.dale.pool_state(state), knows).float().cpu().numpy()


def _matrix(recovered, requested, groups):
    """3 x 3 leaves: slope of the recovered (row) on the requested (column) rating; empty for too few surfaces."""
    rated = np.isfinite(requested).all(-1)
    if recovered is None or len(np.unique(groups[rated])) < _FEWEST_REQUESTS:
        return [[number() for _ in range(3)] for _ in range(3)]
    recovered, requested, groups = recovered[rated], requested[rated], groups[rated]
    slopes, (low, high) = response_matrix(recovered, requested), response_interval(recovered, requested, groups)
    return [[number(slopes[i, j], len(groups), (low[i, j], high[i, j])) for j in range(3)] for i in range(3)]


class _Condition:
    """Measures of one condition, and what is needed to compare it with the baseline."""

    def __init__(self, context, textures, levels, frictions, latents=None):
        summary = context.summarise(textures)
        frictions = frictions if context.knows_friction else np.full(len(textures), np.nan)
        self.measures = texture_measures(textures, levels, frictions, context.rate, context.edges, summary)
        self.latents = latents


def _generated(context, key, scale, truth, purpose=3):
    """Textures of one condition; one `purpose` is one set of noises."""
    takes = context.settings.control_takes
    ratings = truth.draw_ratings(_request(key), takes)
    made = context.generate(ratings, noise_seeds([context.seed, purpose], takes), scale)
    return _Condition(context, made.textures, made.levels, made.friction_coefficients, made.latents)


def _baseline(context, slug, judge, truth):
    """The same figures for a baseline that knows ratings."""
    baseline, takes = context.baselines[slug], context.settings.control_takes
    made = {}
    for key in _conditions(context):
        request, rng = BaselineRequest(truth.draw_ratings(_request(key), takes)), context.rng(f"control {slug}")
        textures = baseline.sample(request, rng)
        # the same state of the generator: the friction that belongs to these textures
        frictions = baseline.friction_coefficients(request, context.rng(f"control {slug}"))
        made[key] = _Condition(context, textures, level(textures), frictions)
    frictions = np.log(baseline.friction_coefficients(context.request, context.rng(slug)))
    recovered = _recovered(judge, context.baseline_points[slug], frictions)
    response = _matrix(recovered, context.request.ratings, context.surfaces)
    return _axes(context, made, truth) | {"response": response}


def _axes(context, made, truth, independent=None):
    """`{"axes": {axis: {value: leaves}}, "spearman": {axis: leaves}}` of conditions.

    `independent`: the baseline from noise of its own, as the chance that d′ takes out supposes.
    """
    axes, spearman, base = {}, {}, made[None, None]
    independent = independent or base
    values = context.settings.control_values
    for axis in RATING_AXES:
        axes[axis] = {
            str(value): _against_truth(made[axis, value], base, independent, truth, _request((axis, value)))
            for value in values
        }
        moved, tracks, real = _tracks(truth, axis, values, [made[axis, value].measures for value in values])
        found = {name: number(spearmanr(values, track).statistic, len(values)) for name, track in tracks.items()}
        direction = np.sign(spearmanr(values, real).statistic)
        along = number(direction * spearmanr(values, tracks[moved]).statistic, len(values))
        spearman[axis] = found | {"moved": along, "moved_name": moved}
    return {"axes": axes, "spearman": spearman}


def _tracks(truth, axis, values, measures):
    """What an axis moves most in truth, means over a sweep of all that it could, and the real means of the former.

    A name, name -> (values,), and (values,). Of the shape, what lies along the difference that real textures show
    between the two ends of the sweep.
    """
    nothing = np.full(len(RATING_AXES), np.nan)
    requests = [_request((axis, value)) for value in values]
    ends = [truth.mean("shape_db", request) for request in (requests[0], requests[-1])]
    direction = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    tracks, effects, means = {}, {}, {}
    for name in ("level_db", "shape_db", "log_friction"):
        along = (lambda value: value @ direction) if name == "shape_db" else (lambda value: value)
        tracks[name] = [along(made[name]).mean() for made in measures]
        means[name] = [along(truth.mean(name, request)) for request in requests]
        spread = along(truth.measures[name]).std() if name == "shape_db" else truth.spread(name, nothing)
        effects[name] = np.nan_to_num(np.ptp(means[name]) / spread)
    moved = max(effects, key=effects.get)
    return moved, tracks, means[moved]


def _against_truth(condition, base, independent, truth, request):
    """Leaves of one condition beside what real data with these ratings are."""
    nothing = np.full(len(RATING_AXES), np.nan)
    ours, ours_base = condition.measures, base.measures
    entry = {}
    for name in ("level_db", "log_friction"):
        entry[name] = leaf(ours[name])
        interval = truth.interval(name, request)
        entry[f"{name}_truth"] = number(truth.mean(name, request), truth.effective_size(request), interval)
        entry[f"{name}_change"] = leaf(ours[name] - ours_base[name])  # take by take from the same noise
        nothing_mean = truth.mean(name, nothing)
        shifted = tuple(bound - nothing_mean for bound in interval)
        entry[f"{name}_change_truth"] = number(
            truth.mean(name, request) - nothing_mean, truth.effective_size(request), shifted
        )

    takes = np.arange(len(ours["level_db"]))
    change = jackknife(
        lambda mask: shape_change_db(ours["shape_db"][mask].mean(0), ours_base["shape_db"][mask].mean(0)), takes
    )
    entry["shape_db"] = number(change[0], len(takes), change[1])
    true_change = truth.mean("shape_db", request) - truth.mean("shape_db", nothing)
    size, change = truth.effective_size(request), np.abs(true_change).mean()
    low, high = truth.interval("shape_db", request)
    chance = float(np.mean(high - low)) / 2
    entry["shape_db_truth"] = number(change, size, (change - chance, change + chance))
    own_change = ours["shape_db"].mean(0) - ours_base["shape_db"].mean(0)
    entry["shape_difference_db"] = number(np.abs(own_change - true_change).mean(), len(takes))

    percent = None if condition.latents is None else latent_shift_percent(condition.latents, base.latents)
    entry["latent_shift_percent"] = leaf(percent)
    ends = [(m["latent"].mean(0), m["latent"].std(0, ddof=1), len(takes)) for m in (ours, independent.measures)]
    entry["latent_shift_dprime"] = number(d_prime(*ends[0], *ends[1]), len(takes))
    ends = [(truth.mean("latent", r), truth.spread("latent", r), truth.effective_size(r)) for r in (request, nothing)]
    entry["latent_shift_dprime_truth"] = number(d_prime(*ends[0], *ends[1]), ends[0][2])
    rating = truth.mean_rating(request)[np.isfinite(request)]
    entry["rating_truth"] = number(rating[0], truth.effective_size(request))
    return entry


def _sizes(truth, context):
    """What is behind each truth: the effective number of surfaces, and how far from the request they are on average.

    Ratings pooled over raters hardly reach 2: the surfaces nearest to such a request lie inside of it.
    """
    sizes, offsets = {}, {}
    for axis, value in _conditions(context)[1:]:
        request, name = _request((axis, value)), f"{axis} {value:+g}"
        size = truth.effective_size(request)
        sizes[name] = number(size, len(truth.ratings))
        offsets[name] = number(truth.mean_rating(request)[RATING_AXES.index(axis)] - value, size)
    return {
        "effective_surfaces": sizes,
        "rating_offset": offsets,
        "fewest_surfaces": number(LEAST_EFFECTIVE_SIZE),
        "largest_offset": number(KERNEL_WIDTH),
    }

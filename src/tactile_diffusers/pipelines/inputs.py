"""Checks of the arguments of a call, before any work starts."""

import math

import numpy as np
import torch
from diffusers.utils import logging

from ..models import RatingStatistics
from ..signal import coverage_distance
from ..signal.checks import check_number, check_whole_number
from ..signal.rating_scales import RATING_SCALE, from_percentile, from_raw

logger = logging.get_logger(__name__)

#: A hundred times the steps of training: more is a mistake (a rate, say), and would run for hours.
MOST_STEPS = 100_000
#: Guidance scale beyond which a warning is logged: levels leave what training surfaces had. Measured with the bundled
#: checkpoint and 24 random ratings: 3 moves levels by 2 dB on average, to 3 standard deviations from the training's
#: mean; 7.5 by 3.4 dB, to 3.8; 10 by 5 dB, to 4.7.
LARGEST_GUIDANCE = 3.0
#: A texture louder by so many standard deviations of the training's levels is in another unit: 24 times the mean RMS of
#: the bundled checkpoint's, where mN are a thousand times.
LOUDEST_DEVIATIONS = 5.0
#: Ratings beyond this many z-scores are taken for a mistake of scale (a 0-8 score, say).
LARGEST_RATING = 6.0
#: Longest texture of one call, s: all of it is in memory. An `EndlessStream` has no end.
LONGEST_SECONDS = 3600.0


# smallest and largest value, unit and remark, entries of DALE's `rating_statistics`, function of values and statistics
_SCALES = {
    "z": (-LARGEST_RATING, LARGEST_RATING, "z-scores", "most surfaces lie within -2 and 2", (), np.asarray),
    "raw": (*RATING_SCALE, "answers", "as the typical rater gives them", ("mean", "std"), from_raw),
    "percentile": (0.0, 100.0, "percentiles", "of the training surfaces' ratings", ("quantiles",), from_percentile),
}
#: Scales in which ratings may be given.
RATING_SCALES = tuple(_SCALES)


def _row(values, axes):
    """One texture's ratings as a list, in the order of the axes."""
    if isinstance(values, dict):
        unknown = sorted(str(name) for name in set(values) - set(axes))
        if unknown:
            raise ValueError(f"`ratings` has unknown axes {unknown}; the axes are {list(axes)}.")
        return [values.get(axis) for axis in axes]
    values = (
        list(values) if isinstance(values, list | tuple | np.ndarray | torch.Tensor) and np.ndim(values) else [values]
    )
    if len(values) != len(axes):
        raise ValueError(
            f"`ratings` must have {len(axes)} values per texture, in the order {list(axes)}, got {len(values)}: "
            f"{values}. Use NaN or None for an axis that is not specified, or a dict of axes."
        )
    return values


def parse_ratings(ratings, config, rating_scale="z"):
    """Ratings in any accepted form and scale as z-scores: a (batch, axes) float32 tensor, NaN = not specified.

    Args:
        ratings: `[r, b, s]`, `[[r, b, s], ...]`, `{"roughness": 1.2}`, `[dict, ...]`, array, tensor, table of pandas
            (columns named by axes, or three), or `None` (no axis specified).
        config: DALE's, with the axes in order (`rating_axes`) and the `rating_statistics` that "raw" (mean, std) and
            "percentile" (quantiles) need.
        rating_scale (`str`): `"z"`; `"raw"`, 0-8 of the typical rater; or `"percentile"`, 0-100 of the ratings of the
            training surfaces, where 0 and 100 are the smallest and the largest.

    Raises:
        ValueError: for an unknown scale or one whose statistics the checkpoint lacks, an empty batch, a wrong number of
            values, an unknown axis, or a value that is no number, infinite or outside the scale.
    """
    if rating_scale not in RATING_SCALES:
        raise ValueError(f"`rating_scale` must be one of {list(RATING_SCALES)}, got {rating_scale!r}.")
    low, high, unit, remark, names, to_z = _SCALES[rating_scale]
    statistics = _statistics(config, rating_scale, names)
    values = _as_array(ratings, config.rating_axes)
    for row, index in np.argwhere((values < low) | (values > high)):
        raise ValueError(
            f'`ratings` with `rating_scale="{rating_scale}"` are {unit} between {low:g} and {high:g} ({remark}), got '
            f"{config.rating_axes[index]} = {values[row, index]} in row {row}. The scales are {list(RATING_SCALES)}."
        )
    return torch.tensor(to_z(values, *statistics), dtype=torch.float32)


def warn_of_novel_ratings(ratings, config):
    """Logs a warning if ratings lie outside what the training surfaces covered, alone or together.

    Args:
        ratings (`torch.Tensor`): (batch, axes) z-scores, NaN = not specified.
        config: DALE's; against `rating_statistics` that are unknown nothing is checked.
    """
    found, statistics = [], RatingStatistics.from_config(config)
    for axis, values, (low, high) in zip(config.rating_axes, ratings.T, statistics.range or (), strict=False):
        beyond = torch.maximum(low - values, values - high).nan_to_num(-1.0)
        if beyond.max() > 0:
            farthest = values[beyond.argmax()].item()
            found.append(f"{axis} {farthest:+.2f} is held at the training surfaces' {low:+.2f} to {high:+.2f}")
    if not found and statistics.reach is not None:
        distances = coverage_distance(ratings.numpy(), statistics.centre, statistics.covariance)
        if np.nanmax(distances, initial=0.0) > statistics.reach:
            row = ratings[int(np.nanargmax(distances))].tolist()
            found.append(f"the combination {[round(value, 2) for value in row]} is extrapolated: no surface is near it")
    if found:
        logger.warning(f"`ratings` lie outside what training covered: {'; '.join(found)}.")


def _statistics(config, rating_scale, names):
    """Statistics of DALE's config as arrays; an error for what the checkpoint lacks."""
    if not names:
        return []
    statistics = RatingStatistics.from_config(config)
    found = {name: np.array(getattr(statistics, name), dtype=np.float64) for name in names}  # None becomes NaN
    missing = [name for name, values in found.items() if np.isnan(values).any()]
    if missing:
        raise ValueError(
            f'`rating_scale="{rating_scale}"` needs {missing} in the `rating_statistics` of `dale`, which the '
            'checkpoint lacks. Give z-scores (`rating_scale="z"`), or train DALE again with examples/train_dale.py.'
        )
    return list(found.values())


def _as_array(ratings, axes):
    """Ratings in any accepted form as a (batch, axes) float64 array, NaN = not specified."""
    if ratings is None:
        ratings = {}
    if hasattr(ratings, "to_dict") and hasattr(ratings, "to_numpy"):  # pandas, which need not be imported for that
        table = ratings.ndim == 2
        named = all(isinstance(label, str) for label in (ratings.columns if table else ratings.index))
        ratings = (ratings.to_dict("records") if table else ratings.to_dict()) if named else ratings.to_numpy()
    if isinstance(ratings, torch.Tensor | np.ndarray):
        if "complex" in str(ratings.dtype):  # a conversion would drop a part of it with no more than a warning
            raise ValueError(f"`ratings` must be real numbers, got {ratings.dtype}.")
    if isinstance(ratings, torch.Tensor):
        ratings = ratings.detach().float().cpu().numpy()
    if isinstance(ratings, dict):
        ratings = [ratings]
    if isinstance(ratings, np.ndarray):
        ratings = list(ratings) if ratings.ndim else []
    if not isinstance(ratings, list | tuple) or len(ratings) == 0:
        raise ValueError(f"`ratings` must hold at least one texture's {len(axes)} values, got {ratings!r}.")
    if not any(isinstance(row, dict | list | tuple | np.ndarray | torch.Tensor) for row in ratings):
        ratings = [ratings]
    rows = [_row(values, axes) for values in ratings]
    try:
        return np.array([[np.nan if value is None else float(value) for value in row] for row in rows], np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"`ratings` must be numbers, NaN or None, got {ratings!r}.") from error


def check_steps(name, value):
    """Steps as an int; raises a `ValueError` unless they are a whole number from 1 to `MOST_STEPS`."""
    return check_whole_number(name, value, at_most=MOST_STEPS)


def parse_guidance(guidance_scale, axes):
    """Guidance as `Guidance` takes it: a float, or a dict of indices of axes.

    Args:
        guidance_scale (`float` or `dict[str, float]`): for all axes, or of some.
        axes (`Sequence[str]`): their names.

    Raises:
        ValueError: for an unknown axis, or a scale that is no finite number of at least 0.
    """
    if not isinstance(guidance_scale, dict):
        return check_number("guidance_scale", guidance_scale, at_least=0)
    unknown = sorted(str(name) for name in set(guidance_scale) - set(axes))
    if unknown:
        raise ValueError(f"`guidance_scale` has unknown axes {unknown}; the axes are {list(axes)}.")
    for name, scale in guidance_scale.items():
        check_number(f"guidance_scale[{name!r}]", scale, at_least=0)
    return {list(axes).index(name): float(scale) for name, scale in guidance_scale.items()}


def warn_of_distilled_steps(name, steps, model, most):
    """Logs a warning that a model takes fewer steps than were asked for."""
    logger.warning(
        f"`{name}` {steps} is more than this {model} was distilled to: it takes {most}, and more would be worse. Leave "
        "the number out."
    )


def warn_of_other_units(level, config):
    """Logs a warning if a texture, of which `level` is the largest log RMS, is too loud to be in newtons.

    Args:
        level (`float`): natural log of the RMS in N.
        config: DALE's, which knows the levels of the training data.
    """
    if level > config.level_mean + LOUDEST_DEVIATIONS * config.level_std:
        times = math.exp(level - config.level_mean)
        logger.warning(
            f"`texture` has an RMS of {math.exp(level):.3g}, {times:.0f} times that of the training data. Give "
            "newtons, not mN or counts of a sensor."
        )


def warn_of_strong_guidance(guidance_scale):
    """Logs a warning if a scale, or the one of any axis, is larger than what the training data supports."""
    largest = max(guidance_scale.values(), default=1.0) if isinstance(guidance_scale, dict) else guidance_scale
    if largest > LARGEST_GUIDANCE:
        logger.warning(
            f"`guidance_scale` {largest:g} is beyond {LARGEST_GUIDANCE:g}: levels leave those of training surfaces. "
            "Use 1.25 to 2 to strengthen the effect of ratings; `guidance_rescale` keeps levels in range."
        )


def check_generator(generator, batch_size):
    """Returns `generator` (a tuple as a list) if it is `None`, one generator, or one for each texture.

    Raises:
        ValueError: if it is anything else.
    """
    if isinstance(generator, list | tuple):
        generator = list(generator)
        if len(generator) != batch_size:
            raise ValueError(
                f"`generator` must be one generator or a list of {batch_size}, one for each texture (ratings x "
                f"num_textures_per_rating), got {len(generator)}."
            )
    for entry in generator if isinstance(generator, list) else [generator]:
        if generator is not None and not isinstance(entry, torch.Generator):
            raise ValueError(f"`generator` must be a torch.Generator or a list of them, got {type(entry).__name__}.")
    return generator


def check_decoding(latents, level, friction_coefficient, channels, num_inference_steps, output_type, samples):
    """Raises a `ValueError` for impossible arguments of `decode`, where LCTG has `channels` latent channels."""
    check_steps("num_inference_steps", num_inference_steps)
    if samples is not None:
        check_whole_number("samples", samples)
    for name, value in (("latents", latents), ("level", level), ("friction_coefficient", friction_coefficient)):
        if not isinstance(value, torch.Tensor) and not (value is None and name == "friction_coefficient"):
            raise ValueError(f"`{name}` must be a torch.Tensor, got {type(value).__name__}.")
    if latents.ndim != 3 or latents.shape[1] != channels or 0 in latents.shape:
        raise ValueError(f"`latents` must be (batch, {channels}, frames), got {tuple(latents.shape)}.")
    for name, value in (("level", level), ("friction_coefficient", friction_coefficient)):
        if value is not None and tuple(value.shape) != (len(latents),):
            raise ValueError(f"`{name}` must be ({len(latents)},), one for each texture, got {tuple(value.shape)}.")
    for name, value in (("latents", latents), ("level", level)):
        if not torch.isfinite(value).all():
            raise ValueError(f"`{name}` must be finite, it holds NaN or infinity.")
    if output_type not in ("np", "pt"):
        raise ValueError(f'`output_type` must be "np" or "pt", got {output_type!r}.')


def check_callback(callback, names, allowed):
    """Raises a `ValueError` if a callback cannot be called, or asks for a tensor that it cannot have."""
    if callback is not None and not callable(callback):
        raise ValueError(f"`callback_on_step_end` must be callable, got {callback!r}.")
    if not isinstance(names, list | tuple) or any(name not in allowed for name in names):
        raise ValueError(
            f"`callback_on_step_end_tensor_inputs` must be a list of names among {allowed}, got {names!r} for "
            f"{type(callback).__name__}. To switch guidance off in a callback, set `pipe._guidance_scale = 1.0`."
        )


def check_noise(name, noise, shape):
    """Raises a `ValueError` unless `noise` is a tensor of finite real numbers of this shape."""
    if not isinstance(noise, torch.Tensor) or noise.is_complex():
        raise ValueError(f"`{name}` must be a torch.Tensor of reals, got {getattr(noise, 'dtype', type(noise))}.")
    if tuple(noise.shape) != tuple(shape):
        raise ValueError(f"`{name}` must have the shape {tuple(shape)}, got {tuple(noise.shape)}.")
    if not torch.isfinite(noise).all():
        raise ValueError(f"`{name}` must be finite, it holds NaN or infinity.")

"""Checks of what a caller gives, before any work starts."""

import numpy as np
import torch

#: ratings beyond this many z-scores are taken for a mistake of scale (a 0-8 score, say)
LARGEST_RATING = 6.0


def _row_from_mapping(mapping, axes):
    unknown = sorted(set(mapping) - set(axes))
    if unknown:
        raise ValueError(f"`ratings` has unknown axes {unknown}; the axes are {list(axes)}.")
    return [mapping.get(axis) for axis in axes]


def _row_from_values(row, axes):
    values = [row] if np.ndim(row) == 0 else list(row)
    if len(values) != len(axes):
        raise ValueError(
            f"`ratings` must have {len(axes)} values per texture, in the order {list(axes)}, got {len(values)}: "
            f"{values}. Use NaN or None for an axis that is not specified, or a dict of axes."
        )
    return values


def parse_ratings(ratings, axes):
    """Ratings in any accepted form as a (batch, axes) float32 tensor, NaN = not specified.

    Args:
        ratings: `[r, b, s]`, `[[r, b, s], ...]`, `{"roughness": 1.2}`, `[dict, ...]`, array or tensor, or `None` (no
            axis specified).
        axes (`list[str]`): names of the axes in order.

    Raises:
        ValueError: for an empty batch, a wrong number of values, an unknown axis, or a value that is no number,
            infinite or beyond 6 z-scores.
    """
    if ratings is None:
        ratings = {}
    if isinstance(ratings, torch.Tensor):
        ratings = ratings.detach().cpu().numpy()
    if isinstance(ratings, dict) or (np.ndim(ratings) == 1 and len(ratings) and not isinstance(ratings[0], dict)):
        ratings = [ratings]
    if np.ndim(ratings) == 0 or len(ratings) == 0:
        raise ValueError(f"`ratings` must hold at least one texture's {len(axes)} values, got {ratings!r}.")
    rows = [_row_from_mapping(row, axes) if isinstance(row, dict) else _row_from_values(row, axes) for row in ratings]
    try:
        values = np.array([[np.nan if value is None else value for value in row] for row in rows], dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"`ratings` must be numbers (z-scores), NaN or None, got {ratings!r}.") from error
    for index, row in enumerate(values):
        for axis, value in zip(axes, row, strict=True):
            if np.isinf(value) or abs(value) > LARGEST_RATING:
                raise ValueError(
                    f"`ratings` are z-scores between -{LARGEST_RATING:g} and {LARGEST_RATING:g} (most surfaces lie "
                    f"within -2 and 2), got {axis} = {value} in row {index}."
                )
    return torch.tensor(values, dtype=torch.float32)


def check_positive_integer(name, value):
    """Raises a `ValueError` unless `value` is a whole number >= 1."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 1:
        raise ValueError(f"`{name}` must be a whole number >= 1, got {value!r}.")


def check_generator(generator, batch_size):
    """Raises a `ValueError` unless `generator` is `None`, one generator, or one for each texture."""
    if isinstance(generator, list | tuple) and len(generator) != batch_size:
        raise ValueError(
            f"`generator` must be one generator or a list of {batch_size}, one for each texture (ratings x "
            f"num_textures_per_rating), got {len(generator)}."
        )
    entries = generator if isinstance(generator, list | tuple) else [generator]
    for entry in entries:
        if entry is not None and not isinstance(entry, torch.Generator):
            raise ValueError(f"`generator` must be a torch.Generator or a list of them, got {type(entry).__name__}.")

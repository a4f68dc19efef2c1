"""Checks of what a caller gives, before any work starts."""

import json
from pathlib import Path

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
    values = list(row) if isinstance(row, list | tuple | np.ndarray | torch.Tensor) and np.ndim(row) else [row]
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
        ratings = ratings.detach().float().cpu().numpy()
    if isinstance(ratings, dict):
        ratings = [ratings]
    if isinstance(ratings, np.ndarray):
        ratings = list(ratings) if ratings.ndim else []
    if not isinstance(ratings, list | tuple) or len(ratings) == 0:
        raise ValueError(f"`ratings` must hold at least one texture's {len(axes)} values, got {ratings!r}.")
    if not any(isinstance(row, dict | list | tuple | np.ndarray | torch.Tensor) for row in ratings):
        ratings = [ratings]
    rows = [_row_from_mapping(row, axes) if isinstance(row, dict) else _row_from_values(row, axes) for row in ratings]
    try:
        values = np.array(
            [[np.nan if value is None else float(value) for value in row] for row in rows], dtype=np.float64
        )
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


def check_number(name, value, low, low_allowed, meaning):
    """Raises a `ValueError` unless `value` is a finite number above `low` (or at it, if `low_allowed`)."""
    number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
    if not number or not np.isfinite(value) or value < low or (value == low and not low_allowed):
        raise ValueError(
            f"`{name}` must be a finite number {'>=' if low_allowed else '>'} {low}{meaning}, got {value!r}."
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
        if entry is not None and not isinstance(entry, torch.Generator):
            raise ValueError(f"`generator` must be a torch.Generator or a list of them, got {type(entry).__name__}.")
    return generator


def check_components(lctg, feature_extractor, dale):
    """Raises a `ValueError` naming the component that does not fit the others."""
    theirs = "they belong to different checkpoints."
    if lctg.config.feature_channels != feature_extractor.feature_size:
        raise ValueError(
            f"`lctg` hears {lctg.config.feature_channels} feature channels, `feature_extractor` makes "
            f"{feature_extractor.feature_size}: {theirs}"
        )
    hop, multiple = feature_extractor.hop_length, feature_extractor.hop_length * feature_extractor.frame_multiple
    if lctg.config.feature_hop != hop or multiple % lctg.config.latent_hop:
        raise ValueError(
            f"`feature_extractor` makes frames of {hop} samples, {feature_extractor.frame_multiple} at a time, `lctg` "
            f"hears frames of {lctg.config.feature_hop} and makes latents of {lctg.config.latent_hop}: {theirs}"
        )
    if dale is not None and dale.latent_channels != lctg.config.latent_channels:
        raise ValueError(
            f"`dale` makes {dale.latent_channels} latent channels, `lctg` reads {lctg.config.latent_channels}: {theirs}"
        )


def check_folder(folder, given):
    """Raises an `OSError` if a local checkpoint folder lacks a component that is not `given` by keyword."""
    folder = Path(folder)
    if not (folder / "model_index.json").is_file():
        return  # a name on the Hub, or a folder that the loader itself refuses
    index = json.loads((folder / "model_index.json").read_text())
    components = [name for name, entry in index.items() if isinstance(entry, list) and entry[0] is not None]
    missing = [name for name in components if name not in given and not (folder / name).is_dir()]
    if missing:
        raise OSError(f"The checkpoint {folder} lacks the folder(s) of {missing}: copy it again as a whole.")

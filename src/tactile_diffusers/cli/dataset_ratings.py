"""The ratings of many textures: read from a file, or drawn from the distribution that a checkpoint was trained on."""

import csv
import json
from pathlib import Path

import numpy as np
from scipy.special import ndtr

from ..io.reading import reading
from ..models import RatingStatistics
from ..pipelines.inputs import parse_ratings
from ..signal import coverage_distance
from ..signal.rating_scales import from_percentile

SUFFIXES = (".csv", ".json", ".npy")
#: ratings drawn at once; a constant, so that the first ratings are the same for any number of textures
BLOCK = 1024
#: what the draw needs of DALE's config
STATISTICS = ("quantiles", "centre", "covariance", "reach")


def read_ratings_file(path, config, count):
    """Ratings of `count` textures from the rows of a file, used in turn: texture i has row i modulo the rows.

    A .csv has a header with names of axes; an axis without a column, or an empty cell, is not specified. A .json is a
    list of rows in any form that the pipeline takes, null = not specified. A .npy is an array (rows, axes), NaN = not
    specified.

    Args:
        path (`Path`).
        config: DALE's, with `rating_axes`.
        count (`int`): textures.

    Returns:
        `np.ndarray`: (count, axes) float32 z-scores.

    Raises:
        ValueError: if the file cannot be read as ratings, or has more rows than `count`, which would be left out.
        FileNotFoundError: if there is no file.
    """
    path = Path(path)
    if path.suffix not in SUFFIXES:
        raise ValueError(f"--ratings_file {path} must end in one of {', '.join(SUFFIXES)}.")
    with reading(f"--ratings_file {path}", "ratings", "Correct it, or write it again."):
        rows = {".csv": _read_csv, ".json": _read_json, ".npy": _read_npy}[path.suffix](path, config.rating_axes)
        rows = parse_ratings(rows, config).numpy()
    if len(rows) > count:
        raise ValueError(
            f"--ratings_file {path} has {len(rows)} rows, more than --num_textures {count}: give --num_textures "
            f"{len(rows)} or a multiple of it, or a shorter file."
        )
    return rows[np.arange(count) % len(rows)]


def _read_csv(path, axes):
    with open(path, newline="", encoding="utf-8-sig") as file:
        reader = csv.DictReader(file)
        names = [name.strip() for name in reader.fieldnames or []]
        if not names or len(set(names)) < len(names) or not set(names) <= set(axes):
            raise ValueError(f"the first line must name columns, each one of {list(axes)}, got {names}.")
        reader.fieldnames = names
        rows = []
        for row in reader:
            if None in row or None in row.values():
                raise ValueError(f"line {reader.line_num} does not have {len(names)} cells.")
            rows.append({axis: _number(text, axis, reader.line_num) for axis, text in row.items()})
    return rows


def _number(text, axis, line):
    try:
        return float(text) if text.strip() else None
    except ValueError as error:
        raise ValueError(f"line {line}, column {axis}: {text!r} is no number.") from error


def _read_json(path, axes):
    return json.loads(path.read_text(encoding="utf-8-sig"))


def _read_npy(path, axes):
    # mapped: a header may claim any number of rows
    return np.array(np.load(path, mmap_mode="r", allow_pickle=False))


def draw_ratings(config, count, seed):
    """Ratings as the training surfaces have them: each axis distributed as theirs, and correlated as theirs.

    A Gaussian copula: correlated normal numbers become shares, and shares become ratings by the quantiles. Draws
    farther from the centre than any training surface was are left out.

    Args:
        config: DALE's.
        count (`int`): textures.
        seed (`int`): the n-th ratings depend on it and n alone.

    Returns:
        `np.ndarray`: (count, axes) float32 z-scores.

    Raises:
        ValueError: if the checkpoint does not store the distribution.
    """
    statistics = RatingStatistics.from_config(config)
    missing = [name for name in STATISTICS if getattr(statistics, name) is None]
    if missing:
        raise ValueError(
            f"This checkpoint does not say how the ratings of its training surfaces are distributed ({missing} missing "
            "in the `rating_statistics` of `dale`). Give --ratings_file, or train DALE again with "
            "examples/train_dale.py on at least six rated surfaces."
        )
    covariance = np.array(statistics.covariance)
    spread = np.sqrt(np.diag(covariance))
    mixing = np.linalg.cholesky(covariance / np.outer(spread, spread))
    generator = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(1,)))
    kept, total = [], 0
    while total < count:
        normal = generator.standard_normal((BLOCK, len(spread))) @ mixing.T
        ratings = from_percentile(100 * ndtr(normal), statistics.quantiles).astype(np.float32)
        inside = coverage_distance(ratings, statistics.centre, covariance) <= statistics.reach
        kept.append(ratings[inside])
        total += len(kept[-1])
    return np.concatenate(kept)[:count]

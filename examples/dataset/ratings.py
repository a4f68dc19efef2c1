"""The ratings of many textures: read from a file, or drawn from the distribution that a checkpoint was trained on."""

import csv
import json
from pathlib import Path

import numpy as np
from scipy.special import ndtr

from tactile_diffusers.io.reading import reading
from tactile_diffusers.models import RatingStatistics
from tactile_diffusers.pipelines.inputs import parse_ratings
from tactile_diffusers.signal import coverage_distance
from tactile_diffusers.signal.rating_scales import from_percentile

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
    readers = {".csv": _read_csv, ".json": _read_json, ".npy": _read_npy}
    if path.suffix not in readers:
        raise ValueError(f"--ratings_file {path} must end in one of {', '.join(readers)}.")
    with reading(f"--ratings_file {path}", "ratings", "Correct it, or write it again."):
        rows = parse_ratings(readers[path.suffix](path), config).numpy()
    if len(rows) > count:
        raise ValueError(
            f"--ratings_file {path} has {len(rows)} rows, more than --num_textures {count}: give --num_textures "
            f"{len(rows)} or a multiple of it, or a shorter file."
        )
    return rows[np.arange(count) % len(rows)]


def _read_csv(path):
    """Rows as dicts of axes; a row that lacks cells is refused: the file may have been cut off."""
    with open(path, newline="", encoding="utf-8-sig") as file:
        names, *rows = [row for row in csv.reader(file, skipinitialspace=True) if row] or [[]]
    if not names or len(set(names)) < len(names):
        raise ValueError(f"the first line must name columns, got {names}")
    for number, row in enumerate(rows, start=1):
        if len(row) != len(names):
            raise ValueError(f"row {number} has {len(row)} cells, not {len(names)}")
    return [
        {name.strip(): float(cell) if cell.strip() else None for name, cell in zip(names, row, strict=True)}
        for row in rows
    ]


def _read_json(path):
    return json.loads(path.read_text(encoding="utf-8-sig"))


def _read_npy(path):
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

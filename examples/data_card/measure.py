"""The numbers of a data card: recordings, the time that preparation kept, surfaces, and how far ratings fit them."""

import math
import warnings
from pathlib import Path

import numpy as np
import pandas
from scipy.stats import spearmanr
from tqdm import tqdm

from tactile_diffusers.data.dataset import PreparedDataset
from tactile_diffusers.data.folder.convert import REPORT_ATTRIBUTE
from tactile_diffusers.data.ratings import LEAST_COMMON, axis_correlation, rating_reliability
from tactile_diffusers.data.recordings import RecordingsFile
from tactile_diffusers.data.segments import SegmentLimits
from tactile_diffusers.data.splits import SPLITS
from tactile_diffusers.signal import RATING_AXES, band_edges, band_levels_db
from tactile_diffusers.signal.rating_scales import RATING_SCALE

from .advice import KEPT, warnings_of

CARD_FORMAT = "tactile-data-card"
CARD_VERSION = 2
#: Lengths of a recording (s) that differ by more are of different ones: less than a sample, more than rounding.
SAME_SECONDS = 1e-5
#: Speed and normal force are sampled so often (Hz) for their quantiles over time.
CONDITIONS_RATE = 50
QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
#: So many segments of all surfaces together make the band levels, but at least so many of each surface.
SPECTRUM_SEGMENTS, LEAST_PER_SURFACE = 400, 2
#: dB per unit of level, which is a natural logarithm of the RMS.
DB_PER_LEVEL = 20 / math.log(10)
#: Fewer surfaces than this say nothing about a relation.
LEAST_SURFACES = 8


def describe(recordings, prepared, quiet=False):
    """The numbers of a card.

    Args:
        recordings (`str` or `Path`): `recordings.h5`.
        prepared (`str` or `Path`): the data set prepared from it.
        quiet (`bool`): no progress bar.

    Returns:
        `dict`: of plain Python values; NaN is None.

    Raises:
        ValueError: if a file is invalid, or `prepared` does not belong to `recordings`.
    """
    data = PreparedDataset(prepared, "all")
    with RecordingsFile(recordings) as source:
        _check_same(source, data)
        facts, conditions = _source(source, SegmentLimits(**data.attributes["limits"]), quiet)
        scores, names = source.ratings, source.surfaces
    kept, times = _selection(data)
    rows, bands = _surfaces(data)
    ratings = None
    if scores is not None:
        pooled = data.ratings.mean
        std = pandas.DataFrame(pooled).std(ddof=0)
        ratings = {
            "answers": describe_answers(scores, names),
            "pooled": {"std": dict(zip(RATING_AXES, std, strict=True)), "correlation": axis_correlation(pooled)},
            "relation": relate(pooled, _measured_quantities(rows, bands["edges"])),
        }
    card = {
        "format": CARD_FORMAT,
        "version": CARD_VERSION,
        "recordings": facts,
        "preparation": _preparation(data),
        "kept": kept,
        "conditions": conditions,
        "surfaces": [row | times[row["name"]] for row in rows],
        "bands": bands,
        "ratings": ratings,
    }
    card = _plain(card)
    return card | {"warnings": warnings_of(card)}


def _check_same(source, data):
    """Raises a `ValueError` unless a data set was prepared from these recordings."""
    differing = [f"recording {name}" for name in sorted(set(data.recordings) ^ set(source.names))]
    if not differing:
        prepared = data.seconds_by_reason().sum(axis=1)
        lasts = {name: length / source.rate(name) for name, length in zip(source.names, source.lengths, strict=True)}
        differing = [f"the length of {name}" for name in lasts if abs(prepared[name] - lasts[name]) > SAME_SECONDS]
    if str(source.attributes.get("source")) != data.source:
        differing.append(f"source {data.source!r} against {str(source.attributes.get('source'))!r}")
    if differing:
        raise ValueError(
            f"{data.path} was not prepared from {source.path}: they differ in {differing[0]}. Prepare these "
            "recordings with examples/prepare_data.py, or leave out --prepared."
        )


def _source(source, limits, quiet):
    """What the file holds, and how long speed and normal force were what; reads one recording after the other."""
    rows, samples = [], {"normal_force": [], "speed": []}
    for one in tqdm(source, total=len(source), desc="recordings", unit="recording", disable=quiet):
        channel = "lateral" if one.force is None else "force"
        row = {"explorer": one.explorer, "seconds": one.samples / one.rate, "channel": channel, "rate": f"{one.rate:g}"}
        if one.force is not None:
            samples["normal_force"].append(_sampled(one.explorer, np.abs(one.force[:, 2]), one.rate))
        if one.velocity is not None:
            samples["speed"].append(_sampled(one.explorer, np.hypot(*one.velocity.T), one.velocity_rate))
            row["velocity"] = f"{one.velocity_rate:g}"
        rows.append(row)
    table = pandas.DataFrame(rows, columns=["explorer", "seconds", "channel", "rate", "velocity"])
    channels = table["channel"].value_counts().to_dict()
    if velocities := table["velocity"].value_counts().to_dict():
        channels["velocity"] = sum(velocities.values())
    facts = {
        "file": Path(source.path).name,
        "bytes": Path(source.path).stat().st_size,
        "unit": source.unit,
        "surfaces": len(source.surfaces),
        "explorers": sorted(set(table["explorer"])),
        "recordings": len(source),
        "seconds": table["seconds"].sum(),
        "channels": channels,
        "rates": table["rate"].value_counts().to_dict(),
        "velocity_rates": velocities,
        "attributes": {k: v for k, v in source.attributes.items() if k not in ("format", "version", REPORT_ATTRIBUTE)},
        "conversion": source.attributes.get(REPORT_ATTRIBUTE),
    }
    return facts, {name: _over_time(found, getattr(limits, name)) for name, found in samples.items()}


def _sampled(explorer, values, rate):
    """A channel at `CONDITIONS_RATE`, so that every sample of every recording stands for the same time."""
    places = np.arange(0, len(values), max(1, rate / CONDITIONS_RATE)).astype(np.int64)
    return pandas.DataFrame({"explorer": explorer, "value": values[places]})


def _over_time(samples, bounds):
    """Quantiles over time of one quantity and the share of the time inside its limits, by explorer."""
    table = pandas.concat(samples).dropna() if samples else ()
    if not len(table):
        return None

    def summary(part):
        share = None if bounds is None else part.between(*bounds).mean()
        return {"quantiles": part.quantile(QUANTILES).to_numpy(), "share_inside": share}

    groups = {"all": table["value"], **dict(iter(table.groupby("explorer")["value"]))}
    return {"limits": bounds, "explorers": {name: summary(part) for name, part in groups.items()}}


def _selection(data):
    """Seconds by reason in the filtered subset: of all and of each explorer; and what was kept of each surface."""
    table = data.seconds_by_reason()
    by_surface, by_explorer = (table.groupby([n.split("/")[place] for n in table.index]).sum() for place in (0, 1))
    mostly, total = by_surface.drop(columns=KEPT).idxmax(axis=1), table.sum()
    surfaces = {
        name: {"seconds": row.sum(), "kept_seconds": row[KEPT], "mostly_dropped": mostly[name]}
        for name, row in by_surface.iterrows()
    }
    shares = {"kept_share": total[KEPT] / total.sum(), "explorers": by_explorer.to_dict("index")}
    return {"seconds": total.to_dict(), **shares}, surfaces


def _preparation(data):
    """Settings and notes of the preparation, and the surfaces and segments of each split."""
    names = ("limits", "band", "turnarounds", "split_seed", "hold_out")
    splits = np.array(data.splits)
    counts = {
        split: {"surfaces": np.sum(splits == split), "segments": np.sum(splits[data.surface_ids] == split)}
        for split in SPLITS
        if split != "hard"
    }
    if data.attributes["hold_out"]:  # segments of the hard split are in no other
        hard = PreparedDataset(data.path, "hard")
        counts["hard"] = {"surfaces": len(np.unique(hard.surface_ids)), "segments": len(hard)}
    lines = data.attributes["report"].splitlines()
    return {name: data.attributes[name] for name in names} | {
        "sampling_rate": data.sampling_rate,
        "segment_samples": data.segment_samples,
        "segments": counts,
        "notes": [line.removeprefix("note: ") for line in lines if line.startswith("note: ")],
    }


def _surfaces(data):
    """Counts, levels, friction, ratings and band levels of each surface; and facts about bands and turnarounds."""
    chosen = data.non_overlapping(max(LEAST_PER_SURFACE, SPECTRUM_SEGMENTS // len(data.surfaces)))
    edges = band_edges(band=data.band)
    explorers = np.array([name.split("/")[1] for name in data.recordings])[data.recording_ids]
    levels = DB_PER_LEVEL * data.levels.astype(np.float64)
    friction = data.friction_coefficients.astype(np.float64)
    table = pandas.DataFrame({"explorer": explorers, "level_db": levels, "friction": friction})
    rows = []
    for number, name in enumerate(data.surfaces):
        mine = table[data.surface_ids == number]
        by_explorer = mine.groupby("explorer")
        row = {"name": name, "split": data.splits[number], "segments": len(mine)}
        row["explorers"] = by_explorer.size().to_dict()
        for key in ("level_db", "friction"):
            row[key], row[f"{key}_std"] = mine[key].mean(), mine[key].std(ddof=0)
            row[f"{key}_explorers"] = by_explorer[key].mean().to_dict()
        row["ratings"] = dict(zip(RATING_AXES, data.ratings.mean[number], strict=True))
        textures = data.textures(chosen[data.surface_ids[chosen] == number])
        if len(textures):
            row["bands_db"] = band_levels_db(textures, data.sampling_rate, edges).mean(axis=0)
        rows.append(row)
    turning = data.segments.turnarounds > 0
    raised = DB_PER_LEVEL * (data.levels - data.segments.level_between_turnarounds)[turning]
    return rows, {
        "edges": edges,
        "segments": len(chosen),
        "turnaround_share": turning.mean(),
        "turnaround_db": np.median(raised) if len(raised) else None,
    }


def describe_answers(scores, surfaces):
    """Raw answers on every axis of `RaterScores`, and how far the raters agree; `surfaces` are the recordings'."""
    reliability = rating_reliability(scores, scores.axes)
    rated = ~np.isnan(scores.values).all(axis=(0, 2))
    low, high = RATING_SCALE
    axes = {}
    for number, axis in enumerate(scores.axes):
        answers = pandas.DataFrame(scores.values[:, rated, number].T, columns=list(scores.raters))
        known, per_surface = answers.stack().dropna(), answers.count(axis=1)
        axes[axis] = {
            "counts": np.histogram(known, np.arange(low, high + 2) - 0.5)[0],
            "mean": known.mean(),
            "std": known.std(ddof=0),
            "missing_share": 1 - per_surface.sum() / max(1, answers.size),
            "low_end_share": (known == low).mean(),
            "high_end_share": (known == high).mean(),
            "fewest_raters": per_surface.min() if len(per_surface) else 0,
            "most_raters": per_surface.max() if len(per_surface) else 0,
            "mean_correlation": reliability.mean_correlation[number],
            "alpha": reliability.alpha[number],
            "raters": reliability.raters[number],
            "with_others": _with_others(answers),
        }
    named = {surface for surface, known in zip(scores.surfaces, rated, strict=True) if known}
    return {
        "raters": len(scores.raters),
        "surfaces_rated": len(named),
        "surfaces_unrated": [surface for surface in surfaces if surface not in named],
        "axes": axes,
    }


def _with_others(answers):
    """Each rater's correlation with the mean z-score of the others, over the surfaces that both know."""
    z = (answers - answers.mean()) / answers.std(ddof=0).replace(0, np.nan)
    return {
        rater: z[rater].corr(z.drop(columns=rater).mean(axis=1), min_periods=LEAST_COMMON) if len(z) else np.nan
        for rater in z
    }


def _measured_quantities(rows, edges):
    """Level, friction coefficient, and the nine bands relative to their mean: name -> (surfaces,), NaN = unknown."""
    bands = np.array([row.get("bands_db", np.full(len(edges) - 1, np.nan)) for row in rows])
    shape = bands - bands.mean(axis=1, keepdims=True)
    names = [f"{low:.0f}–{high:.0f} Hz" for low, high in zip(edges[:-1], edges[1:], strict=True)]
    quantities = {"level": "level_db", "friction coefficient": "friction"}
    quantities = {name: np.array([row[key] for row in rows]) for name, key in quantities.items()}
    return quantities | dict(zip(names, shape.T, strict=True))


def relate(mean, quantities):
    """Spearman correlations over surfaces between ratings and measured quantities.

    Args:
        mean (`np.ndarray`): (surfaces, 3) pooled ratings; NaN = not rated.
        quantities (`dict[str, np.ndarray]`): name -> (surfaces,); NaN = unknown.

    Returns:
        `dict` or `None`: "surfaces" that are compared, "spearman" (quantity -> axis -> rho), the "largest" in size, and
        "unrelated", the probability that chance alone gives as large a one (at most: Bonferroni). None with fewer than
        8 surfaces.
    """
    quantities = {name: values for name, values in quantities.items() if not np.isnan(values).all()}
    table = np.column_stack([mean, *quantities.values()])
    table = table[~np.isnan(table).any(axis=1)]
    if len(table) < LEAST_SURFACES or not quantities:
        return None
    with warnings.catch_warnings(action="ignore"):  # of a quantity that is the same everywhere: NaN
        found = spearmanr(table)
    axes = mean.shape[1]
    rho, chance = found.statistic[axes:, :axes], found.pvalue[axes:, :axes]
    return {
        "surfaces": len(table),
        "spearman": {name: dict(zip(RATING_AXES, row, strict=True)) for name, row in zip(quantities, rho, strict=True)},
        "largest": np.nanmax(np.abs(rho), initial=0),
        "unrelated": min(1.0, chance.size * np.nanmin(chance, initial=1)),
    }


def _plain(value):
    """Numbers and arrays as Python values of six significant digits; NaN and infinity become None."""
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, bytes):  # a string of fixed length
        return value.decode("utf-8", "replace")
    if isinstance(value, float):
        return float(f"{value:.6g}") if math.isfinite(value) else None
    return value

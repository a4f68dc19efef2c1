"""What a data card measures: the recordings, the time that preparation kept, and each surface's segments."""

import json
import math
from collections import Counter
from pathlib import Path

import numpy as np
import pandas
from tqdm import tqdm

from ...io.reading import reading
from ...signal import RATING_AXES, band_edges, band_levels_db
from ..folder.conversion_report import REPORT_ATTRIBUTE, notes_in_words

#: Reason of the time that segments are cut from; all others are reasons why time was dropped.
KEPT = "used"
#: Lengths of a recording (s) that differ by more are of different ones: less than a sample, more than rounding.
SAME_SECONDS = 1e-5
#: So many samples of all recordings together, evenly spread, give the quantiles of speed and normal force.
QUANTILE_SAMPLES = 400_000
QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
#: So many segments of all surfaces together make the band levels, but at least so many of each surface.
SPECTRUM_SEGMENTS, LEAST_PER_SURFACE = 400, 2
#: dB per unit of level, which is a natural logarithm of the RMS.
DB_PER_LEVEL = 20 / math.log(10)


def check_same(source, data):
    """Checks that a data set was prepared from these recordings.

    Args:
        source (`RecordingsFile`): open.
        data (`PreparedDataset`): any view.

    Raises:
        ValueError: naming both files and the first difference.
    """
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


def describe_source(source, limits, quiet=False):
    """Reads every recording once, one at a time.

    Args:
        source (`RecordingsFile`): open.
        limits (`SegmentLimits`): of the segments; their bounds are compared with all of the time.
        quiet (`bool`): no progress bar.

    Returns:
        `tuple[dict, dict]`: the content of the file (source, licence, unit, names, counts, rates, seconds), and for
        "normal_force" (N) and "speed" (mm/s) the `QUANTILES` over time of each explorer and of "all", with the share
        inside the limits; None without the channel.

    Raises:
        ValueError: if the stored report of a conversion is damaged.
    """
    with reading(source.path, f"a store of recordings with the attribute {REPORT_ATTRIBUTE!r}", "Convert it again."):
        conversion = json.loads(source.attributes.get(REPORT_ATTRIBUTE, "null"))
        if conversion is not None:
            notes_in_words(conversion)
    counts = {name: Counter() for name in ("channels", "rates", "velocity_rates")}
    seconds, samples = Counter(), {"normal_force": [], "speed": []}
    count = max(100, QUANTILE_SAMPLES // len(source))
    for recording in tqdm(source, total=len(source), desc="recordings", unit="recording", disable=quiet):
        seconds[recording.explorer] += recording.samples / recording.rate
        counts["channels"]["lateral" if recording.force is None else "force"] += 1
        counts["rates"][f"{recording.rate:g}"] += 1
        if recording.force is not None:
            samples["normal_force"].append(_sample(recording, np.abs(recording.force[:, 2]), count))
        if recording.velocity is not None:
            counts["channels"]["velocity"] += 1
            counts["velocity_rates"][f"{recording.velocity_rate:g}"] += 1
            samples["speed"].append(_sample(recording, np.hypot(*recording.velocity.T), count))
    facts = {
        "file": Path(source.path).name,
        "bytes": Path(source.path).stat().st_size,
        "unit": source.unit,
        "surfaces": len(source.surfaces),
        "explorers": sorted(seconds),
        "recordings": len(source),
        "seconds": sum(seconds.values()),
        "seconds_per_explorer": dict(sorted(seconds.items())),
        **{name: dict(counter) for name, counter in counts.items()},
        "attributes": {k: v for k, v in source.attributes.items() if k not in ("format", "version", REPORT_ATTRIBUTE)},
        "conversion": conversion,
    }
    return facts, {name: _quantiles(found, getattr(limits, name)) for name, found in samples.items()}


def _sample(recording, values, count):
    """Evenly spread samples of one channel, each with the seconds that it stands for."""
    known = values[~np.isnan(values)]
    chosen = known[:: max(1, len(known) // count)]
    lasts = recording.samples / recording.rate * len(known) / len(values)
    return pandas.DataFrame({"explorer": recording.explorer, "value": chosen, "seconds": lasts / max(1, len(chosen))})


def _quantiles(samples, bounds):
    table = pandas.concat(samples) if samples else pandas.DataFrame()
    if table.empty:
        return None
    table = table.sort_values("value", kind="stable")
    groups = {"all": table, **dict(iter(table.groupby("explorer", sort=True)))}
    return {"limits": bounds, "explorers": {name: _time_quantiles(part, bounds) for name, part in groups.items()}}


def _time_quantiles(part, bounds):
    share = part["seconds"].cumsum() / part["seconds"].sum()
    places = np.minimum(np.searchsorted(share, QUANTILES), len(part) - 1)
    inside = part["value"].between(*bounds) if bounds is not None else None
    return {
        "quantiles": part["value"].to_numpy()[places],
        "share_inside": None if bounds is None else part["seconds"][inside].sum() / part["seconds"].sum(),
    }


def describe_selection(data):
    """Seconds kept and dropped, by reason, in the filtered subset.

    Args:
        data (`PreparedDataset`): any view.

    Returns:
        `tuple[dict, dict]`: "reasons" in the order in which they apply, "seconds" of each, the same per explorer, and
        the share kept; and for each surface its seconds, those kept, and the reason of most of the rest.
    """
    table = data.seconds_by_reason()
    by_surface, by_explorer = (table.groupby([n.split("/")[place] for n in table.index]).sum() for place in (0, 1))
    mostly = by_surface.drop(columns=KEPT).idxmax(axis=1)
    surfaces = {
        name: {"seconds": row.sum(), "kept_seconds": row[KEPT], "mostly_dropped": mostly[name]}
        for name, row in by_surface.iterrows()
    }
    total = table.sum()
    selection = {
        "reasons": list(table),
        "seconds": total.to_dict(),
        "kept_share": total[KEPT] / total.sum(),
        "explorers": by_explorer.to_dict("index"),
    }
    return selection, surfaces


def describe_surfaces(data):
    """Counts, levels, friction coefficients, ratings and band levels of each surface.

    Args:
        data (`PreparedDataset`): every split, the filtered subset, the native rate.

    Returns:
        `tuple[list[dict], dict]`: one entry per surface of the file, NaN where it has no segment; and the "edges" of
        the bands, how many "segments" they are measured from, the share of segments that hold a turnaround, and by how
        many dB it raises them in the median.
    """
    chosen = data.non_overlapping(max(LEAST_PER_SURFACE, SPECTRUM_SEGMENTS // len(data.surfaces)))
    edges = band_edges(band=data.band)
    explorers = np.array([name.split("/")[1] for name in data.recordings])[data.recording_ids]
    levels = DB_PER_LEVEL * data.levels.astype(np.float64)
    table = pandas.DataFrame(
        {"explorer": explorers, "level_db": levels, "friction": data.friction_coefficients.astype(np.float64)}
    )
    rows = []
    for number, name in enumerate(data.surfaces):
        mine = table[data.surface_ids == number]
        by_explorer = mine.groupby("explorer")
        row = {"name": name, "split": data.splits[number], "segments": len(mine)}
        row["explorers"] = by_explorer.size().to_dict()
        for key in ("level_db", "friction"):
            row[key], row[f"{key}_std"] = mine[key].mean(), mine[key].std(ddof=0)
            row[f"{key}_explorers"] = by_explorer[key].mean().to_dict()
        for key, pooled in (("ratings", data.ratings.mean), ("raters", data.ratings.count)):
            row[key] = dict(zip(RATING_AXES, pooled[number], strict=True))
        textures = data.textures(chosen[data.surface_ids[chosen] == number])
        if len(textures):
            row["bands_db"] = band_levels_db(textures, data.sampling_rate, edges).mean(axis=0)
        rows.append(row)
    turning = data.segments.turnarounds > 0
    raised = DB_PER_LEVEL * (data.levels - data.segments.level_between_turnarounds)[turning]
    return rows, {
        "edges": edges,
        "segments": len(chosen),
        "turnaround_share": float(turning.mean()),
        "turnaround_db": np.median(raised) if len(raised) else None,
    }


def measured_quantities(rows, edges):
    """What ratings are compared with: level, friction coefficient, and the nine bands relative to their mean.

    Returns:
        `dict[str, np.ndarray]`: name -> (surfaces,), NaN = unknown.
    """
    bands = np.array([row.get("bands_db", np.full(len(edges) - 1, np.nan)) for row in rows])
    shape = bands - bands.mean(axis=1, keepdims=True)
    quantities = {"level": "level_db", "friction coefficient": "friction"}
    quantities = {name: np.array([row[key] for row in rows]) for name, key in quantities.items()}
    names = [f"{low:.0f}–{high:.0f} Hz" for low, high in zip(edges[:-1], edges[1:], strict=True)]
    return quantities | dict(zip(names, shape.T, strict=True))

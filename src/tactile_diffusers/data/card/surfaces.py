"""Segments of a prepared data set: how many, how loud, of which spectrum and friction, surface by surface."""

import math

import numpy as np

from ...signal import RATING_AXES, band_edges, band_levels_db, power_spectral_density

#: So many segments of all surfaces together make the spectra.
SPECTRUM_SEGMENTS = 400
#: But at least so many of each surface.
LEAST_PER_SURFACE = 2
#: Spectra are shown up to this multiple of the band's upper edge.
SPECTRUM_TOP = 1.5
#: dB per unit of level, which is a natural logarithm of the RMS.
DB_PER_LEVEL = 20 / math.log(10)
#: Quantiles of level over surfaces at which an example is shown.
EXAMPLES = {"low level": 0.1, "middle level": 0.5, "high level": 0.9}


def describe_surfaces(data):
    """Counts, levels, friction coefficients, ratings and spectra of each surface.

    Args:
        data (`PreparedDataset`): every split, the filtered subset, the native rate.

    Returns:
        `tuple[list[dict], dict]`: one entry per surface of the file, with None or NaN where it has no segment, and the
        mean spectra of "all" surfaces and of the quietest, middle and loudest third.
    """
    chosen = data.non_overlapping(max(LEAST_PER_SURFACE, SPECTRUM_SEGMENTS // len(data.surfaces)))
    edges = band_edges(band=data.band)
    explorers = np.array([name.split("/")[1] for name in data.recordings])[data.recording_ids]
    measured = {"level_db": DB_PER_LEVEL * data.levels, "friction": data.friction_coefficients}
    rows, spectra, frequencies = [], {}, None
    for number, name in enumerate(data.surfaces):
        mine = np.flatnonzero(data.surface_ids == number)
        parts = {str(who): mine[explorers[mine] == who] for who in np.unique(explorers[mine])}
        row = {"name": name, "split": data.splits[number], "segments": len(mine)}
        row["explorers"] = {who: len(part) for who, part in parts.items()}
        for key, values in measured.items():
            row[key], row[f"{key}_std"] = _mean_and_spread(values[mine])
            row[f"{key}_explorers"] = {who: _mean_and_spread(values[part])[0] for who, part in parts.items()}
        for key, pooled in (("ratings", data.surface_ratings), ("raters", data.surface_ratings_count)):
            row[key] = dict(zip(RATING_AXES, pooled[number], strict=True))
        textures = data.textures(chosen[data.surface_ids[chosen] == number])
        row["spectra_from"] = len(textures)
        if len(textures):
            levels = band_levels_db(textures, data.sampling_rate, edges)
            row["bands_db"], row["bands_db_std"] = levels.mean(axis=0), levels.std(axis=0)
            frequencies, density = power_spectral_density(textures, data.sampling_rate)
            spectra[number] = 10 * np.log10(np.maximum(density.mean(axis=0), np.finfo(np.float64).tiny))
        rows.append(row)
    return rows, {"edges": edges, "segments": len(chosen), **_mean_spectra(rows, spectra, frequencies, data.band)}


def _mean_and_spread(values):
    known = values[~np.isnan(values)].astype(np.float64)
    return (known.mean(), known.std()) if len(known) else (np.nan, np.nan)


def _mean_spectra(rows, spectra, frequencies, band):
    """Mean over surfaces, in dB, with the 10th and 90th percentile; the same for thirds by level, without."""
    order = sorted(spectra, key=lambda number: rows[number]["level_db"])
    shown = (frequencies > 0) & (frequencies <= SPECTRUM_TOP * band[1])
    stacked = np.array([spectra[number] for number in order])[:, shown]
    thirds = zip(("quietest third", "middle third", "loudest third"), np.array_split(stacked, 3), strict=True)
    return {
        "frequencies": frequencies[shown],
        "mean_db": stacked.mean(axis=0),
        "p10_db": np.quantile(stacked, 0.1, axis=0),
        "p90_db": np.quantile(stacked, 0.9, axis=0),
        "thirds_db": {name: part.mean(axis=0) for name, part in thirds if len(stacked) >= 3},
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
    return quantities | dict(zip(band_names(edges), shape.T, strict=True))


def band_names(edges):
    """ "20–31 Hz" and so on."""
    return [f"{low:.0f}–{high:.0f} Hz" for low, high in zip(edges[:-1], edges[1:], strict=True)]


def examples(data, rows):
    """One segment of a surface of low, middle and high level: the one nearest to its surface's mean.

    Returns:
        `tuple[list[dict], np.ndarray]`: what they are, and the textures (examples, segment_samples).
    """
    levels = np.array([row["level_db"] for row in rows])
    order = np.argsort(levels)[: np.sum(~np.isnan(levels))]  # NaN sorts last
    entries, indices = {}, []
    for name, quantile in EXAMPLES.items():
        number = int(order[round(quantile * (len(order) - 1))])
        if rows[number]["name"] in entries:
            continue
        mine = np.flatnonzero(data.surface_ids == number)
        index = int(mine[np.argmin(np.abs(DB_PER_LEVEL * data.levels[mine] - levels[number]))])
        entries[rows[number]["name"]] = {
            "which": name,
            "surface": rows[number]["name"],
            "recording": data.recordings[data.recording_ids[index]],
            "start_s": data.starts[index] / data.sampling_rate,
            "level_db": DB_PER_LEVEL * data.levels[index],
        }
        indices.append(index)
    return list(entries.values()), data.textures(indices)

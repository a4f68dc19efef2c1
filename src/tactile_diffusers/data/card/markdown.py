"""The words and tables of a data card."""

from ...signal import RATING_AXES
from ..folder.conversion_report import notes_in_words
from .advice import listed
from .figures import MOST_EXPLORERS, MOST_NAMES, channel_labels, unit_name
from .surfaces import band_names
from .turnarounds import TREATMENTS


def table(header, rows, align="---:"):
    """A Markdown table; the first column is left-aligned text, None becomes a dash."""
    lines = ["| " + " | ".join(header) + " |", "|---" + f"|{align}" * (len(header) - 1) + "|"]
    return "\n".join(lines + ["| " + " | ".join(_cell(value) for value in row) + " |" for row in rows])


def _cell(value):
    if value is None:
        return "–"
    if isinstance(value, float):
        return f"{value:.2f}" if abs(value) >= 0.1 or value == 0 else f"{value:.2g}"
    return str(value).replace("|", "\\|").replace("\n", " ")


def summary(card):
    """The head of a card: what the data are, and the warnings."""
    return f"{_source(card)}\n\nWarnings:\n\n{warnings_in_words(card)}"


def markdown(card, pictures):
    """The whole card.

    Args:
        card (`dict`): the numbers.
        pictures (`list[str]`): names of the PNGs that there are.

    Returns:
        `str`
    """
    sections = {
        "Warnings": warnings_in_words(card),
        "What was kept": _kept(card),
        "Segments": _segments(card),
        "Level, spectrum and friction": _surfaces(card),
        "Speed and normal force": _limits(card),
        "Turnarounds": _turnarounds(card),
        "Ratings": _ratings(card["ratings"]) if card["ratings"] else "None in the file.",
        "Do ratings and recordings belong together?": _relation(card["ratings"]),
        "Waveforms": "One segment of a surface of low, middle and high level, after the band-pass.",
    }
    shown = {
        "What was kept": ("kept",),
        "Segments": ("segments",),
        "Level, spectrum and friction": ("surfaces", "spectra"),
        "Speed and normal force": ("limits",),
        "Turnarounds": ("turnarounds",),
        "Ratings": ("ratings",),
        "Waveforms": ("waveforms",),
    }
    parts = [
        f"# Data card: {card['recordings']['attributes'].get('source', 'no source stated')}",
        "Every number is in `card.json`. On all axes more is rougher, bumpier, more slippery: raw answers are from 0 "
        "to 8, z is one rater's z-score, averaged over raters.",
        _source(card),
    ]
    for title, text in sections.items():
        images = [f"![{name}]({name}.png)" for name in shown.get(title, ()) if f"{name}.png" in pictures]
        parts += [f"## {title}", text, *images]
    return "\n\n".join(parts) + "\n"


def _source(card):
    source, preparation = card["recordings"], card["preparation"]
    noted = {k: v for k, v in source["attributes"].items() if k not in ("source", "licence")}
    segments = sum(row["segments"] for row in card["surfaces"])
    band = "{:g}–{:g} Hz".format(*preparation["band"])
    rows = {
        **{name: source["attributes"].get(name, "none stated") for name in ("source", "licence")},
        "also noted": ", ".join(f"{name} {value}" for name, value in noted.items()),
        "file": f"{source['file']}, {source['bytes'] / 1e6:.1f} MB",
        "recordings": f"{source['recordings']}, {_time(source['seconds'])}",
        "surfaces": source["surfaces"],
        "explorers": f"{len(source['explorers'])}: {listed(source['explorers'])}",
        "raters": card["ratings"]["answers"]["raters"] if card["ratings"] else "none",
        "channels": ", ".join(f"{name} in {count}" for name, count in source["channels"].items()),
        "rates": f"force {listed(source['rates'])} Hz, velocity {listed(source['velocity_rates']) or '–'} Hz",
        "unit of force": "N" if source["unit"] == "N" else "1: uncalibrated, so levels are relative to one count",
        "ground truth": "stored in the file, for evaluation only" if source["truth"] else "",
        "segments": f"{segments}, from {_percent(card['kept']['kept_share'])} of the time",
        "limits": limits_in_words(preparation["limits"]),
        "band-pass": f"{band}, order {preparation['filter_order']}, passes {preparation['filter_passes']}",
        "prepared by": preparation["made_by"],
    }
    return table(("", ""), [(name, value) for name, value in rows.items() if value != ""], align="---")


def _time(seconds):
    return f"{seconds:.1f} s" if seconds < 120 else f"{seconds / 60:.1f} min"


def _percent(share):
    return "–" if share is None else f"{100 * share:.1f} %"


def limits_in_words(limits):
    """Limits of segments, the dict in the attributes of a prepared file, in words."""
    words = []
    for name, bounds, unit in (
        ("normal force", limits["normal_force"], "N"),
        ("speed", limits["speed"], "mm/s"),
    ):
        words.append(f"any {name}" if bounds is None else f"{name} {bounds[0]:g}–{bounds[1]:g} {unit}")
    words += [f"deviations up to {limits['longest_excursion']:g} s bridged", f"segments of {limits['seconds']:g} s"]
    return ", ".join([*words, f"{100 * limits['overlap']:.0f} % overlap"])


def warnings_in_words(card):
    """The warnings of a card as a Markdown list."""
    return "\n".join(f"- **{warning['name']}**: {warning['text']}" for warning in card["warnings"]) or "None."


def _kept(card):
    kept = card["kept"]
    explorers = kept["explorers"] if 1 < len(kept["explorers"]) <= MOST_EXPLORERS else {}
    total = sum(kept["seconds"].values())
    rows = [
        (reason, f"{seconds:.1f}", _percent(seconds / total), *(f"{who[reason]:.1f}" for who in explorers.values()))
        for reason, seconds in kept["seconds"].items()
    ]
    text = [
        "Each sample is counted once, under the first reason that applies, from top to bottom.",
        table(("reason", "s", "share", *(f"{name}, s" for name in explorers)), rows),
    ]
    if card["recordings"]["conversion"]:
        text += ["Notes of the conversion from a folder:", notes_in_words(card["recordings"]["conversion"])]
    if card["preparation"]["notes"]:
        text += ["Notes of the preparation:", "\n".join(f"- {note}" for note in card["preparation"]["notes"])]
    return "\n\n".join(text)


def _segments(card):
    splits = card["preparation"]["segments"]
    return table(("split", "surfaces", "segments"), [(split, *counts.values()) for split, counts in splits.items()])


def _surfaces(card):
    unit, rows = unit_name(card["recordings"]["unit"]), card["surfaces"]
    text = (
        f"Levels are RMS in dB re 1 {unit}. ± is the standard deviation over segments. Spectra are of "
        f"{card['spectra']['segments']} segments that share no sample."
    )
    if len(rows) > MOST_NAMES:
        return text
    axes = RATING_AXES if card["ratings"] else ()
    header = ("surface", "split", "segments", "level, dB", "±", "friction coefficient", "±")
    keys = ("name", "split", "segments", "level_db", "level_db_std", "friction", "friction_std")
    cells = [(*(row[key] for key in keys), *(row["ratings"][axis] for axis in axes)) for row in rows]
    return f"{text}\n\n" + table((*header, *(f"{axis}, z" for axis in axes)), cells)


def _limits(card):
    names = channel_labels(unit_name(card["recordings"]["unit"]))
    rows = [
        (names[name], histogram["mean"], histogram["largest"], _percent(histogram["share_inside"]))
        for name, histogram in card["histograms"].items()
        if histogram
    ]
    return table(("", "mean", "largest", "time inside the limit"), rows) if rows else "Neither was recorded."


def _turnarounds(card):
    turnarounds = card["turnarounds"]
    text = f"The data were prepared with `--turnarounds {turnarounds['treatment']}`. "
    if not turnarounds["share"]:
        return text + "No segment holds a turnaround (or velocity is unknown)."
    text += (
        f"{_percent(turnarounds['share'])} of the segments hold a turnaround; their level is "
        f"{turnarounds['median_db']:.2f} dB above what it is without 60 ms around it in the median, "
        f"{turnarounds['p90_db']:.2f} dB or more in a tenth of them."
    )
    rows = [(TREATMENTS[name], *effect["bands_db"]) for name, effect in turnarounds["effects"].items()]
    if not rows:
        return text
    text += (
        " Segments with turnarounds against others of the same recording, dB, in a sample of recordings of "
        f"{next(iter(turnarounds['effects'].values()))['surfaces']} surfaces:\n\n"
    )
    return text + table(("", *band_names(card["spectra"]["edges"])), rows)


def _ratings(ratings):
    answers, pooled = ratings["answers"], ratings["pooled"]
    header = ("axis", "mean, 0–8", "std", "missing", "at 0", "at 8", "raters a surface", "r of two raters", "alpha")
    rows = [
        (
            axis,
            *(entry[key] for key in ("mean", "std")),
            *(_percent(entry[f"{key}_share"]) for key in ("missing", "low_end", "high_end")),
            "{fewest_raters}–{most_raters}".format(**entry),
            *(entry[key] for key in ("mean_correlation", "alpha")),
        )
        for axis, entry in answers["axes"].items()
    ]
    spreads = [(axis, pooled["std"][axis], *row) for axis, row in zip(RATING_AXES, pooled["correlation"], strict=True)]
    return "\n\n".join(
        [
            f"{answers['raters']} raters, {answers['surfaces_rated']} surfaces rated. Alpha is Cronbach's.",
            table(header, rows),
            "Pooled over raters, in z:",
            table(("axis", "std over surfaces", *(f"r with {axis}" for axis in RATING_AXES)), spreads),
        ]
    )


def _relation(ratings):
    relation = ratings and ratings["relation"]
    if not relation:
        return "Too few surfaces with ratings and segments to tell."
    return (
        f"Spearman correlations over {relation['surfaces']} surfaces; bands are relative to the mean of the nine. Were "
        f"ratings shuffled among surfaces, the largest would reach {relation['largest']:.2f} with probability "
        f"{relation['unrelated']:.3f}.\n\n"
        + table(("", *RATING_AXES), [(name, *row.values()) for name, row in relation["spearman"].items()])
    )

"""The words and tables of a data card."""

from ...io.markdown import table
from ...signal import RATING_AXES
from ..folder.conversion_report import notes_in_words
from ..segments import limits_in_words
from .advice import listed
from .card_figures import MOST_EXPLORERS, MOST_NAMES, RATINGS, SURFACES, unit_name
from .measure import QUANTILES


def summary(card):
    """The head of a card: what the data are, and the warnings."""
    return f"{_source(card)}\n\nWarnings:\n\n{warnings_in_words(card)}"


def warnings_in_words(card):
    """The warnings of a card as a Markdown list."""
    return "\n".join(f"- **{warning['name']}**: {warning['text']}" for warning in card["warnings"]) or "None."


def markdown(card, pictures):
    """The whole card.

    Args:
        card (`dict`): the numbers.
        pictures (`list[str]`): names of the PNGs that there are.

    Returns:
        `str`
    """
    sections = {
        "Warnings": (warnings_in_words(card), None),
        "What was kept": (_kept(card), None),
        "Level, spectrum and friction": (_surfaces(card), SURFACES),
        "Speed and normal force": (_conditions(card), None),
        "Ratings": (_ratings(card["ratings"]) if card["ratings"] else "None in the file.", RATINGS),
        "Do ratings and recordings belong together?": (_relation(card["ratings"]), None),
    }
    parts = [
        f"# Data card: {card['recordings']['attributes'].get('source', 'no source stated')}",
        "Every number is in `card.json`. On all axes more is rougher, bumpier, more slippery: raw answers are from 0 "
        "to 8, z is one rater's z-score, averaged over raters.",
        _source(card),
    ]
    for title, (text, picture) in sections.items():
        image = [f"![{picture.removesuffix('.png')}]({picture})"] if picture in pictures else []
        parts += [f"## {title}", text, *image]
    return "\n\n".join(parts) + "\n"


def _source(card):
    source, preparation = card["recordings"], card["preparation"]
    others = {k: v for k, v in source["attributes"].items() if k not in ("source", "licence")}
    band = "{:g}–{:g} Hz".format(*preparation["band"])
    splits = ", ".join(f"{split} {counts['segments']}" for split, counts in preparation["segments"].items())
    rows = {
        **{name: source["attributes"].get(name, "none stated") for name in ("source", "licence")},
        "other attributes": ", ".join(f"{name} {value}" for name, value in others.items()),
        "file": f"{source['file']}, {source['bytes'] / 1e6:.1f} MB",
        "recordings": f"{source['recordings']}, {_time(source['seconds'])}",
        "surfaces": source["surfaces"],
        "explorers": f"{len(source['explorers'])}: {listed(source['explorers'])}",
        "raters": card["ratings"]["answers"]["raters"] if card["ratings"] else "none",
        "channels": ", ".join(f"{name} in {count}" for name, count in source["channels"].items()),
        "rates": f"force {listed(source['rates'])} Hz, velocity {listed(source['velocity_rates']) or '–'} Hz",
        "unit of force": "N" if source["unit"] == "N" else "1: uncalibrated, so levels are relative to one count",
        "segments": f"{splits}, from {_percent(card['kept']['kept_share'])} of the time",
        "limits": limits_in_words(preparation["limits"]),
        "turnarounds": preparation["turnarounds"],
        "band-pass": f"{band}, order {preparation['filter_order']}, passes {preparation['filter_passes']}",
        "prepared by": preparation["prepared_by"],
    }
    return table(("", ""), [(name, value) for name, value in rows.items() if value != ""], align="---")


def _time(seconds):
    return f"{seconds:.1f} s" if seconds < 120 else f"{seconds / 60:.1f} min"


def _percent(share):
    return "–" if share is None else f"{100 * share:.1f} %"


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


def _surfaces(card):
    unit, rows, bands = unit_name(card["recordings"]["unit"]), card["surfaces"], card["bands"]
    text = (
        f"Levels are RMS in dB re 1 {unit}. ± is the standard deviation over segments. Band levels are of "
        f"{bands['segments']} segments that share no sample. {_percent(bands['turnaround_share'])} of the segments "
        "hold a turnaround"
    )
    change = bands["turnaround_db"]
    text += "." if change is None else f", which raises their level by {change:.2f} dB in the median."
    if len(rows) > MOST_NAMES:
        return text
    axes = RATING_AXES if card["ratings"] else ()
    header = ("surface", "split", "segments", "level, dB", "±", "friction coefficient", "±")
    keys = ("name", "split", "segments", "level_db", "level_db_std", "friction", "friction_std")
    cells = [(*(row[key] for key in keys), *(row["ratings"][axis] for axis in axes)) for row in rows]
    return f"{text}\n\n" + table((*header, *(f"{axis}, z" for axis in axes)), cells)


def _conditions(card):
    units = {"normal_force": unit_name(card["recordings"]["unit"]), "speed": "mm/s"}
    rows = []
    for name, found in card["conditions"].items():
        explorers = found["explorers"] if found else {}
        if len(explorers) > 1 + MOST_EXPLORERS:
            explorers = {"all": explorers["all"]}
        for who, entry in explorers.items():
            what = f"{name.replace('_', ' ')}, {units[name]}: {who}"
            rows.append((what, *entry["quantiles"], _percent(entry["share_inside"])))
    header = ("", *(f"{100 * share:.0f} % of the time below" for share in QUANTILES), "inside the limits")
    return table(header, rows) if rows else "Neither was recorded."


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
    pooled = [(axis, pooled["std"][axis], *row) for axis, row in zip(RATING_AXES, pooled["correlation"], strict=True)]
    return "\n\n".join(
        [
            f"{answers['raters']} raters, {answers['surfaces_rated']} surfaces rated. Alpha is Cronbach's.",
            table(header, rows),
            "Pooled over raters, in z:",
            table(("axis", "std over surfaces", *(f"r with {axis}" for axis in RATING_AXES)), pooled),
        ]
    )


def _relation(ratings):
    relation = ratings and ratings["relation"]
    if not relation:
        return "There are too few surfaces with ratings and segments to tell."
    return (
        f"Spearman correlations over {relation['surfaces']} surfaces; bands are relative to the mean of the nine. If "
        f"ratings were shuffled among surfaces, the largest would reach {relation['largest']:.2f} with probability "
        f"{relation['unrelated']:.3f}.\n\n"
        + table(("", *RATING_AXES), [(name, *row.values()) for name, row in relation["spearman"].items()])
    )

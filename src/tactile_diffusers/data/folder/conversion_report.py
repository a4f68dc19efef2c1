"""What a conversion did: counts, notes with their first place, and the lag between force and motion."""

import json
from dataclasses import dataclass, field

import numpy as np

#: Attribute of recordings.h5 that holds the report.
REPORT_ATTRIBUTE = "conversion"
#: A median lag (ms) of more than this is worth an `offset`: less is the shear of the finger pad at reversals (recipe).
NOTABLE_LAG = 5.0
#: Recordings that are listed by name; attributes of HDF5 hold 64 kB.
_LISTED = 20


def notes_in_words(facts):
    """What `ConversionReport.facts` holds beyond counts, as a Markdown list.

    Args:
        facts (`dict`): as stored.
    """
    return "\n".join(f"- {line.removeprefix('note: ').strip()}" for line in _lines(facts))


def _lines(facts):
    """Notes begin with "note: "."""
    lines = [f"note: {count} {kind}; first {place}" for kind, (count, place) in facts["notes"].items()]
    lines += [f"note: ratings: {note}" for note in facts["rating_notes"]]
    lines += [f"note: {remark}" for remark in facts["remarks"]]
    first = facts["left_out_first"]
    lines += [f"left out: {name}: {reason}" for name, reason in first.items()]
    if facts["left_out"] > len(first):
        lines.append(f"left out: {facts['left_out'] - len(first)} more")
    lag = facts["lag"]
    if not lag["recordings"]:
        why = "no recording turns, or none shows it" if lag["not_determinable"] else "there is no motion"
        return [*lines, f"lag between force and motion: not determinable ({why})"]
    low, high = lag["range_ms"]
    lines.append(
        f"force behind motion: median {lag['median_ms']:+.1f} ms ({low:+.1f} to {high:+.1f} ms, correlation "
        f"{abs(lag['median_correlation']):.2f}) in {lag['recordings']} recordings; not determinable in "
        f"{lag['not_determinable']}"
    )
    if abs(lag["median_ms"]) > NOTABLE_LAG:
        undone = f"{-lag['median_ms'] / 1000:+.4f} s"
        lines.append(f"  nothing was shifted; to undo it, add {undone} to `offset` of the files with force")
    return lines


@dataclass
class ConversionReport:
    """Counts of a conversion; `str` prints it.

    Attributes:
        recordings (`int`): written.
        surfaces, explorers (`list[str]`): names, in order.
        rates (`list[float]`): of the force, Hz.
        seconds (`float`): of force written.
        notes (`dict[str, list]`): kind -> [count, first place].
        left_out (`dict[str, str]`): recording -> reason.
        raters, axes (`list[str]`): of the ratings that were written.
        rating_notes, remarks (`list[str]`): what happened to the ratings, and what else is to be said.
        lags (`dict[str, Lag | None]`): recording -> lag of the force behind the motion; `None` = it cannot be seen.
    """

    recordings: int = 0
    surfaces: list = field(default_factory=list)
    explorers: list = field(default_factory=list)
    rates: list = field(default_factory=list)
    seconds: float = 0.0
    notes: dict = field(default_factory=dict)
    left_out: dict = field(default_factory=dict)
    raters: list = field(default_factory=list)
    axes: list = field(default_factory=list)
    rating_notes: list = field(default_factory=list)
    remarks: list = field(default_factory=list)
    lags: dict = field(default_factory=dict)

    def note(self, kind, count, place):
        """Counts something of a kind; the first place stays."""
        self.notes.setdefault(kind, [0, str(place)])[0] += int(count)

    def note_counts(self, counts, where):
        """Notes what happened to one channel, kind -> (samples, place)."""
        for kind, (count, place) in counts.items():
            self.note(f"samples {kind}", count, f"{where}, {place}" if place else where)

    def add(self, name, **arrays):
        """Counts one recording: (surface, explorer, trial) and what `add_recording` takes."""
        kind = "force" if "force" in arrays else "lateral"
        rate = arrays[f"{kind}_rate"]
        self.recordings += 1
        self.seconds += len(arrays[kind]) / rate
        for names, value in ((self.surfaces, name[0]), (self.explorers, name[1]), (self.rates, rate)):
            if value not in names:
                names.append(value)

    @property
    def lag(self):
        """Median lag in s over the recordings that show one; NaN if none does."""
        seen = [lag.seconds for lag in self.lags.values() if lag is not None]
        return float(np.median(seen)) if seen else float("nan")

    @property
    def facts(self):
        """The report as a `dict` that JSON can hold; of long lists the beginning."""
        seen = [lag for lag in self.lags.values() if lag is not None]
        lag = {
            "median_ms": round(1000 * self.lag, 2) if seen else None,
            "range_ms": [round(1000 * end(lag.seconds for lag in seen), 2) for end in (min, max)] if seen else None,
            "median_correlation": round(float(np.median([lag.correlation for lag in seen])), 3) if seen else None,
            "recordings": len(seen),
            "not_determinable": len(self.lags) - len(seen),
        }
        listed = dict(list(self.left_out.items())[:_LISTED])
        counts = {"surfaces": len(self.surfaces), "explorers": len(self.explorers), "raters": len(self.raters)}
        counts |= {"left_out": len(self.left_out), "left_out_first": listed, "seconds": round(self.seconds, 4)}
        same = ("recordings", "rates", "notes", "axes", "rating_notes", "remarks")
        return {name: getattr(self, name) for name in same} | counts | {"lag": lag}

    def as_json(self):
        """`facts` as a string."""
        return json.dumps(self.facts, ensure_ascii=False)

    def __str__(self):
        lines = [
            f"{self.recordings} recordings of {len(self.surfaces)} surfaces by {len(self.explorers)} explorers, "
            f"{self.seconds:.1f} s of force at {' and '.join(f'{rate:g}' for rate in self.rates)} Hz"
        ]
        if len(self.rates) > 1:
            lines.append(
                "note: a prepared data set needs one rate of force: `resample` in the layout, or several files"
            )
        if self.raters:
            lines.append(f"ratings by {len(self.raters)} raters on {', '.join(self.axes)}")
        return "\n".join(lines + _lines(self.facts))

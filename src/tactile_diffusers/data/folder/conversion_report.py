"""What a conversion did: counts, notes with their first place, and the lag between force and motion."""

import json
from dataclasses import dataclass, field

import numpy as np

#: Attribute of recordings.h5 that holds the report.
REPORT_ATTRIBUTE = "conversion"
#: A median lag (s) of more than this is worth an `offset`: less is the shear of the finger pad at reversals (recipe).
NOTABLE_LAG = 0.005
#: Recordings that are listed by name; attributes of HDF5 hold 64 kB.
_LISTED = 20


def notes_in_words(report):
    """What `ConversionReport.as_json` holds beyond counts, as a Markdown list.

    Args:
        report (`dict`): parsed.
    """
    first, lag = report["left_out_first"], report["lag"]
    notes = [f"{count} {kind}; first {place}" for kind, (count, place) in report["notes"].items()]
    notes += [f"ratings: {note}" for note in report["rating_notes"]] + report["remarks"]
    notes += [f"left out: {name}: {reason}" for name, reason in first.items()]
    if report["left_out"] > len(first):
        notes.append(f"left out: {report['left_out'] - len(first)} more")
    if lag["recordings"]:
        notes.append(f"force behind motion: {lag['median_ms']:+.1f} ms, median of {lag['recordings']} recordings")
    else:
        notes.append("the lag between force and motion could not be told")
    return "\n".join(f"- {note}" for note in notes)


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

    def as_json(self):
        """The report as a JSON string; of long lists the beginning."""
        seen = [lag for lag in self.lags.values() if lag is not None]
        lag = {
            "median_ms": round(1000 * self.lag, 2) if seen else None,
            "range_ms": [round(1000 * end(lag.seconds for lag in seen), 2) for end in (min, max)] if seen else None,
            "median_correlation": round(float(np.median([lag.correlation for lag in seen])), 3) if seen else None,
            "recordings": len(seen),
            "not_determinable": len(self.lags) - len(seen),
        }
        return json.dumps(
            {
                "recordings": self.recordings,
                "surfaces": len(self.surfaces),
                "explorers": len(self.explorers),
                "rates": self.rates,
                "seconds": round(self.seconds, 4),
                "left_out": len(self.left_out),
                "left_out_first": dict(list(self.left_out.items())[:_LISTED]),
                "notes": self.notes,
                "raters": len(self.raters),
                "axes": self.axes,
                "rating_notes": self.rating_notes,
                "remarks": self.remarks,
                "lag": lag,
            },
            ensure_ascii=False,
        )

    def __str__(self):
        lines = [
            f"{self.recordings} recordings of {len(self.surfaces)} surfaces by {len(self.explorers)} explorers, "
            f"{self.seconds:.1f} s of force at {' and '.join(f'{rate:g}' for rate in self.rates)} Hz"
        ]
        if len(self.rates) > 1:
            lines.append(
                "note: a prepared data set needs one rate of force: `resample` in the layout, or several files"
            )
        for kind, (count, first) in self.notes.items():
            lines.append(f"note: {count} {kind}; first {first}")
        if self.raters:
            lines.append(f"ratings by {len(self.raters)} raters on {', '.join(self.axes)}")
        lines += [f"note: ratings: {note}" for note in self.rating_notes]
        lines += [f"note: {remark}" for remark in self.remarks]
        shown = list(self.left_out.items())[:_LISTED]
        lines += [f"left out: {name}: {reason}" for name, reason in shown]
        if len(self.left_out) > len(shown):
            lines.append(f"left out: {len(self.left_out) - len(shown)} more")
        return "\n".join(lines + self._lag_lines())

    def _lag_lines(self):
        seen = {name: lag for name, lag in self.lags.items() if lag is not None}
        if not seen:
            why = "there is no motion" if not self.lags else "no recording turns, or none shows it"
            return [f"lag between force and motion: not determinable ({why})"]
        ends = [1000 * end(lag.seconds for lag in seen.values()) for end in (min, max)]
        strength = float(np.median([abs(lag.correlation) for lag in seen.values()]))
        lines = [
            f"force behind motion: median {1000 * self.lag:+.1f} ms ({ends[0]:+.1f} to {ends[1]:+.1f} ms, correlation "
            f"{strength:.2f}) in {len(seen)} recordings; not determinable in {len(self.lags) - len(seen)}"
        ]
        if abs(self.lag) > NOTABLE_LAG:
            lines.append(
                f"  nothing was shifted; to undo it, add {-self.lag:+.4f} s to `offset` of the files with force"
            )
        return lines

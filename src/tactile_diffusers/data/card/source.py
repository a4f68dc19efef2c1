"""What is in a recordings.h5, before any selection."""

import json
from collections import Counter
from pathlib import Path

import numpy as np
from tqdm import tqdm

from ...io.reading import reading
from ..folder.conversion_report import REPORT_ATTRIBUTE, notes_in_words

#: So many samples of all recordings together, evenly spread, make the histograms of speed and normal force.
HISTOGRAM_SAMPLES = 400_000
#: Bins of these histograms.
HISTOGRAM_BINS = 60
#: Share of the time that these histograms show; the tail would squeeze the rest.
HISTOGRAM_SHARE = 0.995
#: Attributes of the file that say nothing about the data, or are told apart from the others.
_OTHER_ATTRIBUTES = ("format", "version", REPORT_ATTRIBUTE)


def describe_source(source, limits, quiet=False):
    """Reads every recording once, one at a time.

    Args:
        source (`RecordingsFile`): open.
        limits (`SegmentLimits`): of the segments; their bounds are compared with all of the time.
        quiet (`bool`): no progress bar.

    Returns:
        `tuple[dict, dict]`: what the file holds ("source", "licence", "unit", names, counts, rates, seconds), and for
        "normal_force" (N) and "speed" (mm/s) the histogram of time (s) per explorer, or None without the channel. The
        "conversion" is what was noted when a folder was converted to this file, or None.

    Raises:
        ValueError: if what was noted of the conversion is damaged.
    """
    conversion = _conversion(source)
    per_recording = max(100, HISTOGRAM_SAMPLES // len(source))
    counts = {name: Counter() for name in ("channels", "rates", "velocity_rates")}
    seconds, samples = Counter(), {"normal_force": _Samples(), "speed": _Samples()}
    for recording in tqdm(source, total=len(source), desc="recordings", unit="recording", disable=quiet):
        lasts = recording.samples / recording.rate
        seconds[recording.explorer] += lasts
        counts["channels"]["lateral" if recording.force is None else "force"] += 1
        counts["rates"][f"{recording.rate:g}"] += 1
        if recording.force is not None:
            normal = np.abs(recording.force[:, 2])
            samples["normal_force"].add(recording.explorer, normal, lasts, per_recording, limits.normal_force)
        if recording.velocity is not None:
            counts["channels"]["velocity"] += 1
            counts["velocity_rates"][f"{recording.velocity_rate:g}"] += 1
            speed = np.hypot(*recording.velocity.T)
            samples["speed"].add(recording.explorer, speed, lasts, per_recording, limits.speed)
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
        "attributes": {name: value for name, value in source.attributes.items() if name not in _OTHER_ATTRIBUTES},
        "conversion": conversion,
        "truth": source.truth is not None,
    }
    return facts, {name: collected.histogram(getattr(limits, name)) for name, collected in samples.items()}


def _conversion(source):
    """What was noted when the file was converted from a folder; `None` if it was not."""
    with reading(source.path, f"a store of recordings with the attribute {REPORT_ATTRIBUTE!r}", "Convert it again."):
        noted = json.loads(source.attributes.get(REPORT_ATTRIBUTE, "null"))
        if noted is not None:
            notes_in_words(noted)
    return noted


class _Samples:
    """Evenly spread samples of one channel, each with the seconds that it stands for."""

    def __init__(self):
        self.values, self.seconds, self.inside, self.largest = {}, {}, 0.0, 0.0

    def add(self, explorer, values, lasts, count, bounds):
        known = values[~np.isnan(values)]
        if not len(known):
            return
        lasts *= len(known) / len(values)
        self.largest = max(self.largest, float(known.max()))
        if bounds is not None:
            self.inside += lasts * float(np.mean((known >= bounds[0]) & (known <= bounds[1])))
        chosen = known[:: max(1, len(known) // count)]
        self.values.setdefault(explorer, []).append(chosen)
        self.seconds.setdefault(explorer, []).append(np.full(len(chosen), lasts / len(chosen)))

    def histogram(self, bounds):
        if not self.values:
            return None
        values, seconds = ({who: np.concatenate(p) for who, p in d.items()} for d in (self.values, self.seconds))
        every, weights = np.concatenate(list(values.values())), np.concatenate(list(seconds.values()))
        top = 1.05 * np.quantile(every, HISTOGRAM_SHARE)
        if bounds is not None:
            top = max(top, 1.1 * bounds[1])
        edges = np.linspace(0, top or 1.0, HISTOGRAM_BINS + 1)
        total = weights.sum()
        return {
            "edges": edges,
            "seconds": {who: np.histogram(values[who], edges, weights=seconds[who])[0] for who in sorted(values)},
            "limits": bounds,
            "share_inside": None if bounds is None else self.inside / total,
            "share_above": float(weights[every > edges[-1]].sum() / total),
            "mean": float(np.average(every, weights=weights)),
            "largest": self.largest,
        }

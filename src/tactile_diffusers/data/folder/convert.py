"""From a folder and its layout to `recordings.h5`, one recording in memory at a time, with a report."""

from dataclasses import dataclass, field
from pathlib import Path

from tqdm import tqdm

from ...io.files import clear_left_behind
from ..recordings import RecordingsWriter
from .channels import read_channels
from .clocks import Unusable
from .layout import Layout
from .layout_text import load_layout
from .rating_tables import rated_surfaces, read_ratings
from .sources import find_recordings

#: Attribute of recordings.h5 that holds the report.
REPORT_ATTRIBUTE = "conversion"
#: Recordings that are listed by name; attributes of HDF5 hold 64 kB.
_LISTED = 20


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
        rating_notes (`list[str]`): what happened to the ratings.
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
        lines += [f"note: {count} {kind}; first {place}" for kind, (count, place) in self.notes.items()]
        lines += [f"note: ratings: {note}" for note in self.rating_notes]
        lines += [f"left out: {name}: {reason}" for name, reason in list(self.left_out.items())[:_LISTED]]
        if len(self.left_out) > _LISTED:
            lines.append(f"left out: {len(self.left_out) - _LISTED} more")
        return "\n".join(lines)


def convert_folder(root, layout, output, quiet=False):
    """Converts a folder of recordings, described by a layout, to `recordings.h5`.

    What can be found without reading the numbers (patterns, files that belong together, columns of the first files,
    ratings) is checked first. Samples that are missing, dropped or saturated become NaN and are counted; a recording
    that cannot be used is left out and counted.

    Args:
        root (`str` or `Path`): the folder.
        layout (`Layout`, `str` or `Path`): a layout, or the file of one.
        output (`str` or `Path`): the file to write; it appears only when it is whole.
        quiet (`bool`): no progress bar.

    Returns:
        `ConversionReport`, also stored as the attribute "conversion" of the file, as text.

    Raises:
        FileNotFoundError: if the folder, the layout or the folder of `output` does not exist.
        ValueError: naming file, place and remedy, if the layout does not fit the folder, a unit or axis is wrong, time
            runs backward, ratings do not fit, or no recording can be used.
    """
    if not isinstance(layout, Layout):
        layout = load_layout(layout)
    root, report = Path(root), ConversionReport()
    recordings, report.left_out = find_recordings(root, layout, rated_surfaces(root, layout))
    scores = None
    if layout.ratings is not None:
        names = (*map("/".join, recordings), *report.left_out)
        surfaces, explorers = (tuple(dict.fromkeys(name.split("/")[part] for name in names)) for part in (0, 1))
        scores, report.rating_notes = read_ratings(root, layout, surfaces, explorers)
    sources = {source.path.resolve() for channels in recordings.values() for source in channels.values()}
    if Path(output).resolve() in sources:
        raise ValueError(f"`output` {output} is one of the files to convert: give another name.")
    clear_left_behind(output)
    with RecordingsWriter(output, source=layout.source, licence=layout.licence) as writer:
        for name, channels in tqdm(recordings.items(), desc="converting", unit="recording", disable=quiet):
            try:
                arrays = read_channels(channels, layout.velocity, report)
            except Unusable as error:
                report.left_out["/".join(name)] = str(error)
                continue
            writer.add_recording(*name, **arrays)
            report.add(name, **arrays)
        if not report.recordings:
            name, reason = next(iter(report.left_out.items()))
            raise ValueError(f"{root}: none of {len(report.left_out)} recordings can be used; {name}: {reason}.")
        if scores is not None:
            _write_ratings(writer, scores, report)
        writer.set_attributes(**{REPORT_ATTRIBUTE: str(report)})
    return report


def _write_ratings(writer, scores, report):
    """Stores the answers on surfaces that have a recording after all."""
    kept = [i for i, surface in enumerate(scores.surfaces) if surface in report.surfaces]
    lost = [surface for surface in scores.surfaces if surface not in report.surfaces]
    if lost:
        report.rating_notes.append(f"answers on {lost} left out: all their recordings are")
    if kept:
        surfaces = [scores.surfaces[i] for i in kept]
        writer.set_ratings(scores.values[:, kept], scores.raters, surfaces, scores.axes)
        report.raters, report.axes = list(scores.raters), list(scores.axes)

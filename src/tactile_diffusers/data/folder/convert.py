"""From a folder and its layout to `recordings.h5`, one recording in memory at a time."""

from pathlib import Path

from tqdm import tqdm

from ...io.files import clear_left_behind
from ..recordings import RecordingsWriter
from .channels import read_channels
from .clocks import Unusable
from .conversion_report import REPORT_ATTRIBUTE, ConversionReport
from .layout import Layout, load_layout
from .rating_tables import read_ratings
from .sources import find_recordings


def convert_folder(root, layout, output, quiet=False, remarks=None):
    """Converts a folder of recordings, described by a layout, to `recordings.h5`.

    What can be found without reading the numbers (patterns, files that belong together, columns of the first files,
    ratings) is checked first. Samples that are missing, dropped or saturated become NaN and are counted; a recording
    that cannot be used is left out and counted.

    Args:
        root (`str` or `Path`): the folder.
        layout (`Layout`, `str` or `Path`): a layout, or the file of one.
        output (`str` or `Path`): the file to write; it appears only when it is whole.
        quiet (`bool`): no progress bar.
        remarks (`Callable`, *optional*): from the finished `ConversionReport` to further notes, a list of strings.

    Returns:
        `ConversionReport`, also stored as the attribute "conversion" of the file, in JSON.

    Raises:
        FileNotFoundError: if the folder, the layout or the folder of `output` does not exist.
        ValueError: naming file, place and remedy, if the layout does not fit the folder, a unit or axis is wrong, time
            runs backward, ratings do not fit, or no recording can be used.
    """
    if not isinstance(layout, Layout):
        layout = load_layout(layout)
    root, report = Path(root), ConversionReport()
    recordings, report.left_out = find_recordings(root, layout)
    scores = None
    if layout.ratings is not None:
        names = (*map("/".join, recordings), *report.left_out)
        surfaces = tuple(dict.fromkeys(name.split("/")[0] for name in names))
        scores, report.rating_notes = read_ratings(root, layout, surfaces)
    sources = {source.path.resolve() for channels in recordings.values() for source in channels.values()}
    if Path(output).resolve() in sources:
        raise ValueError(f"`output` {output} is one of the files to convert: give another name.")
    clear_left_behind(output)
    with RecordingsWriter(output, source=layout.source, licence=layout.licence) as writer:
        for name, channels in tqdm(recordings.items(), desc="converting", unit="recording", disable=quiet):
            try:
                arrays = read_channels("/".join(name), channels, layout.velocity, report)
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
        report.remarks = list(remarks(report)) if remarks else []
        writer.set_attributes(**{REPORT_ATTRIBUTE: report.as_json()})
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

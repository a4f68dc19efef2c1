"""SENS3 (www.sens3.net, arXiv 2401.01818): what is known of it, and its conversion by a layout.

50 surfaces were explored by 2 people (static contact, pressing, tapping, sliding) with forces and torques at 10 kHz,
positions and accelerations, and rated by 13 people, of whom the paper uses 12, on 8 pairs of words with 9 points, 0-8.
The published folder could not be looked at here: `sens3_layout` is a template whose TODO marks are to be filled in.
"""

from importlib import resources

from ..signal import DEVICE_RATE
from .folder import convert_folder, load_layout


def sens3_layout():
    """The layout of SENS3 as TOML text, with TODO where something is to be filled in before `convert_sens3`."""
    return resources.files("tactile_diffusers.data").joinpath("layouts/sens3.toml").read_text(encoding="utf-8")


def convert_sens3(root, layout, output, quiet=False):
    """Converts SENS3 to `recordings.h5`, and remarks where it differs from what is known of it.

    Args:
        root (`str` or `Path`): the folder of SENS3.
        layout (`str` or `Path`): `sens3_layout` without TODO.
        output (`str` or `Path`): the file to write.
        quiet (`bool`): no progress bar.

    Returns:
        `ConversionReport`.

    Raises:
        FileNotFoundError, ValueError: as `convert_folder`.
    """
    return convert_folder(root, load_layout(layout), output, quiet=quiet, remarks=_remarks)


def _remarks(report):
    counts = (
        ("surfaces", len(report.surfaces), (50,)),
        ("explorers", len(report.explorers), (2,)),
        ("raters", len(report.raters), (12, 13)),
        ("Hz of force", max(report.rates), (DEVICE_RATE,)),
    )
    return [
        f"{found:g} {what}, SENS3 has {' or '.join(f'{number:g}' for number in known)}"
        for what, found, known in counts
        if found not in known
    ]

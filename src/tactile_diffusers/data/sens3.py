"""SENS3 (www.sens3.net, arXiv 2401.01818): the layout of its folder, and what else is known of it.

50 surfaces were explored by 2 people (static contact, pressing, tapping, sliding) with forces and torques at 10 kHz,
positions and accelerations, and rated by 13 people, of whom the paper uses 12, on 8 pairs of words with 9 points, 0-8.
The published folder could not be looked at here: `sens3_layout` is a template whose TODO marks are to be filled in.
"""

from importlib import resources

from ..signal import DEVICE_RATE


def sens3_layout():
    """The layout of SENS3 as TOML text, with TODO where something is to be filled in before `convert_folder`."""
    return resources.files("tactile_diffusers.data").joinpath("layouts/sens3.toml").read_text(encoding="utf-8")


def differences_from_sens3(report):
    """Where a `ConversionReport` differs from what is known of SENS3: a list of sentences."""
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

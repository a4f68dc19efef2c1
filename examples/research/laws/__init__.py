"""The laws of virtual surfaces, measured on what the code makes: as intended (`LAWS`), and beside measured hands."""

from .friction import compliant_grating, friction_coefficient, onset, stick_slip, stick_slip_comes_and_goes
from .law import Check, Law
from .population import exploration, levels, surfaces
from .texture import (
    amplitude,
    catches,
    envelope,
    finger_low_pass,
    grating_line,
    harmonic_decay,
    noise_in_time,
    profile_slope,
)

#: Name -> function(quick=False) -> `Law`; `quick` measures less, with wider tolerances.
LAWS = {
    law.__name__: law
    for law in (
        profile_slope,
        noise_in_time,
        grating_line,
        harmonic_decay,
        envelope,
        catches,
        amplitude,
        finger_low_pass,
        friction_coefficient,
        compliant_grating,
        stick_slip,
        stick_slip_comes_and_goes,
        onset,
        surfaces,
        levels,
        exploration,
    )
}

__all__ = ["LAWS", "Check", "Law"]

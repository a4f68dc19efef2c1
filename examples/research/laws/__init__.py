"""The laws of virtual surfaces, measured on what the code makes and compared with what is intended."""

from .friction import compliant_grating, friction_coefficient, stick_slip
from .law import Check, Law
from .people import exploration, further_explorers, raters
from .surfaces import levels, material_classes
from .texture import amplitude, finger_low_pass, grating_line, harmonic_decay, noise_in_time, profile_slope

#: Name -> function(quick=False) -> `Law`; `quick` measures less, with wider tolerances.
LAWS = {
    law.__name__: law
    for law in (
        profile_slope,
        noise_in_time,
        grating_line,
        harmonic_decay,
        amplitude,
        finger_low_pass,
        friction_coefficient,
        compliant_grating,
        stick_slip,
        material_classes,
        levels,
        raters,
        exploration,
        further_explorers,
    )
}

__all__ = ["LAWS", "Check", "Law"]

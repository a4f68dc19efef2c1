"""The finger strip: a page of its own that plays a texture under a pointer, in the browser alone."""

import base64
import html
import json
import math
from pathlib import Path

import numpy as np
from sound import SOUND_RMS

from tactile_diffusers.playback import TextureProfile
from tactile_diffusers.playback.finger import CUTOFF_HZ
from tactile_diffusers.playback.force_laws import SLOWEST_SLIDING, SPEED_EXPONENT, TURNING_SPEED
from tactile_diffusers.signal import BAND_HZ, DEVICE_RATE, REFERENCE_FORCE, SEGMENT_SAMPLES

#: Height of the page in pixels.
HEIGHT = 350
#: Speed in mm/s that a texture of unknown speed is taken to have: the middle of the paper's limits.
UNKNOWN_SPEED = 80.0
_TEMPLATE = Path(__file__).with_name("strip.html")
_PLACE = "/* DATA */ null"


def strip_page(texture):
    """An HTML page that gives the friction force of a finger that is dragged over the texture, seen and estimated.

    Nothing is loaded from elsewhere. The profile is the texture's first segment over position, looped and filled as in
    [`TextureProfile`], float32; the laws are those of [`TextureStream`], with a lighter filter of the finger's path.

    Args:
        texture ([`Texture`]): at least 0.2 s.

    Returns:
        `str`: the page.
    """
    profile = TextureProfile(texture.samples[:SEGMENT_SAMPLES], texture.sampling_rate, _speed(texture), separate=False)
    samples = profile.period().astype("<f4")
    known = math.isfinite(texture.friction_coefficient)
    data = {
        "profile": base64.b64encode(samples.tobytes()).decode("ascii"),
        "pitch": profile.pitch,
        "referenceSpeed": profile.reference_speed,
        "friction": texture.friction_coefficient if known else 0.0,
        "normalForce": REFERENCE_FORCE,
        "speedExponent": SPEED_EXPONENT,
        "slowestSliding": SLOWEST_SLIDING,
        "turningSpeed": TURNING_SPEED,
        "band": BAND_HZ,
        "cutoff": CUTOFF_HZ,
        "deviceRate": DEVICE_RATE,
        "level": max(texture.rms, 1e-9),
        "soundLevel": SOUND_RMS,
    }
    return _TEMPLATE.read_text(encoding="utf-8").replace(_PLACE, json.dumps(data))


def strip_html(texture):
    """The page in a frame that may run scripts and do nothing else."""
    page = html.escape(strip_page(texture), quote=True)
    return (
        f'<iframe class="finger-strip" title="Finger strip" sandbox="allow-scripts" allow="autoplay" '
        f'style="width:100%;height:{HEIGHT}px;border:0" srcdoc="{page}"></iframe>'
    )


def _speed(texture):
    """A texture of unknown speed is played all the same, at a likely one."""
    return texture.reference_speed if np.isfinite(texture.reference_speed) else UNKNOWN_SPEED

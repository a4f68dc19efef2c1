"""Textures as sound, for listening only: the ear is no finger, and level is taken out."""

import base64
import io

import numpy as np

from tactile_diffusers.signal import resample, rms

#: Hz; far above what a texture holds, and a rate that every browser plays.
SOUND_RATE = 24_000
#: RMS of every sound relative to full scale (-20 dB), so that loudness tells nothing; peaks may make it less.
SOUND_RMS = 0.1


def to_sound(samples, sampling_rate):
    """A texture as sound of `SOUND_RATE`: (n,) float64 within [-1, 1], all of the same RMS.

    Args:
        samples (`np.ndarray`): (m,), N.
        sampling_rate (`int`): Hz.
    """
    sound = resample(samples, sampling_rate, SOUND_RATE)
    sound = sound / max(rms(sound) / SOUND_RMS, 1e-12)
    return sound / max(1.0, np.abs(sound).max())


def sound_html(texture, name):
    """A player, without a file and without a script.

    Args:
        texture ([`Texture`]): what is played.
        name (`str`): of it, for people who do not see the page.
    """
    import soundfile

    file = io.BytesIO()
    soundfile.write(file, to_sound(texture.samples, texture.sampling_rate), SOUND_RATE, format="WAV", subtype="PCM_16")
    data = base64.b64encode(file.getvalue()).decode("ascii")
    return f'<audio controls preload="auto" aria-label="{name}" src="data:audio/wav;base64,{data}"></audio>'

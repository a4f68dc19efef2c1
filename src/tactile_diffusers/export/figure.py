"""A picture of a texture: waveform, spectrum and spectrogram."""

import math

import numpy as np

from ..io.files import atomic_path
from ..signal import BAND_HZ, RATING_AXES, power_spectral_density, rms
from .metadata import check_positive_or_unknown, check_ratings, check_texture

SPECTRUM_HZ = (10.0, 5000.0)
SPECTROGRAM_TOP_HZ = 1200.0
DYNAMIC_RANGE_DB = 60.0
_ORIGINAL = {"color": "0.6", "label": "original"}


def write_figure(path, texture, *, sampling_rate, friction_coefficient, ratings, original=None, axes=RATING_AXES):
    """Writes a PNG with the waveform in mN, the power spectral density and the spectrogram of one texture.

    Args:
        path, texture, sampling_rate, friction_coefficient, ratings: as for `write_npz`; at least 0.05 s.
        original (`np.ndarray`, *optional*): (samples,), N, the recording of which `texture` is a reconstruction:
            waveform and spectrum show it, and the title has no ratings.
        axes (`Sequence[str]`): names of the ratings, those of the checkpoint.

    Raises:
        ValueError: on a bad argument, before anything is written.
    """
    texture = check_texture(texture, sampling_rate)
    if len(texture) < 0.05 * sampling_rate:
        raise ValueError(
            f"`texture` of {len(texture)} samples at {sampling_rate} Hz is too short to draw. Give at least 0.05 s."
        )
    friction_coefficient = check_positive_or_unknown("friction_coefficient", friction_coefficient)
    title = _title(texture, friction_coefficient, check_ratings(ratings), axes)
    if original is not None:
        original = check_texture(original, sampling_rate)
        title = f"reconstruction, RMS {1e3 * rms(texture):.2f} mN; original {1e3 * rms(original):.2f} mN"

    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 7), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplot_mosaic([["waveform", "waveform"], ["spectrum", "spectrogram"]], height_ratios=(2, 3))
    figure.suptitle(title, fontsize=11)
    if original is not None:
        panels["waveform"].plot(np.arange(len(original)) / sampling_rate, 1e3 * original, linewidth=0.5, **_ORIGINAL)
    draw_waveform(panels["waveform"], texture, sampling_rate)
    if original is not None:
        panels["waveform"].lines[-1].set_label("reconstruction")
        panels["waveform"].legend(loc="upper right", fontsize=9)
    _draw_spectrum(panels["spectrum"], texture, sampling_rate, original)
    draw_spectrogram(panels["spectrogram"], texture, sampling_rate)
    with atomic_path(path) as temporary:
        figure.savefig(temporary, format="png", dpi=120)


def _title(texture, friction_coefficient, ratings, axes):
    named = ", ".join(
        f"{axis} {'not specified' if math.isnan(value) else f'{value:+.2g}'}"
        for axis, value in zip((*axes, *["further axis"] * len(ratings)), ratings, strict=False)
    )
    friction = "unknown" if math.isnan(friction_coefficient) else f"{friction_coefficient:.2f}"
    return f"{named}\nfriction coefficient {friction}, RMS {1e3 * rms(texture):.2f} mN"


def draw_waveform(panel, texture, sampling_rate):
    """Draws lateral force in mN over time into a matplotlib panel; `texture` is (samples,) in N."""
    seconds = np.arange(len(texture)) / sampling_rate
    panel.plot(seconds, 1e3 * texture, linewidth=0.5)
    panel.set(xlim=(0, len(texture) / sampling_rate), xlabel="time (s)", ylabel="lateral force (mN)", title="waveform")
    panel.grid(alpha=0.3)


def _draw_spectrum(panel, texture, sampling_rate, original=None):
    top = min(SPECTRUM_HZ[1], sampling_rate / 2)
    panel.axvspan(*BAND_HZ, alpha=0.12, linewidth=0, label=f"{BAND_HZ[0]:g}–{BAND_HZ[1]:g} Hz")
    highest = -np.inf
    for samples, style in ((original, {"linewidth": 2, **_ORIGINAL}), (texture, {"linewidth": 1})):
        if samples is not None:
            frequencies, density = power_spectral_density(samples, sampling_rate)
            shown = (frequencies >= SPECTRUM_HZ[0]) & (frequencies <= top)
            density_db = _decibels(density[shown])
            highest = max(highest, density_db.max())
            panel.semilogx(frequencies[shown], density_db, **style)
    panel.set(
        xlim=(SPECTRUM_HZ[0], top),
        ylim=(highest - 1.5 * DYNAMIC_RANGE_DB, highest + 5),
        xlabel="frequency (Hz)",
        ylabel="density (dB re 1 N²/Hz)",
        title="power spectral density",
    )
    panel.set_xticks([hertz for hertz in (20, 50, 100, 200, 500, 1000, 2000, 5000) if hertz <= top])
    panel.xaxis.set_major_formatter("{x:g}")
    panel.xaxis.set_minor_formatter("")
    panel.grid(which="both", alpha=0.3)
    panel.legend(loc="lower left", fontsize=9)


def _decibels(density):
    return 10 * np.log10(np.maximum(density, np.finfo(np.float64).tiny))


def draw_spectrogram(panel, texture, sampling_rate):
    """Draws the power spectral density over time, with its colour bar; `texture` is (samples,) in N."""
    from scipy.signal import spectrogram

    window = min(len(texture), round(0.05 * sampling_rate))  # 50 ms: bins of 20 Hz, the low edge of the band
    hop = max(window // 10, len(texture) // 2000)  # no more columns than can be seen
    # four times as many bins as the window resolves, to draw the lows smoothly
    frequencies, seconds, density = spectrogram(
        texture, fs=sampling_rate, nperseg=window, noverlap=window - hop, nfft=4 * window, window="hann"
    )
    shown = frequencies <= SPECTROGRAM_TOP_HZ
    density_db = _decibels(density[shown])
    highest = density_db.max()
    half_hop = hop / sampling_rate / 2
    image = panel.imshow(
        density_db,
        vmin=highest - DYNAMIC_RANGE_DB,
        vmax=highest,
        extent=(seconds[0] - half_hop, seconds[-1] + half_hop, 0, frequencies[shown][-1]),
        origin="lower",
        aspect="auto",
        interpolation="bilinear",
    )
    panel.set(xlim=(0, len(texture) / sampling_rate), xlabel="time (s)", ylabel="frequency (Hz)", title="spectrogram")
    panel.figure.colorbar(image, ax=panel, label="density (dB re 1 N²/Hz)")

"""Pictures of textures, as PNGs inside of HTML: no file, and no state that visitors could share."""

import base64
import io

import numpy as np

from tactile_diffusers.export.figure import DYNAMIC_RANGE_DB, draw_spectrogram, draw_waveform
from tactile_diffusers.signal import BAND_HZ, band_edges, band_levels_db, power_spectral_density

#: Pixels of the page per inch, and dots per pixel, for wide and fine screens; figures are up to 11 inches wide.
DPI, SHARPNESS = 80, 2
#: What is shown of spectra: Hz, and dB below the highest value.
SHOWN_HZ, SHOWN_DB = (15.0, 1300.0), 70.0
_TICKS_HZ = (20, 50, 100, 200, 500, 1000)
#: What the shaded ranges are, in the legend.
LIKELY = "these ratings, as DALE learned them: 10–90 %"
TRAINING = "all training surfaces, by mean and spread: 10–90 %"


def draw_result(result, take):
    """Waveform, spectrum, spectrogram and nine bands of one take: a matplotlib figure.

    Args:
        result ([`Result`]): of one row of ratings.
        take (`int`): which of its textures is drawn; the spectra of the others are thin lines.
    """
    texture = result.textures[take]
    height = 6.6
    figure = _figure(11, height)
    panels = figure.subplot_mosaic(
        [["waveform"] * 2, ["spectrum", "spectrogram"], ["bands"] * 2],
        height_ratios=(2, 3, 2),
        gridspec_kw=_margins(height, 0.2, 0.975),
    )
    draw_waveform(panels["waveform"], texture.samples, texture.sampling_rate)
    draw_spectrogram(panels["spectrogram"], texture.samples, texture.sampling_rate)
    ranges = {LIKELY: result.likely, TRAINING: result.training}
    ranges = {label: found for label, found in ranges.items() if found is not None}
    _draw_ranges(panels["spectrum"], ranges, density=True)
    _draw_ranges(panels["bands"], ranges, density=False)
    others = [other for number, other in enumerate(result.textures) if number != take]
    _draw_spectra(panels["spectrum"], [*others, texture], [None] * len(others) + ["this texture"])
    _draw_bands(panels["bands"], {"this texture": texture})
    panels["spectrum"].legend(fontsize=9, loc="lower left")
    return figure


def draw_comparison(textures):
    """Textures side by side, on the same scales, and their spectra and nine bands in one: a matplotlib figure.

    Args:
        textures (`dict[str, Texture]`): by name.
    """
    height = 7.5
    figure = _figure(11, height)
    count = len(textures)
    waveforms, spectrograms = [f"waveform {n}" for n in range(count)], [f"spectrogram {n}" for n in range(count)]
    halves = [["spectrum"] * count + ["bands"] * count]
    doubled = [[name for name in row for _ in range(2)] for row in (waveforms, spectrograms)]
    panels = figure.subplot_mosaic(doubled + halves, height_ratios=(2, 3, 3), gridspec_kw=_margins(height, 1.4, 0.94))
    top = 1.05e3 * max(np.abs(texture.samples).max() for texture in textures.values())
    for number, (name, texture) in enumerate(textures.items()):
        draw_waveform(panels[waveforms[number]], texture.samples, texture.sampling_rate)
        panels[waveforms[number]].set(ylim=(-top, top), title=name)
        draw_spectrogram(panels[spectrograms[number]], texture.samples, texture.sampling_rate)
        panels[spectrograms[number]].set_title("")
    images = [panels[name].images[0] for name in spectrograms]
    loudest = max(image.get_clim()[1] for image in images)
    for image in images:
        image.set_clim(loudest - DYNAMIC_RANGE_DB, loudest)
    for name in waveforms[1:] + spectrograms[1:]:
        panels[name].set_ylabel("")
    for image in images[:-1]:
        image.colorbar.set_label("")
    _draw_spectra(panels["spectrum"], list(textures.values()), list(textures), alike=True)
    _draw_bands(panels["bands"], textures)
    panels["spectrum"].legend(fontsize=9, loc="lower left")
    return figure


def figure_html(figure, description):
    """An `<img>` that holds the figure.

    Args:
        figure (`matplotlib.figure.Figure`): drawn here.
        description (`str`): for people who do not see it.
    """
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=SHARPNESS * DPI, pil_kwargs={"compress_level": 1})  # quick
    data = base64.b64encode(file.getvalue()).decode("ascii")
    width, height = (round(DPI * inches) for inches in figure.get_size_inches())  # room is kept while it is decoded
    size = f'width="{width}" height="{height}"'
    return f'<img class="texture-figure" {size} alt="{description}" src="data:image/png;base64,{data}">'


def _figure(width, height):
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    # without pyplot: its list of figures belongs to the whole process
    figure = Figure(figsize=(width, height))
    FigureCanvasAgg(figure)
    return figure


def _margins(height, wspace, right):
    """Fixed margins: a layout that measures every label takes longer than all the rest of an answer."""
    return {
        "left": 0.075,
        "right": right,
        "bottom": 0.5 / height,
        "top": 1 - 0.3 / height,
        "hspace": 0.55,
        "wspace": wspace,
    }


def _draw_spectra(panel, textures, names, alike=False):
    top = -np.inf
    for number, (texture, name) in enumerate(zip(textures, names, strict=True)):
        frequencies, density = power_spectral_density(texture.samples, texture.sampling_rate)
        shown = (frequencies >= SHOWN_HZ[0]) & (frequencies <= SHOWN_HZ[1])
        density_db = 10 * np.log10(np.maximum(density[shown], np.finfo(np.float64).tiny))
        style = {"color": f"C{number}" if alike else "C0", "linewidth": 1.2 if name else 0.4}
        panel.semilogx(frequencies[shown], density_db, label=name, **style)
        top = max(top, density_db.max())
    panel.set(xlim=SHOWN_HZ, ylim=(top - SHOWN_DB, top + 5), title="power spectral density")
    panel.set(xlabel="frequency (Hz)", ylabel="density (dB re 1 N²/Hz)")
    panel.set_xticks(_TICKS_HZ, [str(tick) for tick in _TICKS_HZ])
    panel.minorticks_off()
    panel.grid(alpha=0.3)


def _draw_bands(panel, textures):
    """Levels of the nine bands as steps over frequency."""
    edges = band_edges()
    for number, (name, texture) in enumerate(textures.items()):
        levels = band_levels_db(texture.samples, texture.sampling_rate)
        panel.stairs(levels, edges, baseline=None, label=name, color=f"C{number}", linewidth=1.8)
    panel.set(xscale="log", xlim=BAND_HZ, title="nine bands", xlabel="frequency (Hz)", ylabel="level (dB re 1 N²)")
    panel.set_xticks(edges, [f"{edge:.0f}" for edge in edges])
    panel.minorticks_off()
    panel.grid(alpha=0.3)


def _draw_ranges(panel, ranges, density):
    """Shades ranges of the nine bands, as levels or as the mean density within each band."""
    edges = band_edges()
    shift = 10 * np.log10(np.diff(edges)) if density else 0.0
    for colour, (label, found) in zip(("C1", "grey"), ranges.items(), strict=False):
        panel.stairs(
            found.high - shift, edges, baseline=found.low - shift, fill=True, alpha=0.25, color=colour, label=label
        )

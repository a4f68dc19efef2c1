"""What is behind a texture, as plots that the browser draws, and numbers; made when it is looked at."""

import html

import numpy as np
from settings import Settings

from tactile_diffusers.signal import BAND_HZ, band_edges, band_levels_db

#: Bands of the spectrum's plot, and points of the waveform's.
BANDS, POINTS = 18, 1200
USUAL = (10, 90)
_EDGES = band_edges(BANDS, BAND_HZ)
_CENTRES = [f"{np.sqrt(low * high):.0f}" for low, high in zip(_EDGES[:-1], _EDGES[1:], strict=True)]


def waveform(texture):
    """Table of the waveform in mN over s, thinned so that peaks stay."""
    import pandas as pd

    size = max(1, len(texture.samples) // (POINTS // 2))
    rows = texture.samples[: len(texture.samples) // size * size].reshape(-1, size)
    both = np.stack([rows.min(1), rows.max(1)], 1).ravel()
    return pd.DataFrame({"s": np.arange(len(both)) * size / 2 / texture.sampling_rate, "mN": 1e3 * both})


def spectrum(tracks, usual=None):
    """Table of levels in bands: of textures by name, and, of the first, what is usual: (takes, samples), Hz."""
    import pandas as pd

    rows = {name: band_levels_db(one.samples, one.sampling_rate, _EDGES) for name, one in tracks}
    if usual is not None:
        low, high = np.percentile(band_levels_db(*usual, _EDGES), USUAL, axis=0)
        rows |= {f"usual, {USUAL[0]} %": low, f"usual, {USUAL[1]} %": high}
    return pd.concat([pd.DataFrame({"Hz": _CENTRES, "dB re 1 N²": row, "of": name}) for name, row in rows.items()])


def numbers(scale, tracks, usual=None):
    """A table in HTML: asked, estimated and usual ratings, and what is measured, a row a texture."""
    heads = ["", *scale.axes, "RMS, mN", "friction coefficient", "seed", "checkpoint"]
    rows = []
    for name, one in tracks:
        about = [f"{1e3 * one.rms:.2f}", _known(one.friction_coefficient), one.seed, one.checkpoint]
        if np.isfinite(one.ratings).any():
            rows.append([f"{name}: asked", *_shown(scale, one.ratings)])
        rows.append([f"{name}: estimated", *_shown(scale, one.estimated), *("–" if x is None else x for x in about)])
    if usual is not None:
        low, high = (_shown(scale, row) for row in np.percentile(usual, USUAL, axis=0))
        rows.append(["usual for what is asked", *(f"{a} to {b}" for a, b in zip(low, high, strict=True))])
    body = "".join("<tr>" + "".join(f"<td>{html.escape(str(cell))}</td>" for cell in row) + "</tr>" for row in rows)
    head = "".join(f'<th scope="col">{cell}</th>' for cell in heads)
    caption = "<caption>Ratings are percentiles of the training surfaces.</caption>"
    return f'<table class="numbers">{caption}<tr>{head}</tr>{body}</table>'


def _shown(scale, ratings):
    return ["–" if value is None else f"{value:g}" for value in scale.from_z(ratings)]


def _known(value):
    return f"{value:.2f}" if np.isfinite(value) else "–"


def spectrum_plot(gr):
    """A plot for `spectrum`."""
    return gr.LinePlot(x="Hz", y="dB re 1 N²", color="of", title="spectrum", height=240, sort=_CENTRES)


def analysis(desk):
    """The folded part of Make: it is computed while it is open, whenever another texture lies on the strip."""
    gr, studio = desk.gr, desk.studio
    seen, clock = gr.State(), gr.Timer(0.7, active=False)
    with gr.Accordion("Analysis", open=False, elem_id="analysis") as fold:
        table = gr.HTML(elem_id="numbers")
        with gr.Row():
            wave = gr.LinePlot(x="s", y="mN", title="waveform", height=240, label="waveform", show_label=False)
            bands = spectrum_plot(gr)

    def look(made, before):
        """The plots, unless they are of this texture already."""
        if not made or made[0] == before:
            return (gr.skip(),) * 4
        now, texture = made
        tracks = [("this texture", texture)]
        heard, *expected = studio.usual(texture.ratings, Settings(), texture.checkpoint)
        return now, numbers(studio.scale, tracks, heard), waveform(texture), spectrum(tracks, expected)

    inputs, outputs = [desk.made, seen], [seen, table, wave, bands]
    desk.on([clock.tick, fold.expand], look, inputs, outputs, trigger_mode="once")
    desk.on([fold.expand], lambda: gr.Timer(active=True), None, clock)
    desk.on([fold.collapse], lambda: gr.Timer(active=False), None, clock)

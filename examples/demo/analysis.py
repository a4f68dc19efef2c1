"""What is behind a texture, as plots that the browser draws, and numbers; made when it is looked at."""

import html

import numpy as np

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

    def shown(ratings):
        return ["–" if value is None else f"{value:g}" for value in scale.from_z(ratings)]

    rows = [["", *scale.axes, "RMS, mN", "friction coefficient", "seed", "checkpoint"]]
    for name, one in tracks:
        friction = f"{one.friction_coefficient:.2f}" if np.isfinite(one.friction_coefficient) else None
        about = [f"{1e3 * one.rms:.2f}", friction, one.seed, one.checkpoint]
        if np.isfinite(one.ratings).any():
            rows.append([f"{name}: asked", *shown(one.ratings)])
        rows.append([f"{name}: estimated", *shown(one.estimated), *("–" if x is None else x for x in about)])
    if usual is not None:
        low, high = (shown(row) for row in np.percentile(usual, USUAL, axis=0))
        rows.append(["usual for what is asked", *(f"{a} to {b}" for a, b in zip(low, high, strict=True))])
    head, *body = ("".join(f"<td>{html.escape(str(cell))}</td>" for cell in row) for row in rows)
    head = head.replace("<td>", '<th scope="col">').replace("</td>", "</th>")
    caption = "<caption>Ratings are percentiles of the training surfaces.</caption>"
    return f'<table class="numbers">{caption}{"".join(f"<tr>{row}</tr>" for row in (head, *body))}</table>'


def spectrum_plot(gr):
    """A plot for `spectrum`."""
    return gr.LinePlot(x="Hz", y="dB re 1 N²", color="of", title="spectrum", height=240, sort=_CENTRES)


def analysis(desk, status):
    """What is known of the texture of Make, once nothing moves: a line of estimates, and, unfolded, plots."""
    gr, studio = desk.gr, desk.studio
    seen, unfolded = gr.State(), gr.State(False)
    with gr.Accordion("Analysis", open=False, elem_id="analysis") as fold:
        table = gr.HTML(elem_id="numbers")
        with gr.Row():
            wave = gr.LinePlot(x="s", y="mN", title="waveform", height=240, label="waveform", show_label=False)
            bands = spectrum_plot(gr)

    def look(made, before, unfolded, shown=None):
        if not made or ((made[0], unfolded) == before and shown != made[2]):  # known already
            return (gr.skip(),) * 5
        entry, texture, told = made
        head, _, note = told.partition("<br>")
        told = f"{head} · estimated to feel: {studio.scale.describe(texture.estimated)}<br>{note}"
        if shown not in (None, made[2]):  # what was refused since, or told already
            told = gr.skip()
        if not unfolded:
            return (entry, False), told, *(gr.skip(),) * 3
        tracks = [("this texture", texture)]
        *_, guidance, _duration_s, _steps, _checkpoint = entry
        heard, *expected = studio.usual(texture.ratings, guidance, texture.checkpoint)
        plots = numbers(studio.scale, tracks, heard), waveform(texture), spectrum(tracks, expected)
        return (entry, True), told, *plots

    outputs = [seen, status, table, wave, bands]
    desk.on([desk.strip.input], look, [desk.made, seen, unfolded, status], outputs)
    desk.on([fold.expand], lambda made: (True, *look(made, None, True)), desk.made, [unfolded, *outputs])
    desk.on([fold.collapse], lambda: False, None, unfolded)

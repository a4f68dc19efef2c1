"""Your surfaces: what an adapted checkpoint makes of the ratings of Make, beside the page's own."""

from analysis import numbers, spectrum, spectrum_plot
from settings import Settings

HOW = """No adapted checkpoint is open. Three commands make one of a folder of your recordings, see *Your own
surfaces* in the README; then start the page with

    python examples/demo/app.py --surfaces adapted

Several folders may follow. They appear here, and in *Make* under *More*."""


def surfaces_tab(desk, tab):
    """The tab."""
    gr, studio = desk.gr, desk.studio
    others = list(studio.checkpoints)[1:]
    if not others:
        gr.Markdown(HOW, elem_id="surfaces-how")
        return
    own = desk.own_tracks(tab)
    with gr.Row():
        with gr.Column(scale=1, min_width=240):
            chosen = gr.Radio(others, value=others[0], label="Adapted checkpoint", elem_id="adapted")
            gr.Markdown("Both make the ratings of *Make*, with its seed and settings: compare them on the strip.")
        with gr.Column(scale=3, min_width=300):
            table = gr.HTML(elem_id="surfaces-numbers")
            plot = spectrum_plot(gr)

    def compare(name, made):
        if not made:
            return (gr.skip(),) * 5
        settings, _ = Settings.of_make(made)
        tracks = [(each, studio.generate(made[1].ratings, settings, each)) for each in (studio.own, name)]
        return *desk.put(tracks), tracks, numbers(studio.scale, tracks), spectrum(tracks)

    desk.on([tab.select, chosen.input], compare, [chosen, desk.made], [desk.strip, desk.shown, own, table, plot])

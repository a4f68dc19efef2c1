"""Blend: two textures and what lies between, from the same noise, under one finger."""

from analysis import numbers
from settings import Settings, blend

from tactile_diffusers.pipelines import PRESETS
from tactile_diffusers.signal.checks import check_number

ENDS = {"A": "glass", "B": "denim"}


def blend_tab(desk, tab):
    """The tab."""
    gr, studio, scale = desk.gr, desk.studio, desk.studio.scale
    own, ends = desk.own_tracks(tab), []
    with gr.Row():
        for end, name in ENDS.items():
            with gr.Column(min_width=220):
                chosen = gr.Dropdown(list(PRESETS), value=name, label=f"{end}: a preset", elem_id=f"blend-{end}")
                keep = gr.Button(f"Take the texture of Make as {end}", elem_id=f"keep-{end}", size="sm")
                state = gr.State(scale.preset(name))
                ends.append((chosen, keep, gr.Markdown(scale.describe(state.value)), state))
        with gr.Column(min_width=260):
            share = gr.Slider(0, 100, 50, step=1, label="Blend, % of B", elem_id="share")
            gr.Markdown("All three lie on the strip. *Export* writes whichever you choose.")
    table = gr.HTML(elem_id="blend-numbers")

    def show(first, second, first_name, second_name, percent, made):
        check_number("blend", percent, "%", at_least=0, at_most=100)
        how = Settings.of_make(made)
        rows = {f"A: {first_name or 'of Make'}": first, f"{percent:g} % of B": blend(first, second, percent / 100)}
        rows[f"B: {second_name or 'of Make'}"] = second
        tracks = [(name, studio.generate(row, *how)) for name, row in rows.items()]
        return *desk.put(tracks), tracks, numbers(scale, tracks)

    def from_make(made):
        if not made:
            raise ValueError("There is no texture in Make yet.")
        return made[1].ratings, scale.describe(made[1].ratings), None

    def from_preset(name):
        return scale.preset(name), scale.describe(scale.preset(name))

    inputs = [*(end[-1] for end in ends), *(end[0] for end in ends), share, desk.made]
    outputs = [desk.strip, desk.shown, own, table]
    for chosen, keep, label, state in ends:
        desk.on([keep.click], from_make, desk.made, [state, label, chosen])
        desk.on([chosen.input], from_preset, chosen, [state, label])
        desk.on([state.change], show, inputs, outputs)
    desk.on([share.input, tab.select], show, inputs, outputs)

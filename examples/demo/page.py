"""The page: the strip on top, and the tabs, which play on it. What is computed lies in the modules beside it."""

import functools

from blend_tab import blend_tab
from edit_tab import edit_tab
from export_tab import export_tab
from find_tab import find_tab
from make_tab import make_tab
from strip import PARTS, strip_value
from surfaces_tab import surfaces_tab

CSS = """
footer { display: none !important; }
gradio-app { display: block !important; }
.gradio-container { padding: 0 !important; width: 100% !important; min-width: 0 !important; }
.gradio-container { overflow: visible !important; }
.gradio-container .main { padding: 8px 24px !important; max-width: 1500px; margin: auto; }
#top { position: sticky; top: 0; z-index: 60; background: var(--body-background-fill); padding: 4px 0; gap: 4px; }
#title small { font-size: 14px; }
#title h1 { font-size: 1.15rem; display: inline; margin-right: 12px; }
:is(.min_value, .max_value, .or) { color: var(--body-text-color) !important; }
#status { min-height: 48px; }
.axis .form { flex-wrap: nowrap; }
.axis .form > :last-child { align-content: center; }
 .axis .form > .block { padding: 8px 10px; min-width: 0 !important; }
.axis .form > :first-child { flex: 1 1 auto; } .axis .form > :last-child { flex: 0 0 112px; }
#presets .wrap { display: grid; grid-template-columns: repeat(auto-fill, minmax(112px, 1fr)); gap: 6px; }
:is(#presets, #takes) label { padding: 6px; justify-content: center; min-width: 34px; }
:is(#presets, #takes) label span { margin: 0; }
:is(#presets, #takes) input { position: absolute; opacity: 0; pointer-events: none; }
:is(#presets, #takes) label:has(:focus-visible) { outline: 3px solid #d9480f; }
:is(#presets, #takes) label.selected { background: #1d4ed8; color: white; border-color: #1d4ed8; }
:is(button, input, a, [tabindex]):focus-visible { outline: 3px solid #d9480f !important; outline-offset: 1px; }
.pad { position: relative; height: 268px; border: 1px solid var(--border-color-primary); border-radius: 8px;
  cursor: crosshair; touch-action: none; background: linear-gradient(45deg, #93c5fd55, #fdba7455); }
.pad span { position: absolute; pointer-events: none; color: var(--body-text-color); font-size: 14px; }
.pad .dot { width: 26px; height: 26px; margin: 0 0 -13px -13px; border: 3px solid #d9480f; background: #d9480f55;
  border-radius: 50%; left: 50%; bottom: 50%; }
#edit-wave :is(canvas, svg) { touch-action: pan-y !important; }
.pad .left { left: 8px; top: 46%; } .pad .right { right: 8px; top: 46%; }
.pad :is(.bottom, .top) { left: 0; right: 0; text-align: center; } .pad .bottom { bottom: 6px; } .pad .top { top: 6px; }
div:has(> table.numbers) { overflow-x: auto; } table.numbers caption { text-align: left; }
:is(table.numbers, #lost table) { border-collapse: collapse; border: 0 !important; text-align: left; }
:is(table.numbers, #lost table) :is(tr, th, td) { padding: 2px 14px 2px 0 !important; border: 0 !important; }
:is(table.numbers, #lost table) tr { border-bottom: 1px solid var(--border-color-primary) !important; }
.bar { height: 10px; border-radius: 5px; background: var(--border-color-primary); }
.bar div { height: 100%; border-radius: 5px; background: #1d4ed8; }
@media (max-width: 640px) {
  .pad { height: 200px; } #title small { display: none; } .gradio-container .main { padding: 4px 10px !important; }
}
"""
TITLE = """<h1>Tactile textures</h1><small>Say how a surface should feel, then drag the finger over it.
What you hear is the friction force.</small>"""


class Desk:
    """What all tabs share: gradio, the studio, the strip, what lies on it, and a folder for files to take away."""

    hidden = {"show_progress": "hidden", "api_visibility": "private"}

    def __init__(self, gr, studio, folder):
        self.gr, self.studio, self.folder, self.nothing = gr, studio, folder, (gr.skip(), gr.skip())
        self.shown = gr.State([])  # [(name, Texture)] on the strip
        self.made = gr.State()  # the snapshot and the texture of Make, and a line about it
        markup, script = PARTS["main"], PARTS["script"]
        self.strip = gr.HTML(None, html_template=markup, js_on_load=script, elem_id="strip", apply_default_css=False)

    def put(self, tracks, link=None):
        """Values for `strip` and `shown`."""
        return strip_value(tracks, link), list(tracks)

    def answer(self, function):
        """The function with its `ValueError`s, which are meant for whoever asked, shown on the page."""

        @functools.wraps(function)
        def answer(*arguments):
            try:
                return function(*arguments)
            except ValueError as error:
                raise self.gr.Error(str(error), print_exception=False) from error

        return answer

    def on(self, triggers, function, inputs, outputs, last=True, **options):
        """An event; of many in a row the last one counts, and none overtakes another."""
        options = {"trigger_mode": "always_last" if last else "once", **self.hidden, **options}
        return self.gr.on(triggers, self.answer(function), inputs, outputs, **options)

    def own_tracks(self, tab):
        """A state of a tab: what lies on the strip whenever the tab is chosen."""
        tracks = self.gr.State([])
        self.on([tab.select], lambda own: self.put(own) if own else self.nothing, tracks, [self.strip, self.shown])
        return tracks


def build(studio, folder, **options):
    """The page, not yet served: `gradio.Blocks`, which take the options. Files to take away go into the folder."""
    import gradio as gr

    for component in (gr.Slider, gr.Number):  # our checks name the axis; gradio's do not, and print a traceback
        component.preprocess = lambda self, payload: payload
    with gr.Blocks(title="Tactile textures from ratings", analytics_enabled=False, fill_width=True, **options) as page:
        with gr.Column(elem_id="top"):
            gr.HTML(TITLE, padding=False, elem_id="title")
            desk = Desk(gr, studio, folder)
        with gr.Tabs() as tabs:
            with gr.Tab("Make", id="make") as tab:
                make = make_tab(desk, tab, page)
            with gr.Tab("Edit") as tab:
                edit_tab(desk, tab)
            with gr.Tab("Find") as tab:
                find_tab(desk, tab, tabs, make)
            with gr.Tab("Blend") as tab:
                blend_tab(desk, tab)
            with gr.Tab("Your surfaces") as tab:
                surfaces_tab(desk, tab)
            with gr.Tab("Export") as tab:
                export_tab(desk, tab)
    return page

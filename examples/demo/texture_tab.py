"""The page's first tab: ratings to a texture, what is known of it, and files of it."""

import functools
import html
import tempfile
from pathlib import Path
from types import SimpleNamespace

from answers import texture_answer
from controls import agree, follow_scale, make_controls, read_ratings, set_preset, show_errors
from downloads import FORMATS, is_map, write_files
from settings import Settings

from tactile_diffusers.export.png import PIXEL_PITCH
from tactile_diffusers.signal import RATING_AXES

_EARLIER = "What is shown, and written to files, is the earlier texture."
#: On a narrow page, results lie below all sliders: who presses the button is brought to them.
_SHOW_RESULTS = """() => {
    const place = document.querySelector("#picture").closest(".column");
    const { top, bottom } = place.getBoundingClientRect();
    if (top > 0.4 * innerHeight || bottom < 0.4 * innerHeight) place.scrollIntoView({ behavior: "smooth" });
}"""


def _result_area(gr):
    """Where the texture is shown and written: components by name."""
    status = gr.HTML(elem_id="status", padding=False)
    picture = gr.HTML(elem_id="picture")
    with gr.Row():
        with gr.Column(scale=2, min_width=280):
            take = gr.Dropdown([("take 1", 0)], value=0, label="Take shown", elem_id="take")
            sound = gr.HTML(elem_id="sound")
        with gr.Column(scale=3, min_width=320):
            numbers = gr.HTML(elem_id="numbers")
    strip = gr.HTML(elem_id="strip", label="Finger strip")
    with gr.Row():
        name = gr.Dropdown(list(FORMATS), value=next(iter(FORMATS)), label="Format", elem_id="format", scale=3)
        pitch = gr.Number(
            PIXEL_PITCH,
            label="Pixel pitch, mm",
            info="of the display: its width / its pixels across",
            visible=False,
            elem_id="pitch",
            scale=1,
        )
        write = gr.Button("Write the file", elem_id="write", scale=1)
    files = gr.File(label="Files", file_count="multiple", interactive=False, visible=False, elem_id="files")
    warned = gr.HTML(elem_id="warned")
    return SimpleNamespace(
        status=status, picture=picture, take=take, sound=sound, numbers=numbers, strip=strip, name=name, pitch=pitch,
        write=write, files=files, warned=warned,
    )  # fmt: skip


def texture_tab(gr, studio, folder, page):
    """The tab; returns the controls that others read, and the buttons that keep ratings for the blend."""
    result = gr.State()
    with gr.Row():
        with gr.Column(scale=2, min_width=300):
            asked = make_controls(gr, studio)
            make = gr.Button("Make the texture", variant="primary", elem_id="make")
            with gr.Row():
                keep_buttons = [gr.Button(f"Keep as {name}", size="sm", min_width=100) for name in "AB"]
        with gr.Column(scale=5, min_width=480):
            shown = _result_area(gr)

    def generate(scale, *values):
        ratings, settings = _read(studio, scale, values)
        made = studio.generate([ratings], settings)
        takes = gr.Dropdown([(f"take {number + 1}", number) for number in range(len(made.textures))], value=0)
        return made, takes

    def show(made, number, scale):
        return texture_answer(made, number, scale, studio.config) if made else (gr.skip(),) * 4

    def download(made, number, chosen, millimetres):
        if made is None:
            raise ValueError("There is no texture yet: make one first.")
        # a folder of its own, with a name that cannot be guessed
        own = Path(tempfile.mkdtemp(dir=folder))
        written, warnings = write_files(made.textures[number], chosen, own, millimetres)
        paragraphs = (f"<p>{html.escape(text)}</p>" for text in warnings)
        return gr.File([str(path) for path in written], visible=True), "".join(paragraphs)

    hidden = {"api_visibility": "private", "show_progress": "hidden"}
    inputs = [asked["scale"], *asked["ratings"], *asked["open"], *asked["settings"]]
    request = {"fn": show_errors(gr, generate), "inputs": inputs, "outputs": [result, shown.take]}
    request |= {"api_visibility": "private", "show_progress": "minimal"}
    request |= {"show_progress_on": shown.picture, "trigger_mode": "always_last"}
    # shown by an event of its own, on the scale of that moment: it may change while a texture is made
    show_again = {"fn": show_errors(gr, show), "inputs": [result, shown.take, asked["scale"]]}
    show_again["outputs"] = [shown.picture, shown.sound, shown.numbers, shown.strip]
    show_again |= {"api_visibility": "private", "show_progress": "minimal", "trigger_mode": "always_last"}
    # whether what is shown is what is asked: after every answer, and whenever a control has moved
    compare = {"fn": functools.partial(_compare, studio), "inputs": [result, *inputs]}
    compare |= {"outputs": shown.status, "trigger_mode": "always_last", **hidden}

    def answered(event):
        event.then(**compare)
        return event.then(**show_again)

    controls = [*asked["ratings"], *asked["open"]]
    moved = [control.input for control in controls]
    answered(gr.on([make.click, page.load, *moved], **request))
    make.click(None, js=_SHOW_RESULTS)
    gr.on(moved, None, js="() => null", outputs=asked["preset"])  # they are the preset's no more
    gr.on([control.change for control in (*controls, *asked["settings"])], **compare)
    preset, named = functools.partial(set_preset, gr, studio), [asked["preset"], asked["scale"]]
    chosen = asked["preset"].input(preset, named, controls, api_visibility="private")
    answered(chosen.then(**request))
    shown.take.input(**show_again)
    answered(follow_scale(gr, studio, asked))
    shown.name.input(lambda chosen: gr.Number(visible=is_map(chosen)), shown.name, shown.pitch, **hidden)
    asked_for = [result, shown.take, shown.name, shown.pitch]
    shown.write.click(show_errors(gr, download), asked_for, [shown.files, shown.warned], api_visibility="private")
    return asked, keep_buttons


def _read(studio, scale, values):
    """Ratings in z-scores and settings, of all the controls' values."""
    count = 2 * len(RATING_AXES)
    return read_ratings(studio, scale, values[:count]), Settings(*values[count:])


def _compare(studio, made, scale, *values):
    """What the page says if what is shown is not what the controls ask for, as HTML; else nothing."""
    try:
        ratings, settings = _read(studio, scale, values)
    except ValueError as error:
        told = f"<strong>Not made:</strong> {html.escape(str(error))}"
    else:
        if made is None or (
            settings == made.settings and agree(ratings, made.textures[0].ratings, scale, studio.config)
        ):
            return ""
        told = "Ratings or settings have changed since: <em>Make the texture</em>."
    return f'<p role="status">{told} {_EARLIER if made else ""}</p>'

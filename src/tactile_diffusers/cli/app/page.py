"""The page: what stands where, and what calls what. All that is computed lies in the modules beside it."""

import functools
import tempfile
from pathlib import Path

from ...signal import RATING_AXES
from .answers import comparison_answer, reconstruction_answer, texture_answer
from .downloads import FORMATS, write_files
from .presets import PRESETS, REMARK
from .recording import LONGEST_SECONDS, read_upload
from .settings import (
    LIMITS,
    SCALES,
    WORDS,
    Settings,
    available_scales,
    blend,
    describe,
    digits,
    from_z,
    slider_ranges,
    to_z,
)

CSS = """
#picture { min-height: 400px; } /* nothing jumps when they arrive */
#strip { min-height: 360px; }
.texture-figure { width: 100%; height: auto; background: white; border-radius: 4px; }
.ends { background: var(--block-background-fill) !important; }
.ends .words { display: flex; justify-content: space-between; font-size: 0.9em; padding: 0 8px; }
.players { display: flex; flex-wrap: wrap; gap: 12px; }
.players figure { margin: 0; }
audio { max-width: 100%; }
.prose table.numbers { border-collapse: collapse; border: 0 !important; margin: 0; }
.prose table.numbers :is(th, td) { padding: 2px 16px 2px 0; text-align: left; border: 0 !important; }
.prose table.numbers tr { border: 0 !important; border-bottom: 1px solid #8886 !important; }
"""
ABOUT = """# Tactile textures from ratings
Say how rough, bumpy and slippery a surface should feel; get the friction force of a sliding finger, in newtons at
10 kHz. Nothing leaves the computer that runs this page. The bundled checkpoint knows simulated surfaces only."""


def build(studio, folder):
    """The page, not yet served.

    Args:
        studio ([`Studio`]): answers.
        folder (`Path`): gradio's folder of temporary files; for files to take away.

    Returns:
        `gradio.Blocks`
    """
    import gradio as gr

    with gr.Blocks(title="Tactile textures from ratings", analytics_enabled=False, fill_width=True) as page:
        gr.Markdown(ABOUT)
        kept = [gr.State(("glass", PRESETS["glass"])), gr.State(("denim", PRESETS["denim"]))]
        with gr.Tab("Texture"):
            asked, keep_buttons = _texture_tab(gr, studio, folder, page)
        with gr.Tab("Two textures and a blend"):
            labels = _blend_tab(gr, studio, kept, asked)
        with gr.Tab("Your recording"):
            _recording_tab(gr, studio, asked)
        for number, button in enumerate(keep_buttons):
            button.click(
                _said(gr, functools.partial(_keep, studio, "AB"[number])),
                [asked["scale"], *asked["ratings"], *asked["open"]],
                [kept[number], labels[number]],
                api_visibility="private",
            )
    return page


def _said(gr, function):
    """The function with its `ValueError`s, which are meant for whoever asked, shown on the page."""

    @functools.wraps(function)
    def wrapped(*arguments):
        try:
            return function(*arguments)
        except ValueError as error:
            raise gr.Error(str(error), print_exception=False) from error

    return wrapped


def _ratings(studio, scale, values):
    """Ratings in z-scores of three values and three switches."""
    count = len(RATING_AXES)
    given = [None if left_open else value for value, left_open in zip(values[:count], values[count:], strict=True)]
    return to_z(given, scale, studio.config)


def _keep(studio, name, scale, *values):
    ratings = _ratings(studio, scale, values)
    return (name, ratings), _label(studio, name, "kept", ratings)


def _label(studio, name, origin, ratings):
    return f"**{name}** ({origin}): {describe(ratings, 'z', studio.config)} (z-scores)"


def _texture_tab(gr, studio, folder, page):
    """The first tab; returns the controls that others read, and the buttons that keep ratings for the blend."""
    result = gr.State()
    with gr.Row():
        with gr.Column(scale=2, min_width=300):
            asked = _controls(gr, studio)
            make = gr.Button("Make the texture", variant="primary", elem_id="make")
            with gr.Row():
                keep_buttons = [gr.Button(f"Keep as {name}", size="sm", min_width=100) for name in "AB"]
        with gr.Column(scale=5, min_width=480):
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
                write = gr.Button("Write the file", elem_id="write", scale=1)
            files = gr.File(label="Files", file_count="multiple", interactive=False, visible=False, elem_id="files")

    def generate(scale, *values):
        count = 2 * len(RATING_AXES)
        made = studio.generate([_ratings(studio, scale, values[:count])], Settings(*values[count:]))
        takes = gr.Dropdown([(f"take {number + 1}", number) for number in range(len(made.textures))], value=0)
        return made, takes

    def show(made, number, scale):
        return texture_answer(made, number, scale, studio.config) if made else (gr.skip(),) * 4

    def download(made, number, chosen):
        if made is None:
            raise ValueError("There is no texture yet: make one first.")
        return gr.File(_write(made.textures[number], chosen, folder), visible=True)

    shown = [picture, sound, numbers, strip]
    inputs = [asked["scale"], *asked["ratings"], *asked["open"], *asked["settings"]]
    request = {"fn": _said(gr, generate), "inputs": inputs, "outputs": [result, take]}
    request |= {"api_visibility": "private", "show_progress": "minimal", "trigger_mode": "always_last"}
    # shown by an event of its own, on the scale of that moment: it may change while a texture is made
    show_again = {"fn": _said(gr, show), "inputs": [result, take, asked["scale"]], "outputs": shown}
    show_again |= {"api_visibility": "private", "show_progress": "minimal"}
    moved = [control.input for control in (*asked["ratings"], *asked["open"])]
    gr.on([make.click, page.load, *moved], **request).then(**show_again)
    asked["preset"].input(
        functools.partial(_preset, gr, studio),
        [asked["preset"], asked["scale"]],
        [*asked["ratings"], *asked["open"]],
        api_visibility="private",
    ).then(**request).then(**show_again)
    take.input(**show_again)
    _follow_scale(gr, studio, asked).then(**show_again)
    write.click(_said(gr, download), [result, take, name], files, api_visibility="private")
    return asked, keep_buttons


def _controls(gr, studio):
    """Ratings and how textures are made: `preset`, `scale`, `ratings`, `open`, `settings`."""
    scales = available_scales(studio.config)
    preset = gr.Dropdown(list(PRESETS), value="denim", label="Preset ratings", info=REMARK, elem_id="preset")
    scale = gr.Radio([(SCALES[name], name) for name in scales], value=scales[0], label="Ratings as", elem_id="scale")
    ratings, left_open = [], []
    starts = from_z(PRESETS["denim"], scales[0], studio.config)
    ends = slider_ranges(scales[0], studio.config)
    for axis, value, (low, high) in zip(RATING_AXES, starts, ends, strict=True):
        with gr.Group():
            value, step = _rounded(value, low, high, scales[0]), _step(scales[0])
            ratings.append(gr.Slider(low, high, value, step=step, label=axis.capitalize(), elem_id=axis))
            words = '<div class="words"><span>{}</span><span>{}</span></div>'.format(*WORDS[axis])
            gr.HTML(words, elem_classes="ends", padding=False)
            left_open.append(gr.Checkbox(label=f"{axis} unspecified", elem_id=f"{axis}-open"))
    default = Settings()
    with gr.Accordion("How it is made", open=False):
        few = studio.distilled_steps
        info = f"up to {few}: the distilled decoder" if few else None
        settings = [
            gr.Slider(*LIMITS["steps"], default.steps, step=1, label="Steps of the decoder (LCTG)", info=info),
            gr.Slider(*LIMITS["latent_steps"], default.latent_steps, step=1, label="Steps of DALE"),
            gr.Radio(
                [1, 2], value=default.order, label="Order of the solver", info="a distilled decoder keeps its own"
            ),
            gr.Slider(*LIMITS["guidance"], default.guidance, step=0.05, label="Guidance", info="1 = off"),
            gr.Number(default.seed, label="Seed", precision=0, minimum=LIMITS["seed"][0], maximum=LIMITS["seed"][1]),
            gr.Slider(*LIMITS["duration_s"], default.duration_s, step=0.1, label="Duration, s"),
            gr.Slider(*LIMITS["takes"], default.takes, step=1, label="Takes"),
        ]
    return {"preset": preset, "scale": scale, "ratings": ratings, "open": left_open, "settings": settings}


def _step(scale):
    return 10 ** -digits(scale)


def _rounded(value, low, high, scale):
    """A value where a slider can stand."""
    return round(float(min(max(value, low), high)), digits(scale))


def _preset(gr, studio, name, scale):
    """Sliders and switches of a preset; a slider whose axis it leaves open stays where it is."""
    if name not in PRESETS:
        raise gr.Error(f"There is no preset {name!r}.", print_exception=False)
    given = PRESETS[name]
    ratings = from_z([0.0 if value is None else value for value in given], scale, studio.config)
    ends = slider_ranges(scale, studio.config)
    within = [_rounded(value, *end, scale) for value, end in zip(ratings, ends, strict=True)]
    sliders = [gr.skip() if z is None else value for z, value in zip(given, within, strict=True)]
    return *sliders, *(value is None for value in given)


def _follow_scale(gr, studio, asked):
    """Another scale shows the same ratings as other numbers, nothing is made anew; returns the event."""
    before = gr.State(asked["scale"].value)

    def change(old, new, *values):
        ratings = from_z(to_z(values, old, studio.config), new, studio.config)
        ends = slider_ranges(new, studio.config)
        sliders = [
            gr.Slider(low, high, _rounded(value, low, high, new), step=_step(new))
            for value, (low, high) in zip(ratings, ends, strict=True)
        ]
        return new, *sliders

    sliders = asked["ratings"]
    return asked["scale"].input(
        _said(gr, change), [before, asked["scale"], *sliders], [before, *sliders], api_visibility="private"
    )


def _write(texture, name, folder):
    """Files of a texture, in a new folder with a name that cannot be guessed: paths."""
    return [str(path) for path in write_files(texture, name, Path(tempfile.mkdtemp(dir=folder)))]


def _blend_tab(gr, studio, kept, asked):
    """Two ratings and what lies between; returns where they are described."""
    gr.Markdown(
        "The blend is generated from ratings between those of A and B, interpolated in z-scores; all three come from "
        "the same noise (seed). An axis that A or B leaves open is open between them. *Keep as A* and *Keep as B* on "
        "the first tab put other ratings here."
    )
    with gr.Row():
        labels = [gr.Markdown(_label(studio, n, *state.value)) for n, state in zip("AB", kept, strict=True)]
    with gr.Row():
        share = gr.Slider(0, 100, 50, step=5, label="Blend: % of the way from A to B", elem_id="share")
        make = gr.Button("Make A, blend and B", variant="primary", elem_id="make-blend")
    picture, sound, numbers = gr.HTML(elem_id="blend-picture"), gr.HTML(), gr.HTML()

    def generate(first, second, percent, scale, *values):
        first, second = (tuple(to_z(ratings, "z", studio.config)) for _, ratings in (first, second))
        rows = [first, blend(first, second, percent / 100), second]
        *how, _ = values
        made = studio.generate(rows, Settings(*how, takes=1))
        return comparison_answer(made, ("A", f"blend {percent:g} %", "B"), scale, studio.config)

    gr.on(
        [make.click, share.input],
        _said(gr, generate),
        [*kept, share, asked["scale"], *asked["settings"]],
        [picture, sound, numbers],
        api_visibility="private",
        show_progress="minimal",
        trigger_mode="always_last",
    )
    return labels


def _recording_tab(gr, studio, asked):
    gr.Markdown(
        "A WAV file, or a CSV with lateral force in one column or time (s) and lateral force in the first two. The "
        f"first {LONGEST_SECONDS:g} s are band-passed, encoded, decoded and compared; steps and order are those of the "
        "first tab."
    )
    with gr.Row():
        # bytes: no path of a visitor reaches a line of ours
        upload = gr.File(label="Recording (.csv, .wav)", file_types=[".csv", ".wav"], type="binary", elem_id="upload")
        with gr.Column():
            rate = gr.Number(10_000, label="Sampling rate, Hz", info="of a CSV file with one column")
            newtons = gr.Number(1.0, label="Newtons per unit", info="1 = the file holds newtons; WAV: per full scale")
            make = gr.Button("Reconstruct and compare", variant="primary", elem_id="reconstruct")
    picture, sound, numbers = gr.HTML(elem_id="recording-picture"), gr.HTML(), gr.HTML(elem_id="recording-numbers")

    def reconstruct(content, csv_rate, newtons_per_unit, scale, *values):
        if not content:
            raise ValueError("Choose a file first.")
        samples, sampling_rate = read_upload(content, csv_rate or 0, newtons_per_unit or 0)
        made = studio.reconstruct(samples, sampling_rate, Settings(*values))
        return reconstruction_answer(made, scale, studio.config)

    make.click(
        _said(gr, reconstruct),
        [upload, rate, newtons, asked["scale"], *asked["settings"]],
        [picture, sound, numbers],
        api_visibility="private",
        show_progress="minimal",
    )

"""The tab that edits: a recording, or the texture of the first tab, by ratings; or stretches of it made anew."""

import functools
import html

from answers import edit_answer
from controls import read_ratings
from settings import Settings
from uploads import LONGEST_SECONDS, read_upload

from tactile_diffusers.signal.checks import check_number

#: What can be done, and the arguments of `TactileTextureEditPipeline` that ask for it.
ACTIONS = {
    "change its ratings": lambda deltas, strength, start, stop: {
        "ratings": {axis: delta for axis, delta in deltas.items() if delta} or None,
        "rating_scale": "difference",
        "strength": strength,
    },
    "make a stretch anew": lambda deltas, strength, start, stop: {"mask": [(start, stop)]},
    "make it 1 s longer": lambda deltas, strength, start, stop: {"continue_s": 1.0},
    "close it to a loop": lambda deltas, strength, start, stop: {"loop": True},
    "another take of it": lambda deltas, strength, start, stop: {"strength": 0.95},
}


def edit_tab(gr, studio, asked):
    """Builds the tab; `asked` holds the ratings and settings of the first one."""
    gr.Markdown(
        "Edits a recording (the first "
        f"{LONGEST_SECONDS:g} s of a WAV or CSV file, as on *Your recording*), or, without a file, the texture of the "
        "first tab's ratings. What is not asked for stays, as far as *strength* leaves it."
    )
    axes = studio.config.rating_axes
    with gr.Row():
        with gr.Column():
            upload = gr.File(label="Recording (.csv, .wav)", file_types=[".csv", ".wav"], type="binary")
            rate = gr.Number(10_000, label="Sampling rate, Hz", info="of a CSV file with one column")
        with gr.Column():
            action = gr.Radio(list(ACTIONS), value=next(iter(ACTIONS)), label="Do", elem_id="edit-action")
            deltas = [gr.Slider(-2, 2, 0, step=0.1, label=f"{axis}, change in z-scores") for axis in axes]
            strength = gr.Slider(0, 1, 0.6, step=0.05, label="Strength", info="0 = as it is, 1 = a fresh take")
            with gr.Row():
                start = gr.Number(0.8, label="Stretch from, s")
                stop = gr.Number(0.9, label="to, s")
            make = gr.Button("Edit", variant="primary", elem_id="edit")
    picture, sound, numbers = gr.HTML(elem_id="edit-picture"), gr.HTML(), gr.HTML(elem_id="edit-numbers")

    make.click(
        functools.partial(run_edit, gr, studio),
        [upload, rate, action, start, stop, strength, *deltas]
        + [asked["scale"], *asked["ratings"], *asked["open"], *asked["settings"]],
        [picture, sound, numbers],
        api_visibility="private",
        show_progress="minimal",
    )


def run_edit(gr, studio, content, csv_rate, chosen, begin, end, strength, *values):
    """Answers the button: yields picture, players and numbers; what is refused is said in their place."""
    axes = studio.config.rating_axes
    changes, scale, values = values[: len(axes)], values[len(axes)], values[len(axes) + 1 :]
    asked, how = values[: 2 * len(axes)], Settings(*values[2 * len(axes) :])
    try:
        check_number("stretch", begin, "s", at_least=0)
        check_number("stretch", end, "s", above=begin)
        if content is None:
            texture = studio.generate([read_ratings(studio, scale, asked)], how).textures[0]
            samples, sampling_rate = texture.samples, texture.sampling_rate
        else:
            samples, sampling_rate, _ = read_upload(content, csv_rate)
        options = ACTIONS[chosen](dict(zip(axes, changes, strict=True)), strength, begin, end)
        made = studio.edit(samples, sampling_rate, how, **options)
    except ValueError as error:
        yield f'<p role="status"><strong>Not made:</strong> {html.escape(str(error))}</p>', "", ""
        raise gr.Error(str(error), print_exception=False) from error
    yield edit_answer(made, scale, studio.config)

"""Edit: a recording, or the texture on the strip; before and after lie under one finger."""

import time
from dataclasses import replace

from analysis import numbers, waveform
from settings import Settings
from strip import start_of
from uploads import KINDS, columns_of, read_upload

from tactile_diffusers.signal import SEGMENT_SAMPLES
from tactile_diffusers.signal.checks import check_number

#: What can be done.
FEEL, ANEW, LONGER, LOOP = ACTIONS = (
    "change how it feels",
    "make a stretch anew",
    "1 s longer",
    "close to a loop",
)
#: Seconds after which a stretch that the plot tells is one that somebody dragged.
REDRAWN_SECONDS = 1.5


def options_of(action, deltas, strength, start, stop):
    """Arguments of `TactileTextureEditPipeline` that ask for it.

    Raises:
        ValueError: where it would change nothing, or a stretch is none.
    """
    if action == FEEL:
        if not any(deltas.values()):
            raise ValueError("Say what to change: move a slider of roughness, bumpiness or slipperiness.")
        changed = {axis: delta for axis, delta in deltas.items() if delta}
        return {"ratings": changed, "rating_scale": "difference", "strength": strength}
    if action == ANEW:
        check_number("stretch", start, "s", at_least=0)
        check_number("stretch", stop, "s", above=start)
        return {"mask": [(start, stop)]}
    return {"continue_s": 1.0} if action == LONGER else {"loop": True}


def edit_tab(desk, tab):
    """The tab."""
    gr, studio, scale = desk.gr, desk.studio, desk.studio.scale
    own, versions, since = desk.own_tracks(tab), gr.State([]), gr.State(0.0)
    with gr.Row():
        with gr.Column(scale=3, min_width=260):
            take = gr.Button("Take the texture of Make", elem_id="take-made", size="sm")
            upload = gr.File(
                label="or a recording", file_types=list(KINDS), type="filepath", height=110, elem_id="upload"
            )
            with gr.Row():
                column = gr.Dropdown([], label="Column", elem_id="column", min_width=120, visible=False)
                rate = gr.Number(label="Hz (0: as the file says)", elem_id="csv-rate", min_width=120, visible=False)
                newtons = gr.Number(1, label="N per unit (1: as the file says)", min_width=120, visible=False)
            told = gr.Markdown("", elem_id="edit-told")
        with gr.Column(scale=4, min_width=300):
            wave = gr.LinePlot(
                x="s",
                y="mN",
                height=200,
                tooltip="none",
                label="Waveform: drag over a stretch to make it anew",
                elem_id="edit-wave",
            )
            with gr.Row():
                start = gr.Number(0.8, label="Stretch from, s", elem_id="start", min_width=100)
                stop = gr.Number(0.9, label="to, s", elem_id="stop", min_width=100)
        with gr.Column(scale=4, min_width=300):
            action = gr.Radio(list(ACTIONS), value=FEEL, label="Do", elem_id="edit-action")
            deltas = [
                gr.Slider(-2, 2, 0, step=0.1, label=f"More {axis}", elem_id=f"more-{axis}") for axis in scale.axes
            ]
            gr.Markdown("Steps are standard deviations of the training surfaces.")
            strength = gr.Slider(0, 1, 0.6, step=0.05, label="Strength (0 = as it is, 1 = a fresh take)")
            with gr.Row():
                make = gr.Button("Edit", variant="primary", elem_id="edit")
                back = gr.Button("↶ Undo edit", elem_id="edit-undo")
    table = gr.HTML(elem_id="edit-numbers")

    def show(versions, words):
        """The last version, and the one before it."""
        tracks = list(zip(("before", "after"), versions[-2:], strict=False))
        table = numbers(scale, tracks) if len(tracks) > 1 else ""
        start, rate, whole = start_of(tracks), versions[-1].sampling_rate, len(versions[-1].samples)
        if whole > SEGMENT_SAMPLES:
            stop = min(start + SEGMENT_SAMPLES, whole)
            words += f"<br>The strip plays {start / rate:.2f} to {stop / rate:.2f} s of it."
        return versions, words, table, waveform(versions[-1]), *desk.put(tracks), tracks, time.monotonic()

    def from_made(made):
        if not made:
            raise ValueError("There is no texture in Make yet.")
        return show([made[1]], "The texture of Make.")

    def look(path):
        """What there is to choose of a file; what is wrong with it, `from_file` says."""
        try:
            names = columns_of(path) if path else []
        except ValueError:
            names = []
        fresh = (gr.Number(value, visible=bool(path)) for value in (None, 1))  # what was said of another file is over
        return gr.Dropdown(names, value=None, visible=len(names) > 1), *fresh

    def from_file(path, column, rate, newtons):
        if not path:
            return (gr.skip(),) * len(got)
        try:
            samples, sampling_rate, notes = read_upload(path, column, rate or None, newtons)
        except ValueError as error:
            return [], f"**{error}**", "", None, *desk.nothing, [], gr.skip()
        texture = studio.recorded(samples, sampling_rate)
        words = [f"{len(samples) / sampling_rate:.2f} s at {sampling_rate} Hz", *notes, *scale.loud(texture.rms)]
        return show([texture], "; ".join(words))

    def edit(versions, made, action, start, stop, strength, *changes):
        if not versions:
            raise ValueError("There is nothing to edit yet: give a recording, or take the texture of Make.")
        options = options_of(action, dict(zip(scale.axes, changes, strict=True)), strength, start, stop)
        how, last = Settings.of_make(made)[0] if versions[0].checkpoint else Settings(), versions[-1].seed
        # another seed with every edit, and the same ones when somebody repeats them
        how = replace(how, seed=Settings.seed if last is None else (last + 1) % 2**31)
        after = studio.edit(versions[-1], how, **options)
        asked = zip(scale.axes, changes, scale.from_z(after.ratings), strict=True)
        ends = [axis for axis, change, place in asked if change and place in (0, 100)] if action == FEEL else []
        words = f"**{' and '.join(ends)}: at the end of what was trained; asking for more changes nothing.**"
        return show([*versions, after], words if ends else f"Edit {len(versions)}: {action}.")

    def undo(versions):
        if len(versions) < 2:
            raise ValueError("There is no edit to undo.")
        return show(versions[:-1], "Undone.")

    def stretch(event: gr.SelectData, since):
        if time.monotonic() - since < REDRAWN_SECONDS:  # the plot tells its old stretch when it is drawn anew
            return (gr.skip(),) * 3
        low, high = event.index
        return round(float(low), 3), round(float(high), 3), ANEW

    def begin(versions, made):
        return (gr.skip(),) * len(got) if versions or not made else from_made(made)

    got = [versions, told, table, wave, desk.strip, desk.shown, own, since]
    desk.on([tab.select], begin, [versions, desk.made], got)
    desk.on([take.click], from_made, desk.made, got)
    asked = [upload, column, rate, newtons]
    desk.on([upload.upload], look, upload, asked[1:]).then(desk.answer(from_file), asked, got, **desk.hidden)
    desk.on([column.input, rate.submit, newtons.submit], from_file, asked, got)
    wave.select(stretch, since, [start, stop, action], **desk.hidden)
    desk.on([make.click], edit, [versions, desk.made, action, start, stop, strength, *deltas], got, last=False)
    desk.on([back.click], undo, versions, got)

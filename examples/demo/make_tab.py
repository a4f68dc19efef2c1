"""Make: ratings to a texture, while a slider is dragged."""

import json
import random
import time
from pathlib import Path
from types import SimpleNamespace
from urllib.parse import urlencode

from analysis import analysis
from settings import LIMITS, WORDS, Settings

from tactile_diffusers.pipelines import PRESETS

TAKES, MOST_HISTORY = 6, 50
#: What a link holds beside the ratings, in the order of a snapshot.
LINKED = dict(preset=str, take=int, seed=int, guidance=float, duration_s=float, steps=int, checkpoint=str)
#: Seconds within which what moves one control is one entry of the history.
ONE_MOVE_SECONDS = 1.5
_PAD = '<div class="pad" role="slider" tabindex="0" aria-label="Pad of two ratings" aria-valuenow="0" ' + (
    'aria-valuemin="0" aria-valuemax="100"><span class="left"></span><span class="right"></span>'
    '<span class="bottom"></span><span class="top"></span><span class="dot"></span></div>'
)
_PAD_SCRIPT = Path(__file__).with_name("pad.js").read_text(encoding="utf-8")


def make_tab(desk, tab, page):
    """The tab. Returns its `controls` and `restore`, for those who set them."""
    gr, studio, scale = desk.gr, desk.studio, desk.studio.scale
    history = gr.State({"entries": [], "at": -1, "time": 0.0, "moved": set()})
    with gr.Row():
        with gr.Column(scale=4, min_width=300):
            sliders, opens = _axes(gr, scale)
            status = gr.Markdown(elem_id="status")
            gr.Markdown("Percentiles: at 80, four of five training surfaces are less rough, bumpy or slippery.")
        with gr.Column(scale=3, min_width=260):
            pad = gr.HTML(html_template=_PAD, js_on_load=_PAD_SCRIPT, elem_id="pad", apply_default_css=False)
            with gr.Row():
                x = gr.Dropdown(scale.axes, value=scale.axes[0], label="Across", min_width=100, elem_id="across")
                y = gr.Dropdown(scale.axes, value=scale.axes[min(1, len(scale.axes) - 1)], label="Up", min_width=100)
        with gr.Column(scale=4, min_width=300):
            with gr.Row():
                dice = gr.Button("New takes", elem_id="dice", min_width=90, size="sm")
                undo = gr.Button("↶ Undo", elem_id="undo", min_width=70, size="sm")
                redo = gr.Button("↷ Redo", elem_id="redo", min_width=70, size="sm")
            take = gr.Radio(list(range(1, TAKES + 1)), value=1, label="Take", elem_id="takes")
            preset = gr.Radio(list(PRESETS), value="denim", label="Preset", elem_id="presets")
            with gr.Accordion("More", open=False) as more_fold:
                past = gr.Dropdown([], label="History", elem_id="history")
                default, names = Settings(), list(studio.checkpoints)
                more = [
                    gr.Number(default.seed, label="Seed", precision=0, elem_id="seed"),
                    gr.Slider(*LIMITS["guidance"], default.guidance, step=0.05, label="Guidance (1 = off)"),
                    gr.Slider(*LIMITS["duration_s"], default.duration_s, step=0.1, label="Duration, s"),
                    gr.Slider(*LIMITS["steps"], studio.steps, step=1, label="Steps of the decoder"),
                    gr.Dropdown(names, value=names[0], label="Checkpoint", elem_id="checkpoint"),
                ]
    controls = [*sliders, *opens, preset, take, *more]
    make = SimpleNamespace(controls=controls, count=len(scale.axes))
    make.outputs = [*controls, desk.strip, desk.shown, desk.made, history, status, pad]

    def pad_value(values, x, y):
        sides = dict(zip(("left", "right", "bottom", "top"), (*_words(x), *_words(y)), strict=True))
        at = {"x": values[scale.axes.index(x)], "y": values[scale.axes.index(y)]}
        return json.dumps({**at, "names": {"x": x, "y": y}, "words": sides})

    def create(entry, log, x, y, apart=False):
        """What all answers of this tab bring: strip, shown, made, history, status, pad."""
        values, left_open = entry[: make.count], entry[make.count : 2 * make.count]
        _, number, seed, *how, checkpoint = entry[2 * make.count :]
        ratings = scale.to_z([None if off else value for value, off in zip(values, left_open, strict=True)])
        texture = studio.generate(ratings, Settings(seed + number - 1, *how), checkpoint)
        log, title = _remember(log, entry, apart), _title(scale, entry)
        told = f"**{title}** · take {number} · estimated to feel: {scale.describe(texture.estimated)}"
        told += "".join(f"<br>{note}" for note in [scale.novelty(ratings)] if note)
        put = desk.put([(title, texture)], _link(scale, entry))
        return *put, (entry, texture), log, told, pad_value(values, x, y)

    def live(log, x, y, *entry):
        return create(entry, log, x, y)

    def slide(log, x, y, value, *entry):
        moved = json.loads(value)
        entry = list(entry)
        for axis, place in (("x", x), ("y", y)):
            number = scale.axes.index(place)
            entry[number], entry[make.count + number] = moved[axis], False
        *rest, _ = create(tuple(entry), log, x, y)
        return *entry[: 2 * make.count], *rest

    def restore(entry, log, x, y):
        return *entry, *create(tuple(entry), log, x, y, apart=True)

    def choose_preset(log, x, y, *entry):
        return restore(with_ratings(entry, scale.preset(entry[2 * make.count])), log, x, y)

    def throw(log, x, y, *entry):
        at = 2 * make.count
        return restore((*entry[: at + 1], 1, random.randrange(1, 10**6), *entry[at + 3 :]), log, x, y)

    def step(by, log, x, y, *entry):
        at = min(max(log["at"] + by, 0), len(log["entries"]) - 1)
        return restore(log["entries"][at], {**log, "at": at, "moved": set()}, x, y)

    def with_ratings(entry, ratings, preset=...):
        """A snapshot with other ratings, z-scores; sliders whose axis is open stay where they are."""
        shown = scale.from_z(ratings)
        values = [old if new is None else new for new, old in zip(shown, entry, strict=False)]
        rest = entry[2 * make.count :] if preset is ... else (preset, *entry[2 * make.count + 1 :])
        return (*values, *(value is None for value in shown), *rest)

    def list_history(log):
        labels = [
            (f"{_title(scale, entry)}, {_asked(make.count, entry)}", at) for at, entry in enumerate(log["entries"])
        ]
        return gr.Dropdown(labels, value=log["at"])

    make.restore, make.with_ratings, make.inputs = restore, with_ratings, [history, x, y, *controls]

    def arrive(request: gr.Request, log, x, y, *entry):
        """The texture of the link, or the first preset."""
        entry = with_ratings(entry, scale.preset(entry[2 * make.count]))
        try:
            return restore(_from_link(scale, request.query_params, entry), log, x, y)
        except ValueError as error:
            gr.Warning(f"The link is not one of this page: {error}")
            return restore(entry, log, x, y)

    desk.on([page.load], arrive, make.inputs, make.outputs)
    plain = make.outputs[len(controls) :]
    moved = [control.input for control in (*sliders, *opens, take, *more)]
    desk.on(moved, live, make.inputs, plain, queue=False)  # the queue looks every 50 ms whether an answer is there
    desk.on([preset.input], choose_preset, make.inputs, make.outputs)
    pad_outputs = [*sliders, *opens, *plain[:-1]]
    desk.on([pad.input], slide, [history, x, y, pad, *controls], pad_outputs, queue=False)
    desk.on([dice.click], throw, make.inputs, make.outputs)
    for button, by in ((undo, -1), (redo, 1)):
        desk.on([button.click], lambda *given, by=by: step(by, *given), make.inputs, make.outputs)
    desk.on([past.input], lambda at, log, *given: step(at - log["at"], log, *given), [past, *make.inputs], make.outputs)
    desk.on([past.focus, more_fold.expand], list_history, history, past)
    desk.on([x.input, y.input], lambda log, x, y, *entry: pad_value(entry, x, y), make.inputs, pad)

    def back(made):
        return desk.put([(_title(scale, made[0]), made[1])], _link(scale, made[0])) if made else (gr.skip(), gr.skip())

    desk.on([tab.select], back, desk.made, [desk.strip, desk.shown])
    analysis(desk)
    return make


def _axes(gr, scale):
    """A slider and a switch an axis."""
    sliders, opens = [], []
    for axis in scale.axes:
        label = " to ".join(_words(axis)).capitalize()
        with gr.Row(elem_classes="axis"):
            sliders.append(gr.Slider(0, 100, 50, step=1, label=label, elem_id=axis))
            opens.append(gr.Checkbox(label="any", elem_id=f"{axis}-open", min_width=64))
    return sliders, opens


def _words(axis):
    return WORDS.get(axis, (f"less {axis}", f"more {axis}"))


def _is_edited(scale, name, values, left_open):
    asked = [None if off else value for value, off in zip(values, left_open, strict=True)]
    return name in PRESETS and asked != scale.from_z(scale.preset(name))


def _remember(log, entry, apart=False):
    """The history with this snapshot: moves of the same controls in a row are one entry, unless this one stands apart;
    after an undo the rest goes."""
    entries, at, now = log["entries"], log["at"], time.monotonic()
    if entries and tuple(entries[at]) == tuple(entry):
        return log
    moved = {place for place, value in enumerate(entry) if not entries or value != entries[at][place]}
    same = moved <= log["moved"] and now - log["time"] < ONE_MOVE_SECONDS
    kept = [*entries[: at + (not same)], tuple(entry)][-MOST_HISTORY:]
    moved = set() if apart else log["moved"] if same else moved
    return {"entries": kept, "at": len(kept) - 1, "time": now, "moved": moved}


def _title(scale, entry):
    """A preset's name, whether its ratings were changed, or "your own"."""
    count = len(scale.axes)
    name = entry[2 * count]
    edited = _is_edited(scale, name, entry[:count], entry[count : 2 * count])
    return f"{name}, edited" if edited else name or "your own"


def _asked(count, entry):
    """The sliders of a snapshot, and its take."""
    asked = zip(entry[:count], entry[count : 2 * count], strict=True)
    return "/".join("any" if off else f"{value:g}" for value, off in asked) + f", take {entry[2 * count + 1]}"


def _link(scale, entry):
    count = len(scale.axes)
    ratings = {axis: "any" if entry[count + n] else f"{entry[n]:g}" for n, axis in enumerate(scale.axes)}
    rest = zip(LINKED, entry[2 * count :], strict=True)
    return urlencode({**ratings, **{name: value for name, value in rest if value is not None}})


def _from_link(scale, query, entry):
    """The snapshot that a link holds; what it does not say is as in `entry`.

    Raises:
        ValueError: for what is no number, or no preset.
    """
    asked = [query.get(axis) for axis in scale.axes]
    values = [old if text in (None, "any") else float(text) for text, old in zip(asked, entry, strict=False)]
    rest = dict(zip(LINKED, entry[2 * len(values) :], strict=True))
    if any(asked):  # without a preset's name they are one's own
        rest["preset"] = None
    for name in set(LINKED) & set(query):
        rest[name] = LINKED[name](query[name])
    if rest["preset"] not in (None, *PRESETS):
        raise ValueError(f"There is no preset {rest['preset']!r}.")
    return *values, *(text == "any" for text in asked), *rest.values()

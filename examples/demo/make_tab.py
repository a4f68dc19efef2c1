"""Make: ratings to a texture, while a slider is dragged."""

import functools
import json
import random
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from urllib.parse import urlencode

from analysis import analysis
from settings import LIMITS, WORDS, Settings

from tactile_diffusers.pipelines import PRESETS

TAKES, MOST_HISTORY = 6, 50
#: What a link holds beside the ratings. A snapshot is a tuple of the values of all controls: sliders, whether each axis
#: is open, and these.
LINKED = dict(preset=str, take=int, seed=int, guidance=float, duration_s=float, steps=int, checkpoint=str)
#: Seconds within which what moves one control is one entry of the history.
ONE_MOVE_SECONDS = 1.5
_PAD, _PAD_SCRIPT = (Path(__file__).with_name(name).read_text(encoding="utf-8") for name in ("pad.html", "pad.js"))


def make_tab(desk, tab, page):
    """The tab. Returns what those need who set its controls."""
    gr, studio, scale = desk.gr, desk.studio, desk.studio.scale
    history = gr.State({"entries": [], "at": -1, "time": 0.0, "moved": set()})
    sliders, opens, count = [], [], len(scale.axes)
    with gr.Row():
        with gr.Column(scale=4, min_width=300):
            for axis in scale.axes:
                label = " to ".join(_words(axis)).capitalize()
                with gr.Row(elem_classes="axis"):
                    sliders.append(gr.Slider(0, 100, 50, step=1, label=label, elem_id=axis))
                    opens.append(gr.Checkbox(label=f"any {axis}", elem_id=f"{axis}-open", min_width=64))
            status = gr.Markdown(elem_id="status")
            gr.Markdown("Percentiles: at 80, four of five training surfaces are less rough, bumpy or slippery.")
        with gr.Column(scale=3, min_width=260):
            pad = gr.HTML(html_template=_PAD, js_on_load=_PAD_SCRIPT, elem_id="pad", apply_default_css=False)
            with gr.Row():
                x = gr.Dropdown(scale.axes, value=scale.axes[0], label="Across", min_width=100, elem_id="across")
                y = gr.Dropdown(scale.axes, value=scale.axes[min(1, count - 1)], label="Up", min_width=100)
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
    plain = [desk.strip, desk.shown, desk.made, history, status, pad]
    make = SimpleNamespace(inputs=[history, x, y, *controls], outputs=[*controls, *plain])

    def pad_value(log, x, y, *entry):
        sides = dict(zip(("left", "right", "bottom", "top"), (*_words(x), *_words(y)), strict=True))
        at = {"x": entry[scale.axes.index(x)], "y": entry[scale.axes.index(y)]}
        at = {side: 50 if value is None else value for side, value in at.items()}  # a number that was emptied
        return json.dumps({**at, "names": {"x": x, "y": y}, "words": sides})

    def live(log, x, y, *entry, apart=False):
        """The texture of a snapshot: values for `plain`."""
        _, number, seed, *how, checkpoint = entry[2 * count :]
        ratings = scale.to_z(_asked(count, entry))
        settings = Settings(seed, *how)
        texture = studio.generate(ratings, replace(settings, seed=settings.seed + number - 1), checkpoint)
        log, title = remember(log, entry, apart), title_of(scale, entry)
        told = f"**{title}** · take {number}<br>{scale.novelty(ratings)} {scale.strong(settings.guidance)}".strip()
        put = desk.put([(title, texture)], link_of(scale, entry))
        return *put, (entry, texture, told), log, told, pad_value(log, x, y, *entry)

    def restore(entry, log, x, y):
        """Controls as in a snapshot, and its texture."""
        return *entry, *live(log, x, y, *entry, apart=True)

    def settle(place, dragged, log, x, y, *entry):
        """Whether an axis is open: not where its slider was dragged, but where its number was emptied."""
        is_open = entry[place] is None or (entry[count + place] and not dragged)
        entry = (*entry[: count + place], is_open, *entry[count + place + 1 :])
        return is_open, *live(log, x, y, *entry, apart=not dragged)

    def slide(value, log, x, y, *entry):
        moved, entry = json.loads(value), list(entry)
        for axis, name in (("x", x), ("y", y)):
            place = scale.axes.index(name)
            entry[place], entry[count + place] = moved[axis], False
        return *entry[: 2 * count], *live(log, x, y, *entry)[:-1]

    def choose_preset(log, x, y, *entry):
        return restore(with_ratings(entry, scale.preset(entry[2 * count])), log, x, y)

    def throw(log, x, y, *entry):
        at = 2 * count
        return restore((*entry[: at + 1], 1, random.randrange(1, 10**6), *entry[at + 3 :]), log, x, y)

    def go_to(at, log, x, y, *entry):
        at = min(max(at, 0), len(log["entries"]) - 1)
        return restore(log["entries"][at], {**log, "at": at, "moved": set()}, x, y)

    def with_ratings(entry, ratings, preset=...):
        """A snapshot with other ratings, z-scores; sliders whose axis is open stay where they are."""
        shown = scale.from_z(ratings)
        values = [old if new is None else new for new, old in zip(shown, entry, strict=False)]
        rest = entry[2 * count :] if preset is ... else (preset, *entry[2 * count + 1 :])
        return (*values, *(value is None for value in shown), *rest)

    def list_history(log):
        labels = [f"{title_of(scale, one)}, {_told(count, one)}" for one in log["entries"]]
        return gr.Dropdown([(label, at) for at, label in enumerate(labels)], value=log["at"])

    def arrive(request: gr.Request, log, x, y, *entry):
        """The texture of the link, or the first preset."""
        entry = with_ratings(entry, scale.preset(entry[2 * count]))
        try:
            return restore(from_link(scale, request.query_params, entry), log, x, y)
        except ValueError as error:
            gr.Warning(f"The link is not one of this page: {error}")
            return restore(entry, log, x, y)

    def back(made):
        return desk.put([(title_of(scale, made[0]), made[1])], link_of(scale, made[0])) if made else desk.nothing

    make.restore, make.with_ratings = restore, with_ratings
    desk.on([page.load], arrive, make.inputs, make.outputs)

    def at_once(triggers, function, inputs, outputs):
        """An event past the queue, which looks every 50 ms whether an answer is there; gradio shows no error of such
        an event, so the status says what is refused."""

        @functools.wraps(function)
        def answer(*given):
            try:
                return function(*given)
            except ValueError as error:
                return tuple(f"**{error}**" if one is status else gr.skip() for one in outputs)

        desk.on(triggers, answer, inputs, outputs, queue=False)

    at_once([one.input for one in more], live, make.inputs, plain)
    at_once([take.input], functools.partial(live, apart=True), make.inputs, plain)
    for place, pair in enumerate(zip(sliders, opens, strict=True)):
        for one, dragged in zip(pair, (True, False), strict=True):
            at_once([one.input], functools.partial(settle, place, dragged), make.inputs, [opens[place], *plain])
    at_once([pad.input], slide, [pad, *make.inputs], [*sliders, *opens, *plain[:-1]])
    desk.on([preset.input], choose_preset, make.inputs, make.outputs)
    desk.on([dice.click], throw, make.inputs, make.outputs)
    desk.on([undo.click], lambda log, *rest: go_to(log["at"] - 1, log, *rest), make.inputs, make.outputs)
    desk.on([redo.click], lambda log, *rest: go_to(log["at"] + 1, log, *rest), make.inputs, make.outputs)
    desk.on([past.input], go_to, [past, *make.inputs], make.outputs)
    desk.on([past.focus, more_fold.expand], list_history, history, past)
    desk.on([x.input, y.input], pad_value, make.inputs, pad)
    desk.on([tab.select], back, desk.made, [desk.strip, desk.shown])
    analysis(desk, status)
    return make


def _words(axis):
    return WORDS.get(axis, (f"less {axis}", f"more {axis}"))


def _asked(count, entry):
    """Sliders of a snapshot; `None` = open."""
    return [None if off else value for value, off in zip(entry[:count], entry[count : 2 * count], strict=True)]


def _told(count, entry):
    asked = ("any" if value is None else f"{value:g}" for value in _asked(count, entry))
    return f"{'/'.join(asked)}, take {entry[2 * count + 1]}"


def title_of(scale, entry):
    """A preset's name, whether its ratings were changed, or "your own"."""
    name, asked = entry[2 * len(scale.axes)], _asked(len(scale.axes), entry)
    edited = name in PRESETS and asked != scale.from_z(scale.preset(name))
    return f"{name}, edited" if edited else name or "your own"


def remember(log, entry, apart=False):
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


def link_of(scale, entry):
    """The query of a link that opens this snapshot."""
    shown = ("any" if value is None else f"{value:g}" for value in _asked(len(scale.axes), entry))
    rest = dict(zip(LINKED, entry[2 * len(scale.axes) :], strict=True))
    return urlencode({**dict(zip(scale.axes, shown, strict=True)), **{k: v for k, v in rest.items() if v is not None}})


def from_link(scale, query, entry):
    """The snapshot that a link holds; what it does not say is as in `entry`.

    Raises:
        ValueError: for what is no number, no preset, or no take.
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
    if not 1 <= rest["take"] <= TAKES:  # the radio's: gradio would refuse every later event
        raise ValueError(f"`take` must be from 1 to {TAKES}, got {rest['take']}.")
    return *values, *(text == "any" for text in asked), *rest.values()

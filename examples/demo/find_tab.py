"""Find: two strips, "this one rather", until it is known what somebody likes."""

import html

import numpy as np

ROUNDS = 20
LETTERS = ("A", "B")


def find_tab(desk, tab, tabs, make):
    """The tab; what is found goes to the controls of Make."""
    gr, studio, scale = desk.gr, desk.studio, desk.studio.scale
    own, state = desk.own_tracks(tab), gr.State()
    with gr.Row():
        with gr.Column(scale=3, min_width=280):
            gr.Markdown(
                "Think of the surface that you want. Feel **A** and **B** on the strip: move the finger up and down "
                "between them. Say which is nearer, twenty times or fewer."
            )
            axes = gr.CheckboxGroup(scale.axes, value=scale.axes, label="What may change", elem_id="find-axes")
            begin = gr.Button("Begin", variant="primary", elem_id="find-begin")
        with gr.Column(scale=4, min_width=300):
            with gr.Row():
                first = gr.Button("A is nearer", elem_id="find-first", min_width=90, interactive=False)
                neither = gr.Button("No difference", elem_id="find-neither", min_width=90, interactive=False)
                second = gr.Button("B is nearer", elem_id="find-second", min_width=90, interactive=False)
            told = gr.HTML("<p>Not begun.</p>", elem_id="find-told")
            with gr.Row():
                undo = gr.Button("↶ Take the answer back", elem_id="find-undo", size="sm", interactive=False)
                listen = gr.Button("Feel the best so far", elem_id="find-best", size="sm", interactive=False)
                use = gr.Button("Use in Make", elem_id="find-use", size="sm", interactive=False)

    def searched(asked):
        if not asked:
            raise ValueError("Begin first.")
        return studio.search(asked["axes"], asked["answers"], asked["seed"])

    def propose(asked):
        search = searched(asked)
        asked = {**asked, "pair": search.next_pair().tolist()}
        tracks = list(zip(LETTERS, studio.textures_of(search, asked["pair"]), strict=True))
        words = _progress(scale, search, len(asked["answers"]))
        active = [gr.Button(interactive=len(asked["answers"]) < ROUNDS)] * 3
        active += [gr.Button(interactive=bool(asked["answers"])), *[gr.Button(interactive=True)] * 2]
        return asked, words, *desk.put(tracks), tracks, *active

    def start(axes, made):
        seed = made[1].seed if made else 0
        return propose({"axes": axes, "answers": [], "seed": seed})

    def answer(word, asked):
        searched(asked)
        if len(asked["answers"]) >= ROUNDS:
            raise ValueError("Twenty rounds are done: use the best in Make, or begin again.")
        return propose({**asked, "answers": [*asked["answers"], (*asked["pair"], word)]})

    def take_back(asked):
        return propose({**asked, "answers": asked["answers"][:-1]} if asked else asked)

    def best(asked):
        search = searched(asked)
        tracks = [("best so far", studio.textures_of(search, search.best_point()[0][None])[0])]
        return *desk.put(tracks), tracks

    def to_make(asked, log, x, y, *entry):
        search = searched(asked)
        [ratings] = search.space.ratings(search.best_point()[0][None]).tolist()
        return gr.Tabs(selected="make"), *make.restore(make.with_ratings(entry, ratings, None), log, x, y)

    outputs = [state, told, desk.strip, desk.shown, own, first, neither, second, undo, listen, use]
    desk.on([begin.click], start, [axes, desk.made], outputs, last=False)
    for button, word in ((first, "first"), (second, "second"), (neither, "neither")):
        desk.on([button.click], lambda asked, word=word: answer(word, asked), state, outputs, last=False)
    desk.on([undo.click], take_back, state, outputs, last=False)
    desk.on([listen.click], best, state, [desk.strip, desk.shown, own])
    desk.on([use.click], to_make, [state, *make.inputs], [tabs, *make.outputs])


def _progress(scale, search, count):
    """Rounds that are done, and how well each axis is known, in HTML."""
    point, spread = search.best_point()
    low, high = search.space.low, search.space.high
    ratings = dict(zip(search.names, point, strict=True))
    shown = dict(zip(scale.axes, scale.from_z([ratings.get(axis, np.nan) for axis in scale.axes]), strict=True))
    rows = []
    for name, wide, *ends in zip(search.names, spread, low, high, strict=True):
        known = max(0.0, 1 - wide * np.sqrt(12) / (ends[1] - ends[0]))  # of a place that is not known at all: 0
        bar = f'<div class="bar"><div style="width:{100 * known:.0f}%"></div></div>'
        cells = (
            f"<th scope='row'>{html.escape(name)}</th><td>about {shown[name]:g}</td><td>known {100 * known:.0f} %</td>"
        )
        rows.append(f"<tr>{cells}<td style='width:40%'>{bar}</td></tr>")
    head = f"<p role='status'>Round {min(count + 1, ROUNDS)} of {ROUNDS}</p>"
    return f'{head}<table class="numbers" style="width:100%">{"".join(rows)}</table>'

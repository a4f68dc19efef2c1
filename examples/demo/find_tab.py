"""Find: two textures, "this one is nearer", until it is known what somebody likes."""

import html

import numpy as np

ROUNDS = 20
HOW = """Think of the surface that you want. Feel **A** and **B** on the strip: move the finger up and down between
them. Say which is nearer, twenty times or fewer."""


def find_tab(desk, tab, tabs, make):
    """The tab; what is found goes to the controls of Make."""
    gr, studio, scale = desk.gr, desk.studio, desk.studio.scale
    own, state = desk.own_tracks(tab), gr.State()
    with gr.Row():
        with gr.Column(scale=3, min_width=280):
            gr.Markdown(HOW)
            axes = gr.CheckboxGroup(scale.axes, value=scale.axes, label="What may change", elem_id="find-axes")
            begin = gr.Button("Begin", variant="primary", elem_id="find-begin")
        with gr.Column(scale=4, min_width=300):
            with gr.Row():
                first, neither, second = answers = [
                    gr.Button(label, elem_id=f"find-{word}", min_width=90, interactive=False)
                    for word, label in (
                        ("first", "A is nearer"),
                        ("neither", "No difference"),
                        ("second", "B is nearer"),
                    )
                ]
            told = gr.HTML("<p>Not begun.</p>", elem_id="find-told")
            with gr.Row():
                undo, listen, use = others = [
                    gr.Button(label, elem_id=f"find-{word}", size="sm", interactive=False)
                    for word, label in (
                        ("undo", "↶ Take the answer back"),
                        ("best", "Feel the best so far"),
                        ("use", "Use in Make"),
                    )
                ]

    def searched(asked):
        if not asked:
            raise ValueError("Begin first.")
        return studio.search(asked["axes"], asked["answers"], asked["seed"])

    def propose(asked):
        search = searched(asked)
        done = len(asked["answers"])
        points = search.next_pair() if done < ROUNDS else search.best_point()[0][None]
        asked, names = {**asked, "pair": points.tolist()}, "AB" if done < ROUNDS else ["best"]
        tracks = list(zip(names, studio.textures_of(search, points), strict=True))
        active = [done < ROUNDS] * 3 + [done > 0, True, True]
        return (
            asked,
            progress(scale, search, done),
            *desk.put(tracks),
            tracks,
            *(gr.Button(interactive=a) for a in active),
        )

    def start(axes, made):
        return propose({"axes": axes, "answers": [], "seed": made[1].seed if made else 0})

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

    outputs = [state, told, desk.strip, desk.shown, own, *answers, *others]
    desk.on([begin.click], start, [axes, desk.made], outputs, last=False)
    for button, word in ((first, "first"), (second, "second"), (neither, "neither")):
        desk.on([button.click], lambda asked, word=word: answer(word, asked), state, outputs, last=False)
    desk.on([undo.click], take_back, state, outputs, last=False)
    desk.on([listen.click], best, state, [desk.strip, desk.shown, own])
    desk.on([use.click], to_make, [state, *make.inputs], [tabs, *make.outputs])


def progress(scale, search, count):
    """Rounds that are done, and how well each axis is known, in HTML."""
    point, spread = search.best_point()
    ratings = dict(zip(search.names, point, strict=True))
    shown = dict(zip(scale.axes, scale.from_z([ratings.get(axis, np.nan) for axis in scale.axes]), strict=True))
    rows = []
    for name, wide, low, high in zip(search.names, spread, search.space.low, search.space.high, strict=True):
        known = 100 * max(0.0, 1 - wide * np.sqrt(12) / (high - low))  # of a place that is not known at all: 0
        bar = f'<td style="width:40%"><div class="bar"><div style="width:{known:.0f}%"></div></div></td>'
        head = f'<th scope="row">{html.escape(name)}</th>'
        rows.append(f"<tr>{head}<td>about {shown[name]:g}</td><td>known {known:.0f} %</td>{bar}</tr>")
    told = f"Round {count + 1} of {ROUNDS}" if count < ROUNDS else "Done. The best lies on the strip: use it in Make."
    head = f'<p role="status">{told}</p>'
    return f'{head}<table class="numbers" style="width:100%">{"".join(rows)}</table>'

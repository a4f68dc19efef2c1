"""The page: what stands where, and what calls what. All that is computed lies in the modules beside it."""

import functools
import html

from answers import comparison_answer, reconstruction_answer
from controls import leave_checks_of_numbers_to_us, read_ratings, show_errors
from edit_tab import edit_tab
from settings import Settings, blend, describe, to_z
from texture_tab import texture_tab
from uploads import LONGEST_SECONDS, read_upload

from tactile_diffusers.pipelines import PRESETS
from tactile_diffusers.signal.checks import check_number

CSS = """
#picture { min-height: 400px; } /* nothing jumps when they arrive */
p[role=status] { margin: 0; padding: 6px 10px; border-left: 4px solid #d9480f; }
/* in view wherever the page is scrolled to; nothing moves when it comes and goes */
#status p[role=status] { position: fixed; bottom: 0; left: 0; right: 0; z-index: 5; pointer-events: none; }
#status p[role=status] { background: var(--background-fill-primary); box-shadow: 0 -1px 6px #8888; }
#warned p { border-left: 4px solid #d9480f; padding-left: 10px; }
[data-testid=status-tracker] .error { display: none; } /* why is said in words, what was there before remains */
#strip { min-height: 360px; }
.texture-figure { width: 100%; height: auto; background: white; border-radius: 4px; }
.ends { background: var(--block-background-fill) !important; }
.ends .words { display: flex; justify-content: space-between; font-size: 0.9em; padding: 0 8px; }
.players { display: flex; flex-wrap: wrap; gap: 12px; }
.players figure { margin: 0; }
audio { max-width: 100%; }
.prose table.numbers { border-collapse: collapse; border: 0 !important; margin: 0; }
.prose table.numbers :is(th, td) { padding: 2px 16px 2px 0; text-align: left; border: 0 !important; }
.prose table.numbers td { white-space: nowrap; }
.prose table.numbers tr { border: 0 !important; border-bottom: 1px solid #8886 !important; }
"""
#: An emptied number field holds no number, which gradio would take for the lowest: it gets its last one back.
HEAD = """<script>
{
  const last = new WeakMap(), isNumber = (field) => field instanceof HTMLInputElement && field.type === "number";
  const listen = (kinds, act) => kinds.forEach((kind) => addEventListener(kind, act, true));
  listen(["focusin", "input", "change"], (event) => {
    if (!isNumber(event.target)) return;
    if (event.target.value !== "") last.set(event.target, event.target.value);
    else if (event.type !== "focusin") event.stopImmediatePropagation();
  });
  listen(["blur"], ({ target }) => {
    if (isNumber(target) && target.value === "" && last.has(target)) target.value = last.get(target);
  });
}
</script>"""
ABOUT = """# Tactile textures from ratings
Say how rough, bumpy and slippery a surface should feel; get the friction force of a sliding finger, in newtons at
10 kHz. Nothing leaves the computer that runs this page. The bundled checkpoint knows simulated surfaces only."""


def build(studio, folder, **options):
    """The page, not yet served.

    Args:
        studio ([`Studio`]): answers.
        folder (`Path`): gradio's folder of temporary files; for files to take away.
        options: of `gradio.Blocks`.

    Returns:
        `gradio.Blocks`
    """
    import gradio as gr

    leave_checks_of_numbers_to_us(gr)
    with gr.Blocks(title="Tactile textures from ratings", analytics_enabled=False, fill_width=True, **options) as page:
        gr.Markdown(ABOUT)
        kept = [gr.State(("glass", PRESETS["glass"])), gr.State(("denim", PRESETS["denim"]))]
        with gr.Tab("Texture"):
            asked, keep_buttons = texture_tab(gr, studio, folder, page)
        with gr.Tab("Two textures and a blend"):
            labels = _blend_tab(gr, studio, kept, asked)
        with gr.Tab("Your recording"):
            _recording_tab(gr, studio, asked)
        with gr.Tab("Edit"):
            edit_tab(gr, studio, asked)
        for number, button in enumerate(keep_buttons):
            button.click(
                show_errors(gr, functools.partial(_keep, studio, "AB"[number])),
                [asked["scale"], *asked["ratings"], *asked["open"]],
                [kept[number], labels[number]],
                api_visibility="private",
            )
    return page


def _keep(studio, name, scale, *values):
    ratings = read_ratings(studio, scale, values)
    return (name, ratings), _label(studio, name, "kept", ratings)


def _label(studio, name, origin, ratings):
    return f"**{name}** ({origin}): {describe(ratings, 'z', studio.config)} (z-scores)"


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
        share = gr.Slider(0, 100, 50, step=5, label="Blend, %", info="0 = A, 100 = B", elem_id="share")
        make = gr.Button("Make A, blend and B", variant="primary", elem_id="make-blend")
    status = gr.HTML(elem_id="blend-status", padding=False)
    picture, sound, numbers = gr.HTML(elem_id="blend-picture"), gr.HTML(), gr.HTML()
    made_of = gr.State()  # what was asked for what is shown

    def generate(scale, *wanted):
        first, second, percent, *how, _ = wanted
        check_number("blend", percent, "%", at_least=0, at_most=100)
        first, second = (tuple(to_z(ratings, "z", studio.config)) for _, ratings in (first, second))
        rows = [first, blend(first, second, percent / 100), second]
        made = studio.generate(rows, Settings(*how, takes=1))
        names = ("A", f"blend {percent:g} %", "B")
        return *comparison_answer(made, names, scale, studio.config), _asked(wanted)

    wanted = [*kept, share, *asked["settings"]]
    made = gr.on(
        [make.click, share.input],
        show_errors(gr, generate),
        [asked["scale"], *wanted],
        [picture, sound, numbers, made_of],
        api_visibility="private",
        show_progress="minimal",
        trigger_mode="always_last",
    )
    compare = {"fn": _outdated_blend, "inputs": [made_of, *wanted], "outputs": status}
    compare |= {"api_visibility": "private", "show_progress": "hidden", "trigger_mode": "always_last"}
    made.then(**compare)
    gr.on([component.change for component in wanted], **compare)
    return labels


def _asked(wanted):
    """What decides on a blend, of all that the tab reads: not what A and B are called, nor takes, for one is made."""
    (_, first), (_, second), *rest, _ = wanted
    return [list(first), list(second), *rest]


def _outdated_blend(made_of, *wanted):
    """What the tab says if what is shown is not what would be made now, as HTML; else nothing."""
    if made_of is None or made_of == _asked(wanted):
        return ""
    return (
        '<p role="status">Ratings or settings have changed since: <em>Make A, blend and B</em>. What is shown is the '
        "earlier comparison.</p>"
    )


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
            newtons = gr.Number(
                1.0, label="Newtons per unit", info="1 = as the column's name says, else newtons; WAV: per full scale"
            )
            make = gr.Button("Reconstruct and compare", variant="primary", elem_id="reconstruct")
    picture, sound, numbers = (
        gr.HTML(elem_id="recording-picture"),
        gr.HTML(),
        gr.HTML(elem_id="recording-numbers"),
    )

    def reconstruct(content, csv_rate, newtons_per_unit, scale, *values):
        try:
            if content is None:
                raise ValueError("Choose a file first.")
            check_number("newtons per unit", newtons_per_unit, above=0)
            check_number("sampling rate", csv_rate, "Hz", above=0)
            samples, sampling_rate, notes = read_upload(content, csv_rate, newtons_per_unit)
            made = studio.reconstruct(samples, sampling_rate, Settings(*values))
        except ValueError as error:
            # what an earlier recording gave would pass for this one's
            yield f'<p role="status"><strong>Not made:</strong> {html.escape(str(error))}</p>', "", ""
            raise gr.Error(str(error), print_exception=False) from error
        picture, sound, numbers = reconstruction_answer(made, scale, studio.config)
        yield picture, sound, "".join(f"<p>{html.escape(note)}</p>" for note in notes) + numbers

    make.click(
        reconstruct,
        [upload, rate, newtons, asked["scale"], *asked["settings"]],
        [picture, sound, numbers],
        api_visibility="private",
        show_progress="minimal",
    )

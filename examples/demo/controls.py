"""The controls of the page: ratings, how textures are made, and what is said of values that are none."""

import functools

from settings import (
    LIMITS,
    MOST_SECONDS,
    SCALES,
    WORDS,
    Settings,
    available_scales,
    digits,
    from_z,
    slider_ranges,
    to_z,
)

from tactile_diffusers.pipelines import PRESETS
from tactile_diffusers.signal import RATING_AXES

#: What the page says about the presets.
REMARK = "Presets are ratings that such a surface may be given, chosen by hand. They are not recordings of it."


def show_errors(gr, function):
    """The function with its `ValueError`s, which are meant for whoever asked, shown on the page."""

    @functools.wraps(function)
    def wrapped(*arguments):
        try:
            return function(*arguments)
        except ValueError as error:
            raise gr.Error(str(error), print_exception=False) from error

    return wrapped


def leave_checks_of_numbers_to_us(gr):
    """Ours name the axis; gradio's do not, and print a traceback. (A subclass would make it write stubs beside it.)"""
    for component in (gr.Slider, gr.Number):
        component.preprocess = lambda self, payload: payload


def read_ratings(studio, scale, values):
    """Ratings in z-scores of three values and three switches.

    Raises:
        ValueError: for a value beyond its slider, which names the axis.
    """
    count = len(RATING_AXES)
    given = [None if left_open else value for value, left_open in zip(values[:count], values[count:], strict=True)]
    for axis, value, (low, high) in zip(RATING_AXES, given, slider_ranges(scale, studio.config), strict=True):
        if value is not None:
            number = isinstance(value, int | float) and not isinstance(value, bool)
            if not number or not low <= value <= high:
                raise ValueError(f"{axis} must be between {low:g} and {high:g} ({SCALES[scale]}), got {value!r}.")
    return to_z(given, scale, studio.config)


def make_controls(gr, studio):
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
        together = f"takes × duration: at most {MOST_SECONDS:g} s in all"
        low, high = LIMITS["seed"]
        settings = [
            gr.Slider(*LIMITS["steps"], default.steps, step=1, label="Steps of the decoder (LCTG)", info=info),
            gr.Slider(*LIMITS["latent_steps"], default.latent_steps, step=1, label="Steps of DALE"),
            gr.Radio(
                [1, 2], value=default.order, label="Order of the solver", info="a distilled decoder keeps its own"
            ),
            gr.Slider(*LIMITS["guidance"], default.guidance, step=0.05, label="Guidance", info="1 = off"),
            gr.Number(default.seed, label="Seed", precision=0, minimum=low, maximum=high, elem_id="seed"),
            gr.Slider(
                *LIMITS["duration_s"],
                default.duration_s,
                step=0.1,
                label="Duration, s",
                info=together,
                elem_id="duration",
            ),
            gr.Slider(*LIMITS["takes"], default.takes, step=1, label="Takes", info=together, elem_id="takes"),
        ]
    return {"preset": preset, "scale": scale, "ratings": ratings, "open": left_open, "settings": settings}


def _step(scale):
    return 10 ** -digits(scale)


def _rounded(value, low, high, scale):
    """A value where a slider can stand."""
    return round(float(min(max(value, low), high)), digits(scale))


def set_preset(gr, studio, name, scale):
    """Sliders and switches of a preset; a slider whose axis it leaves open stays where it is."""
    if name not in PRESETS:
        raise gr.Error(f"There is no preset {name!r}.", print_exception=False)
    given = PRESETS[name]
    ratings = from_z([0.0 if value is None else value for value in given], scale, studio.config)
    ends = slider_ranges(scale, studio.config)
    within = [_rounded(value, *end, scale) for value, end in zip(ratings, ends, strict=True)]
    sliders = [gr.skip() if z is None else value for z, value in zip(given, within, strict=True)]
    return *sliders, *(value is None for value in given)


def agree(first, second, scale, config):
    """Whether ratings, z-scores, are the same to sliders of this scale, which stand at rounded values only."""
    shown = zip(*(from_z(ratings, scale, config) for ratings in (first, second)), strict=True)
    for (low, high), (one, other) in zip(slider_ranges(scale, config), shown, strict=True):
        if one != one or other != other:  # NaN: not specified
            if one == one or other == other:
                return False
        elif abs(min(max(one, low), high) - min(max(other, low), high)) > 0.51 * _step(scale):
            return False
    return True


def follow_scale(gr, studio, asked):
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
        show_errors(gr, change), [before, asked["scale"], *sliders], [before, *sliders], api_visibility="private"
    )

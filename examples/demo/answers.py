"""Answers as HTML: what the page shows of a result, without the page."""

import math

import numpy as np
from bands import DRAWS
from plots import draw_comparison, draw_result, figure_html
from settings import SCALES, digits, from_z
from sound import sound_html
from strip import strip_html

from tactile_diffusers.data.folder.recording import LARGEST_RMS
from tactile_diffusers.signal import RATING_AXES, REFERENCE_FORCE

#: Stands under every player.
LISTENING = "<p><small>For listening only: resampled, and all textures at one loudness.</small></p>"


def texture_answer(result, take, scale, config):
    """One take: picture, player, numbers and finger strip, four strings of HTML.

    Args:
        result ([`Result`]): of one row of ratings.
        take (`int`): from 0.
        scale (`str`): of `SCALES`.
        config: DALE's.
    """
    texture = result.textures[take]
    picture = figure_html(draw_result(result, take), _alternative("The texture", texture))
    numbers = _table({"": texture}, scale, config, result.usual) + _remark(result, result.usual is not None)
    return picture, sound_html(texture, "the texture") + LISTENING, numbers, strip_html(texture)


def comparison_answer(result, names, scale, config):
    """Textures side by side: picture, players and numbers, three strings of HTML.

    Args:
        result ([`Result`]): one take of each row of ratings.
        names (`Sequence[str]`): of the rows.
        scale (`str`), config: as for `texture_answer`.
    """
    textures = dict(zip(names, result.textures, strict=True))
    return _side_by_side(textures, scale, config, _remark(result))


def reconstruction_answer(made, scale, config):
    """A recording beside its reconstruction: picture, players and numbers, three strings of HTML."""
    textures = {"recorded": made.recorded, "reconstructed": made.decoded}
    remark = (
        f"<p>Nine-band error {made.nine_band_db:.2f} dB (a fingertip tells 2.2–2.5 dB apart). A recording does not "
        "tell its friction coefficient, without which slipperiness is little more than a guess.</p>"
    )
    if made.recorded.rms > LARGEST_RMS:
        remark = (
            f'<p role="status"><strong>RMS {1e3 * made.recorded.rms:.0f} mN is more than textures have</strong> at a '
            f"normal force of {REFERENCE_FORCE} N: set <em>Newtons per unit</em>.</p>" + remark
        )
    return _side_by_side(textures, scale, config, remark)


def edit_answer(made, scale, config):
    """A texture before and after an edit: picture, players and numbers, three strings of HTML."""
    remark = "<p><small>Estimated without a friction coefficient, which an edit does not know.</small></p>"
    return _side_by_side(dict(zip(("before", "after"), made, strict=True)), scale, config, remark)


def _side_by_side(textures, scale, config, remark):
    picture = figure_html(
        draw_comparison(textures), " ".join(_alternative(name, texture) for name, texture in textures.items())
    )
    players = "".join(
        f"<figure><figcaption>{name}</figcaption>{sound_html(texture, name)}</figure>"
        for name, texture in textures.items()
    )
    return picture, f'<div class="players">{players}</div>{LISTENING}', _table(textures, scale, config) + remark


def _alternative(name, texture):
    return (
        f"{name}: {texture.seconds:.2f} s, RMS {1e3 * texture.rms:.2f} mN, friction coefficient "
        f"{_number(texture.friction_coefficient)}."
    )


def _remark(result, usual=False):
    note = f"<p><strong>{result.note}</strong></p>" if result.note else ""
    scatter = f"; usual: of {DRAWS} draws of these ratings, the middle 80 %. Other seeds scatter so" if usual else ""
    return (
        f"{note}<p><small>Estimated: what <code>estimate_ratings</code> finds in the texture, shrunk towards the "
        f"middle as any regression's estimates are{scatter}. Made in {result.seconds:.2f} s.</small></p>"
    )


def _table(textures, scale, config, usual=None):
    """Asked and estimated ratings, friction coefficient and level of textures, by name; `usual`: see [`Result`]."""
    asked = all(texture.seed is not None for texture in textures.values())  # nobody asks anything of a recording
    columns = ["asked"] * asked + ["estimated"] + ["usual"] * (usual is not None)
    heads = "".join(f'<th scope="col">{f"{name} {column}".strip()}</th>' for name in textures for column in columns)
    decimals = digits(scale)
    low, high = (None, None) if usual is None else (from_z(end, scale, config) for end in usual)
    rows = []
    for number, axis in enumerate(RATING_AXES):
        cells = ""
        for texture in textures.values():
            values = {
                "asked": _number(from_z(texture.ratings, scale, config)[number], decimals),
                "estimated": _number(from_z(texture.estimated, scale, config)[number], decimals),
            }
            if usual is not None:
                values["usual"] = f"{_number(low[number], decimals)} to {_number(high[number], decimals)}"
            cells += "".join(f"<td>{values[column]}</td>" for column in columns)
        rows.append(f'<tr><th scope="row">{axis}</th>{cells}</tr>')
    for label, value in (
        ("friction coefficient", lambda texture: _number(texture.friction_coefficient)),
        ("RMS, mN", lambda texture: _number(1e3 * texture.rms)),
        ("seed", lambda texture: "–" if texture.seed is None else str(texture.seed)),
    ):
        cells = "".join(f'<td colspan="{len(columns)}">{value(texture)}</td>' for texture in textures.values())
        rows.append(f'<tr><th scope="row">{label}</th>{cells}</tr>')
    head = f'<thead><tr><th scope="col">{SCALES[scale]}</th>{heads}</tr></thead>'
    return f'<table class="numbers">{head}<tbody>{"".join(rows)}</tbody></table>'


def _number(value, decimals=2):
    return "–" if value is None or math.isnan(value) else f"{np.round(value, decimals) + 0.0:.{decimals}f}"

"""Export: what lies on the strip, in any format, and what a device will lose of it."""

import dataclasses
import tempfile
import threading
import warnings
from functools import partial
from pathlib import Path

import numpy as np
from settings import Settings
from strip import strip_page

from tactile_diffusers import export
from tactile_diffusers.export import DeviceProfile, what_is_lost
from tactile_diffusers.export.png import PIXEL_PITCH
from tactile_diffusers.signal.checks import check_number

#: Profiles to begin with; the numbers are to be corrected by whoever knows the device.
DEVICES = {
    "friction display, 10 kHz": DeviceProfile(10_000, (20.0, 1000.0), True, 16, 0.5),
    "voice coil, 1 kHz": DeviceProfile(1_000, (40.0, 400.0), False, 12, 0.5),
    "phone motor, 500 Hz": DeviceProfile(500, (80.0, 230.0), False, 8, 0.2),
}
#: Where Python keeps what is done with warnings, there is one for all threads.
_WARNINGS = threading.Lock()


def _about(texture):
    return {
        "sampling_rate": texture.sampling_rate,
        "friction_coefficient": texture.friction_coefficient,
        "ratings": texture.ratings,
    }


def _format(write, path, texture, **options):
    made = {"seed": texture.seed, "reference_speed": texture.reference_speed, "checkpoint": texture.checkpoint}
    write(path, texture.samples, **made, **_about(texture), **options)


def _figure(path, texture):
    export.write_figure(path, texture.samples, **_about(texture))


def _strip(path, texture):
    path.write_text(strip_page(texture), encoding="utf-8")


#: Name on the page -> suffix and writer(path, texture).
FORMATS = {
    **{
        f"{one.description} ({one.suffix})": (one.suffix, partial(_format, one.write))
        for one in export.FORMATS.values()
    },
    "picture (.png)": (".png", _figure),
    "finger strip, a page that works alone (.html)": (".html", _strip),
}


#: The format whose pixels have a pitch.
MAP = next(name for name, (suffix, _) in FORMATS.items() if suffix == export.FORMATS["png"].suffix)


def export_tab(desk, tab):
    """The tab."""
    gr, studio, folder = desk.gr, desk.studio, desk.folder
    with gr.Row():
        with gr.Column(min_width=280):
            which = gr.Dropdown([], label="What lies on the strip", elem_id="export-of")
            name = gr.Dropdown(list(FORMATS), value=next(iter(FORMATS)), label="Format", elem_id="format")
            pitch = gr.Number(PIXEL_PITCH, label="Pixel pitch of the display, mm", visible=False, elem_id="pitch")
            loop = gr.Checkbox(label="Close to a loop: the end leads into the beginning", elem_id="loop")
            write = gr.Button("Write the files", variant="primary", elem_id="write")
            files = gr.File(label="Files", file_count="multiple", interactive=False, visible=False, elem_id="files")
            warned = gr.Markdown(elem_id="warned")
        with gr.Column(min_width=320):
            first = next(iter(DEVICES.values()))
            device = gr.Dropdown(list(DEVICES), value=next(iter(DEVICES)), label="Device", elem_id="device")
            with gr.Row():
                numbers = [
                    gr.Number(value, label=label, min_width=110)
                    for label, value in zip(
                        ("Samples a second", "Lowest, Hz", "Highest, Hz", "Bits", "Largest force, N"),
                        _values(first),
                        strict=True,
                    )
                ]
            one_signed = gr.Checkbox(first.one_signed, label="It only adds friction, or only takes it away")
            lost = gr.Markdown(elem_id="lost")

    def known(tracks, place):
        return place if isinstance(place, int) and 0 <= place < len(tracks) else 0

    def look(tracks, place, *given):
        if not tracks:
            return gr.skip(), gr.skip()
        rate, low, high, bits, amplitude, signed = given
        place = known(tracks, place)
        texture, profile = tracks[place][1], DeviceProfile(rate, (low, high), signed, bits, amplitude)
        loss = what_is_lost(texture.samples, texture.sampling_rate, profile)
        choices = [(label, number) for number, (label, _) in enumerate(tracks)]
        return gr.Dropdown(choices, value=place), f"What is lost on it:\n\n{loss}"

    def download(tracks, place, format_name, millimetres, closed):
        if not tracks:
            raise ValueError("There is no texture yet: make one first.")
        texture = tracks[known(tracks, place)][1]
        if closed:
            texture = dataclasses.replace(studio.edit(texture, Settings(), loop=True), seed=texture.seed)
        # a folder of its own, with a name that cannot be guessed
        written, warnings = write_files(texture, format_name, Path(tempfile.mkdtemp(dir=folder)), millimetres)
        return gr.File([str(path) for path in written], visible=True), "\n\n".join(warnings)

    profile = [*numbers, one_signed]
    inputs = [desk.shown, which, *profile]
    desk.on([tab.select, which.input, *(each.change for each in profile)], look, inputs, [which, lost])
    desk.on([device.input], lambda name: (*_values(DEVICES[name]), DEVICES[name].one_signed), device, profile)
    desk.on([name.input], lambda chosen: gr.Number(visible=chosen == MAP), name, pitch)
    desk.on([write.click], download, [desk.shown, which, name, pitch, loop], [files, warned], last=False)


def _values(device):
    return device.rate, *device.band, device.bits, device.amplitude


def write_files(texture, name, folder, pixel_pitch):
    """Writes a texture in one format.

    Args:
        texture ([`Texture`]): what is written.
        name (`str`): of `FORMATS`.
        folder (`Path`): empty; file names are ours, whatever the request.
        pixel_pitch (`float`): mm, for a friction map; others ignore it.

    Returns:
        `tuple[list[Path], list[str]]`: the files, and what their writer warns of.

    Raises:
        ValueError: for an unknown format, or a pitch that no display has.
    """
    if name not in FORMATS:
        raise ValueError(f"The format must be one of {list(FORMATS)}, got {name!r}.")
    suffix, write = FORMATS[name]
    options = {}
    if name == MAP:
        check_number("pixel pitch", pixel_pitch, "mm", above=0)
        options["pixel_pitch"] = float(pixel_pitch)
    with _WARNINGS, warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        write(folder / f"{_stem(texture)}{suffix}", texture, **options)
    # the writers' own, which point here; another thread may warn meanwhile
    told = [str(warning.message) for warning in caught if warning.filename == __file__]
    return sorted(folder.iterdir()), told


def _stem(texture):
    """A name that tells textures apart, of letters, digits, ".", "_" and "-": "texture_0.90_0.50_any_seed1"."""
    parts = (f"{np.round(value, 2) + 0.0:.2f}" if np.isfinite(value) else "any" for value in texture.ratings)
    return f"texture_{'_'.join(parts)}_seed{'-none' if texture.seed is None else texture.seed}"

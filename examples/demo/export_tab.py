"""Export: what lies on the strip, in any format, and what a device will lose of it."""

import dataclasses
import re
import tempfile
import threading
import warnings
from pathlib import Path

from settings import Settings

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
NUMBERS = ("Samples a second", "Lowest, Hz", "Highest, Hz", "Bits", "Largest force, N")
#: Names on the page: keys of `export.FORMATS`, and a picture. The map's pixels have a pitch.
PICTURE = "picture (.png)"
FORMATS = {f"{one.description} ({one.suffix})": key for key, one in export.FORMATS.items()} | {PICTURE: None}
MAP = next(name for name, key in FORMATS.items() if key == "png")
#: Where Python keeps what is done with warnings, there is one for all threads.
_WARNINGS = threading.Lock()


def export_tab(desk, tab):
    """The tab."""
    gr, studio = desk.gr, desk.studio
    lane, first = gr.State(0), next(iter(DEVICES))
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
            device = gr.Dropdown(list(DEVICES), value=first, label="Device", elem_id="device")
            with gr.Row():
                profile = [gr.Number(label=label, min_width=110) for label in NUMBERS]
            profile.append(gr.Checkbox(label="It only adds friction, or only takes it away"))
            for control, value in zip(profile, _values(first), strict=True):
                control.value = value
            lost = gr.Markdown(elem_id="lost")

    def known(tracks, place):
        if not tracks:
            raise ValueError("There is no texture yet: make one first.")
        return place if isinstance(place, int) and 0 <= place < len(tracks) else 0

    def look(tracks, place, rate, low, high, bits, amplitude, signed):
        place = known(tracks, place)
        texture, given = tracks[place][1], DeviceProfile(rate, (low, high), signed, bits, amplitude)
        choices = [(label, number) for number, (label, _) in enumerate(tracks)]
        loss = what_is_lost(texture.samples, texture.sampling_rate, given)
        return gr.Dropdown(choices, value=place), f"What this device loses of it, whatever the file:\n\n{loss}"

    def download(tracks, place, format_name, millimetres, closed):
        label, texture = tracks[known(tracks, place)]
        if closed:
            texture = dataclasses.replace(studio.edit(texture, Settings(), loop=True), seed=texture.seed)
        # a folder of its own, with a name that cannot be guessed
        folder = Path(tempfile.mkdtemp(dir=desk.folder))
        written, told = write_files(texture, format_name, folder, millimetres, file_stem(label, texture))
        return gr.File([str(path) for path in written], visible=True), "\n\n".join(
            f"The file: {words}" for words in told
        )

    def follow(event: gr.EventData):
        return event.lane

    desk.on([desk.strip.select], follow, None, lane)
    desk.on([tab.select, lane.change], look, [desk.shown, lane, *profile], [which, lost])
    changed = [which.input, *(each.change for each in profile)]
    desk.on(changed, look, [desk.shown, which, *profile], [which, lost])
    desk.on([device.input], _values, device, profile)
    desk.on([name.input], lambda chosen: gr.Number(visible=chosen == MAP), name, pitch)
    desk.on([write.click], download, [desk.shown, which, name, pitch, loop], [files, warned], last=False)


def _values(name):
    device = DEVICES[name]
    return device.rate, *device.band, device.bits, device.amplitude, device.one_signed


def file_stem(label, texture):
    """A name that tells textures apart, as the page calls them: "denim_edited_84_50_any_seed6"."""
    shown = ("any" if value is None else f"{value:g}" for value in texture.studio.scale.from_z(texture.ratings))
    words = re.sub(r"\W+", "_", label, flags=re.ASCII).strip("_")
    return "_".join([words or "texture", *shown, *([] if texture.seed is None else [f"seed{texture.seed}"])])


def write_files(texture, name, folder, pixel_pitch, stem):
    """Writes a texture in one format into an empty folder.

    Returns:
        `tuple[list[Path], list[str]]`: the files, and what their writer warns of.

    Raises:
        ValueError: for an unknown format, or a pixel pitch, mm, of a friction map that no display has.
    """
    if name not in FORMATS:
        raise ValueError(f"The format must be one of {list(FORMATS)}, got {name!r}.")
    about = {key: getattr(texture, key) for key in ("sampling_rate", "friction_coefficient", "ratings")}
    if name == PICTURE:
        export.write_figure(folder / f"{stem}.png", texture.samples, **about)
        return sorted(folder.iterdir()), []
    about |= {key: getattr(texture, key) for key in ("seed", "reference_speed", "checkpoint")}
    if name == MAP:
        about["pixel_pitch"] = check_number("pixel pitch", pixel_pitch, "mm", above=0)
    one = export.FORMATS[FORMATS[name]]
    with _WARNINGS, warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        one.write(folder / f"{stem}{one.suffix}", texture.samples, **about)
    # the writers' own, which point here; another thread may warn meanwhile
    return sorted(folder.iterdir()), [str(one.message) for one in caught if one.filename == __file__]

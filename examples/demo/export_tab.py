"""Export: what lies on the strip, in any format, and what a device will lose of it."""

import dataclasses
import tempfile
from pathlib import Path

from downloads import FORMATS, is_map, write_files
from settings import Settings

from tactile_diffusers.export import DeviceProfile, what_is_lost
from tactile_diffusers.export.png import PIXEL_PITCH

#: Profiles to begin with; the numbers are to be corrected by whoever knows the device.
DEVICES = {
    "friction display, 10 kHz": DeviceProfile(10_000, (20.0, 1000.0), True, 16, 0.5),
    "voice coil, 1 kHz": DeviceProfile(1_000, (40.0, 400.0), False, 12, 0.5),
    "phone motor, 500 Hz": DeviceProfile(500, (80.0, 230.0), False, 8, 0.2),
}


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

    def chosen(tracks, place):
        if not tracks:
            raise ValueError("There is no texture yet: make one first.")
        return tracks[place if isinstance(place, int) and 0 <= place < len(tracks) else 0]

    def look(tracks, place, *given):
        if not tracks:
            return gr.skip(), gr.skip()
        rate, low, high, bits, amplitude, signed = given
        texture = chosen(tracks, place)[1]
        loss = what_is_lost(
            texture.samples, texture.sampling_rate, DeviceProfile(rate, (low, high), signed, bits, amplitude)
        )
        choices = [(label, number) for number, (label, _) in enumerate(tracks)]
        place = place if isinstance(place, int) and place < len(tracks) else 0
        return gr.Dropdown(choices, value=place), f"What is lost on it:\n\n{loss}"

    def download(tracks, place, format_name, millimetres, closed):
        texture = chosen(tracks, place)[1]
        if closed:
            texture = dataclasses.replace(studio.edit(texture, Settings(), loop=True), seed=texture.seed)
        # a folder of its own, with a name that cannot be guessed
        written, warnings = write_files(texture, format_name, Path(tempfile.mkdtemp(dir=folder)), millimetres)
        return gr.File([str(path) for path in written], visible=True), "\n\n".join(warnings)

    profile = [*numbers, one_signed]
    inputs = [desk.shown, which, *profile]
    desk.on([tab.select, which.input, *(each.change for each in profile)], look, inputs, [which, lost])
    desk.on([device.input], lambda name: (*_values(DEVICES[name]), DEVICES[name].one_signed), device, profile)
    desk.on([name.input], lambda chosen: gr.Number(visible=is_map(chosen)), name, pitch)
    desk.on([write.click], download, [desk.shown, which, name, pitch, loop], [files, warned], last=False)


def _values(device):
    return device.rate, *device.band, device.bits, device.amplitude

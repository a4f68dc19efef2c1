#!/usr/bin/env python
"""Fills the rows of README, the bundled card and the results' first page, and the pages of `pages/`, with figures.

    python examples/evaluate.py --checkpoint bundled --data prepared.h5 --output examples/results/judges
    python examples/results/first_pages.py            # --check: changes nothing, and fails where a page is stale

A page is stale if its figures are not those of the report, or the report is of other weights than the bundled ones.
"""

import argparse
import json
import re
import sys
from functools import reduce
from pathlib import Path

from tactile_diffusers import bundled_checkpoint
from tactile_diffusers.pipelines.folders import folder_digest

sys.path.append(str(Path(__file__).parents[1]))  # examples, for `report`

from report.result_files import stamp

HERE = Path(__file__).parent
#: Other files of figures, by the name that stands before a path, {peers:batches/Batch 1/...}, and the step of run.py
#: that makes them.
OTHERS = {
    "peers": ("speed/peers.json", "speed"),
    "call": ("speed/speed.json", "speed of a call"),
    "many": ("speed/dataset.json", "many textures"),
    "against": ("speed/speed_error.json", "speed against error"),
    "endless": ("real_time/endless.json", "without end"),
    "stream": ("real_time/stream.json", "other speeds"),
    "scene": ("real_time/scene.json", "a scene"),
    "hard": ("hard_cases/stability.json", "hard cases"),
    "long": ("hard_cases/long_textures.json", "long textures"),
    "decoder": ("steps/decoder.json", "steps"),
    "preparation": ("preparation/data.json", "preparing"),
    "axes": ("new_axis/figures.json", "a new axis"),
    "biotac": ("biotac/report.json", "real recordings"),
}
#: Such that are of no checkpoint, of one of their own, or of one that run.json alone keeps.
DATA = {
    "card": ("data/card.json", "data card"),
    "trained": ("biotac/trained/report.json", "real recordings"),
    "audio": ("audio/audio_distance.json", "audio distance"),
    "latents": ("latents/latents.json", "latents"),
    "solvers": ("scheduler/scheduler.json", "solvers"),
    "editing": ("editing/editing.json", "editing"),
    "ablation": ("ablation/ablation.json", "design"),
    "paper": ("paper_rows/ablation.json", "paper's configuration"),
}
PAGES = (Path(bundled_checkpoint(), "README.md"), HERE.parents[1] / "README.md", HERE / "README.md")
#: Templates of whole pages, which are written beside their folder.
TEMPLATES = HERE / "pages"
#: Rows by words of their first cell or second, and the next two: ours, then what stands beside it. {path|digits} is a
#: mean of the report; "interval" asks for its interval, too, "milli" for thousandths; {path} is text.
ROWS = {
    "unseen surface": (
        "{unseen_surfaces/nine_band_db/model|2|interval}",
        "best regression {regression/same_data/nine_band_db|2}, ridge {unseen_surfaces/nine_band_db/ridge|2}, "
        "blend {unseen_surfaces/nine_band_db/knn_blend|2}, mean spectrum "
        "{unseen_surfaces/nine_band_db/mean_spectrum|2}, another take {unseen_surfaces/nine_band_db/other_take|2}",
    ),
    "hanges of one rating": (
        "{control/counts/model/changes|0} of 36",
        "blend {control/counts/knn_blend/changes|0}, best polynomial {control/counts/regression/changes|0} (given "
        "{settings/equal_surfaces} surfaces {control/counts/knn_blend_equal/changes|0} and "
        "{control/counts/regression_equal/changes|0}), ridge {control/counts/ridge/changes|0}, no change "
        "{control/counts/none/changes|0}, ratings permuted "
        "{control/counts/permuted/changes|0}, real halves {control/counts/null/changes|1}",
    ),
    "KTD of generated": (
        "{generation/1.0/ktd_excess|2|interval}",
        "another take {generation/baselines/other_take/ktd_excess|2|interval}, blend "
        "{generation/baselines/knn_blend/ktd_excess|2|interval}, ridge "
        "{generation/baselines/ridge/ktd_excess|2|interval}",
    ),
    "econstruction: nine-band": (
        "{reconstruction/decoders/lctg/nine_band_db|3}",
        "no network {reconstruction/decoders/no_network/nine_band_db|3}, levels not restored "
        "{reconstruction/decoders/nothing_imposed/nine_band_db|2}, another take "
        "{reconstruction/baselines/other_take/nine_band_db|2}",
    ),
    "econstruction: KTD": (
        "{reconstruction/decoders/lctg/ktd_excess|2|interval}",
        "no network {reconstruction/decoders/no_network/ktd_excess|2|interval}, another take "
        "{reconstruction/baselines/other_take/ktd_excess|2|interval}; base layer alone "
        "{reconstruction/decoders/lctg_base/ktd_excess|2|interval}, without network "
        "{reconstruction/decoders/no_network_base/ktd_excess|2|interval}",
    ),
    "econstruction: SNR": (
        "{reconstruction/decoders/lctg/snr_db|2}",
        "no network {reconstruction/decoders/no_network/snr_db|2}, silence "
        "{reconstruction/baselines/silence/snr_db|2}, another take {reconstruction/baselines/other_take/snr_db|2}",
    ),
    "atings to 1.64 s of texture": (
        "{peers:batches/Batch 1/ours, default call/s|3} (ten steps {peers:batches/Batch 1/ours/s|3})",
        "in ten steps, untrained: audio-diffusion-pytorch as published "
        "{peers:batches/Batch 1/audio-diffusion-pytorch, as published/s|3}, at "
        "our size {peers:batches/Batch 1/audio-diffusion-pytorch, at our size/s|3}, UNet1DModel of 18 M "
        "{peers:batches/Batch 1/UNet1DModel, 18 M/s|3}",
    ),
    "new ratings until": (
        "{endless:starts/distilled decoder/change felt ms|1}",
        "undistilled decoder {endless:starts/undistilled decoder/change felt ms|1}",
    ),
    "reconstruction RMSE, mN": (
        "11.4",
        "{reconstruction/decoders/lctg/rmse_n|2|milli} (silence {reconstruction/baselines/silence/rmse_n|2|milli}, "
        "another take {reconstruction/baselines/other_take/rmse_n|2|milli})",
    ),
    "reconstruction SNR, dB": ("−1.87", "{reconstruction/decoders/lctg/snr_db|2}"),
}
FIELD = re.compile(r"\{(?:(\w+):)?([^|}]+)(?:\|(\d)(?:\|(interval|milli))?)?\}")
SLASH = re.compile("(?<!mm)/")  # not that of mm/s


def filled(template, reports, intervals):
    """A template with the figures of the reports; intervals only where a page has room."""

    def figure(match):
        name, path, digits, form = match.groups()
        leaf = reduce(lambda part, key: part[key], SLASH.split(path), reports[name])
        if digits is None:
            return str(leaf)
        value = leaf["mean"] if isinstance(leaf, dict) else leaf
        text = f"{value * (1000 if form == 'milli' else 1):.{digits}f}"
        if form == "interval" and intervals:
            text += " [{:.{d}f}, {:.{d}f}]".format(*leaf["interval"], d=digits)
        return text

    return FIELD.sub(figure, template)


def page_with_figures(text, reports, intervals):
    """The text of a page whose rows hold the figures of the reports."""
    lines = text.split("\n")
    for words, cells in ROWS.items():
        found = [i for i, line in enumerate(lines) if line.startswith("|") and words in line]
        if not found:
            continue
        [number] = found
        parts = lines[number].split(" | ")
        place = next(i for i, part in enumerate(parts) if words in part) + 1
        ends = parts[place + 1].endswith(" |")
        parts[place : place + 2] = (filled(cell, reports, intervals) for cell in cells)
        lines[number] = " | ".join(parts) + (" |" if ends else "")
    return "\n".join(lines)


def stamps(template, found):
    """Under which conditions the figures of a template were measured: a line for each step of run.py."""
    names = dict.fromkeys(match[0] for match in FIELD.findall(template))
    steps = dict.fromkeys("judges" if not name else (OTHERS | DATA)[name][1] for name in names)
    return "".join(f"\n{stamp(found[step])}\n" for step in steps if step in found)


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="change nothing; fail if a page is stale")
    parser.add_argument("--results", type=Path, default=HERE, help="figures, and where pages go; default: ours")
    args = parser.parse_args(argv)
    files = {None: ("judges/report.json", "judges")} | OTHERS | DATA
    reports, digest, stale = {}, folder_digest(bundled_checkpoint()), []
    for name, (path, _) in files.items():
        path = args.results / path
        if not path.exists():  # a check leaves steps out; a page that needs it says so
            continue
        reports[name] = json.loads(path.read_text())
        if name not in DATA and (reports[name] | reports[name].get("conditions", {}))["checkpoint"]["sha256"] != digest:
            stale.append(f"{path.name} is of another checkpoint than the bundled one: run results/run.py.")
    record = args.results / "run.json"
    found = json.loads(record.read_text()) if record.exists() else {}
    written = {}
    for template in [*TEMPLATES.iterdir(), *PAGES]:
        text, page = template.read_text(), args.results / template.name
        try:
            if template in PAGES:
                page = template if args.results == HERE else page
                written[page] = page_with_figures(text, reports, intervals=template == PAGES[-1])
            else:
                written[page] = filled(text, reports, intervals=True) + stamps(text, found)
        except KeyError as missing:
            if args.results == HERE:
                raise
            print(f"{page.name} is left out: {missing} was not measured.", file=sys.stderr)
    for path, made in written.items():
        text = path.read_text() if path.exists() else ""
        if made != text and args.check:
            stale.append(f"{path} holds other figures than its reports: run first_pages.py.")
        elif made != text:
            path.write_text(made)
    print(*stale, sep="\n", file=sys.stderr)
    return bool(stale)


if __name__ == "__main__":
    sys.exit(main())

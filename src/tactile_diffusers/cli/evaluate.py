"""`python examples/evaluate.py`: what a checkpoint does on held-out surfaces, as tables and pictures."""

import argparse
import json
from pathlib import Path


def parse_arguments(argv=None):
    """Arguments of the command.

    Raises:
        SystemExit: on bad arguments, with exit code 2 and a line that says what is wrong.
    """
    parser = argparse.ArgumentParser(prog="evaluate.py", description="Evaluate a checkpoint on held-out surfaces.")
    parser.add_argument("--checkpoint", metavar="FOLDER", help="default: the bundled checkpoint")
    parser.add_argument("--data", type=Path, required=True, metavar="PREPARED.h5", help="from examples/prepare_data.py")
    parser.add_argument("--output", type=Path, required=True, metavar="FOLDER", help="report.json, report.md, pictures")
    parser.add_argument("--split", choices=["validation", "test"], default="test", help="held-out surfaces")
    parser.add_argument("--steps", type=int, nargs="+", default=[4, 10, 25], help="LCTG steps to compare")
    parser.add_argument("--per-surface", type=int, default=4, help="non-overlapping segments per surface")
    parser.add_argument("--takes", type=int, default=40, help="textures per rating of the sweeps")
    parser.add_argument("--guidance-scale", type=float, default=1.0, help="of the sweeps")
    parser.add_argument("--sections", nargs="+", choices=SECTIONS, default=list(SECTIONS))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--quiet", action="store_true", help="no progress bars")
    arguments = parser.parse_args(argv)
    if not arguments.data.is_file():
        parser.error(f"argument --data: {arguments.data} is not a file; write one with examples/prepare_data.py")
    for name in ("per_surface", "takes"):
        if getattr(arguments, name) < 1:
            parser.error(f"argument --{name.replace('_', '-')}: must be at least 1, got {getattr(arguments, name)}")
    if min(arguments.steps) < 1:
        parser.error(f"argument --steps: must be at least 1, got {arguments.steps}")
    return arguments


def _reconstruction(arguments, pipe):
    from ..data import PreparedDataset
    from ..evaluation.study import reconstruction_study
    from ..evaluation.tables import markdown_table

    held_out = PreparedDataset(arguments.data, arguments.split)
    reference = PreparedDataset(arguments.data, "train")
    table = reconstruction_study(
        pipe, held_out, reference, arguments.steps, arguments.per_surface, arguments.seed, arguments.quiet
    )
    surfaces = len(set(held_out.surface_ids))
    note = (
        f"{table['real (held out)']['segments']} segments of {surfaces} {arguments.split} surfaces, {held_out.source}."
    )
    return table, f"## Reconstruction\n\n{note}\n\n{markdown_table(table)}\n"


def _generation(arguments, pipe):
    from ..data import PreparedDataset
    from ..evaluation.study import generation_study
    from ..evaluation.tables import markdown_table

    held_out = PreparedDataset(arguments.data, arguments.split)
    reference = PreparedDataset(arguments.data, "train")
    table = generation_study(
        pipe,
        held_out,
        reference,
        8,
        guidance_scale=arguments.guidance_scale,
        seed=arguments.seed,
        quiet=arguments.quiet,
    )
    note = f"Eight textures from the ratings of each {arguments.split} surface; guidance {arguments.guidance_scale:g}."
    return table, f"## Generation for unseen surfaces\n\n{note}\n\n{markdown_table(table)}\n"


def _sweep(arguments, pipe):
    from ..evaluation.figures import plot_sweeps
    from ..evaluation.study import rating_sweep
    from ..evaluation.tables import markdown_table

    sweeps = {
        axis: rating_sweep(
            pipe, axis, takes=arguments.takes, guidance_scale=arguments.guidance_scale, seed=arguments.seed
        )
        for axis in pipe.dale.config.rating_axes
    }
    plot_sweeps(sweeps, arguments.output / "sweep.png")
    rows = {
        axis: {
            "level, first to last value, dB": sweep["level_db"][-1] - sweep["level_db"][0],
            "nine-band shape change, dB": sweep["shape_db"],
            "log friction change": sweep["log_friction"][-1] - sweep["log_friction"][0],
            "Spearman level": sweep["spearman"]["level_db"],
            "Spearman 150-400 Hz share": sweep["spearman"]["share_150_400"],
            "Spearman log friction": sweep["spearman"]["log_friction"],
        }
        for axis, sweep in sweeps.items()
    }
    plain = {
        axis: {k: v for k, v in sweep.items() if k not in ("frequencies", "spectrum_db")}
        for axis, sweep in sweeps.items()
    }
    note = f"One rating from -2 to 2 in nine values, the others not specified, {arguments.takes} takes each."
    return plain, f"## One rating at a time\n\n{note}\n\n{markdown_table(rows)}\n\n![spectra](sweep.png)\n"


def _long(arguments, pipe):
    from ..evaluation.study import long_texture_study
    from ..evaluation.tables import markdown_table

    found = long_texture_study(pipe, [[None] * 3] * 4, seed=arguments.seed)
    row = {"level, dB": found["overlap_rms_db"], "largest band, dB": max(found["overlap_bands_db"], key=abs)}
    row["largest correlation with itself a second or more away"] = found["largest_correlation"]
    note = "Four textures of 30 s, nothing specified: where windows overlap against elsewhere."
    return found, f"## Long textures\n\n{note}\n\n{markdown_table({'overlaps': row})}\n"


SECTIONS = {"reconstruction": _reconstruction, "generation": _generation, "sweep": _sweep, "long": _long}


def main(argv=None):
    """Runs the command; sections that need DALE are left out for a pipeline without one."""
    arguments = parse_arguments(argv)
    from tactile_diffusers import TactileTexturePipeline, bundled_checkpoint

    pipe = TactileTexturePipeline.from_pretrained(str(arguments.checkpoint or bundled_checkpoint()))
    pipe.set_progress_bar_config(disable=True)
    arguments.output.mkdir(parents=True, exist_ok=True)
    report, text = {}, []
    for name in arguments.sections:
        if pipe.dale is None and name != "reconstruction":
            continue
        report[name], section = SECTIONS[name](arguments, pipe)
        text.append(section)
        print(section)
    (arguments.output / "report.json").write_text(json.dumps(report, indent=2) + "\n")
    (arguments.output / "report.md").write_text("\n".join(text))
    return 0

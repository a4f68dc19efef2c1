"""report.md: the tables of a report."""

from ..training.record import warning
from .control_tables import (
    control_effect_markdown,
    control_markdown,
    generation_markdown,
    novel_markdown,
    response_markdown,
    unseen_markdown,
)
from .labels import BANDS, COMPARED_STEPS, NAMES, PAPER, SPECTRAL, compared_steps, default_guidance, default_steps
from .tables import markdown_table, text, title

#: Fewer held-out surfaces than this are too few for distances between distributions.
ENOUGH_SURFACES = 5


def report_markdown(report, pictures=".", level=1, short=False):
    """The tables of a report as Markdown.

    Args:
        report (`dict`): of `run_sections`.
        pictures (`str`): folder of the pictures, as the text links to it.
        level (`int`): of the first heading.
        short (`bool`): without the tables of bands, steps and speed, for a model card.

    Returns:
        `str`
    """
    writers = {
        "reconstruction": (_reconstruction, _bands, _steps, *((_anchors,) if report.get("anchors") else ())),
        "generation": (generation_markdown,),
        "unseen_surfaces": (unseen_markdown,),
        "control": (control_effect_markdown, control_markdown, response_markdown),
        "novel": (novel_markdown,),
        "paper": (_paper,),
        "speed": (_speed,),
    }
    parts = [_head(report, level), _overview(report, level + 1)]
    for key, section in writers.items():
        if report.get(key):
            parts += [write(report, level + 1, pictures) for write in section if not (short and write in _LONG)]
    return "\n\n".join(parts) + "\n"


def _head(report, level):
    data, machine = report["data"], report["machine"]
    facts = (
        f"Checkpoint `{report['checkpoint']['name']}` on {data['segments']} segments of {data['surfaces']} surfaces of "
        f"the split {data['split']}; {data['source']}. Reference of the distances: {data['reference_segments']} "
        f"segments of {data['reference_surfaces']} training surfaces. Seed {report['seed']}; {machine['processor']}, "
        f"{machine['threads']} threads. Brackets: 95 % intervals over surfaces. Silence has an SNR of 0 dB, another "
        "take of the same surface about −3 dB."
    )
    return title("Report" if level == 1 else "Measured", level) + "\n\n".join([*_warnings(report), facts])


def _warnings(report):
    count = report["data"]["surfaces"]
    if seen := warning(report.get("seen_in_training"), count):
        yield f"**Warning: {seen}.**"
    if count < ENOUGH_SURFACES:
        yield f"**Warning: too few surfaces to judge distances by ({count}): differences between them are chance.**"


def _overview(report, level):
    """The paper's figures beside silence, another take, and the checkpoint."""
    columns, rows = ["paper, on SENS3", "silence", "another take", "this checkpoint"], {}
    if report.get("reconstruction"):
        section, default = report["reconstruction"], default_steps(report)
        counts = dict.fromkeys([default, compared_steps(section["steps"])])
        columns = [*columns[:3], *(f"this checkpoint, {count} steps" for count in counts)]
        rows |= _overview_of_reconstruction(report, columns, counts)
    paper, ours = columns[0], columns[3]
    if report.get("speed"):
        for key, label in (("segment", "real-time steps, segment"), ("block_100ms", "real-time steps, 0.1 s block")):
            steps = text(report["speed"][key]["real_time_steps"], 0)
            rows[label] = {paper: PAPER["real_time_steps"] if key == "segment" else "–", ours: f"{steps} (CPU)"}
    if report.get("generation"):
        rmse = report["generation"][default_guidance(report)]["rmse_protocol_n"]["mean"]
        shown = text(None if rmse is None else 1e3 * rmse)
        rows["full-pipeline RMSE (random ratings), mN"] = {paper: PAPER["rmse_protocol_mn"], ours: shown}
    if report.get("paper"):
        sweeps = report["paper"]["latent_shift_percent"].values()
        shifts = [values[end]["mean"] for values in sweeps for end in ("-2.0", "2.0")]
        shown = f"{min(shifts):.0f}–{max(shifts):.0f}"
        rows["latent shift at ±2, %"] = {paper: PAPER["latent_shift_percent"], ours: shown}
    return title("Overview", level) + markdown_table(rows, labels={column: column for column in columns})


def _overview_of_reconstruction(report, columns, counts):
    section, rows = report["reconstruction"], {}
    base, real = section["baselines"], section["real"]["rms_n"]["mean"]
    sources = (base["silence"], base["other_take"], *(section["steps"][count] for count in counts))
    in_newtons = f" (RMS of the segments {1e3 * real:.2f})" if report["data"]["unit"] == "N" else ""
    for key, (label, scale, digits) in {
        "rmse_n": (f"reconstruction RMSE, mN{in_newtons}", 1e3, 2),
        "snr_db": ("reconstruction SNR, dB", 1, 2),
        "power_difference_n2": ("mean power difference, N²", 1, 6),
        "power_difference_percent": ("the same, % of the mean power", 1, 2),
    }.items():
        means = [source[key]["mean"] for source in sources]
        shown = [text(None if mean is None else scale * mean, digits) for mean in means]
        rows[label] = dict(zip(columns, [PAPER[key], *shown], strict=True))
    fewest = text(section["steps_within_5_percent"], 0)
    rows["fewest steps within 5 % of the best nine-band error"] = {columns[0]: PAPER["best_steps"], columns[3]: fewest}
    return rows


def _reconstruction_rows(report):
    section = report["reconstruction"]
    shown = [count for count in ("2", "3", "5", "10", "25") if count in section["steps"]] or list(section["steps"])
    rows = {"real, held out": section["real"]}
    rows |= {f"**LCTG, {count} steps**": section["steps"][count] for count in shown}
    for name, anchor in (report.get("anchors") or {}).items():
        count = compared_steps(anchor["steps"])
        rows[f"{name}, {count} steps"] = anchor["steps"][count]
    rows |= {NAMES[slug]: entry for slug, entry in section["baselines"].items()}
    return rows | {"a different surface": section["different_surface"]}


def _reconstruction(report, level, pictures):
    note = "The level of a reconstruction is set after decoding: its error is zero by construction."
    table = markdown_table(_reconstruction_rows(report), labels=SPECTRAL)
    picture = f"![best, median and worst segment]({pictures}/overlays.png)"
    return title("Reconstruction (LCTG)", level) + f"{note}\n\n{table}\n\n{picture}"


def _bands(report, level, pictures):
    table = markdown_table(_reconstruction_rows(report), labels=BANDS)
    return title("Signed level error by band, dB", level) + table


def _steps(report, level, pictures):
    labels = {
        "nine_band_db": "nine-band error, dB",
        "ktd": "KTD",
        "snr_db": "SNR, dB",
        "rmse_n": ("RMSE, N", 5),
        "seconds_per_segment": ("s per segment", 4),
        "efficiency_score": ("efficiency score (RMSE × s), N·s", 6),
    }
    rows = {f"{count} steps": entry for count, entry in report["reconstruction"]["steps"].items()}
    return title("Steps", level) + markdown_table(rows, labels=labels) + f"\n\n![steps]({pictures}/steps.png)"


def _anchors(report, level, pictures):
    """The checkpoint and the anchors at one number of steps, with the cost of their trainings."""
    section, rows = report["reconstruction"], {}
    ours = {key: section[key] for key in ("steps", "kilobits_per_second")} | {"training": report["training"]}
    for name, entry in {"**this checkpoint**": ours, **report["anchors"]}.items():
        count, facts = compared_steps(entry["steps"]), entry["training"]
        rows[f"{name}, {count} steps"] = entry["steps"][count] | {
            "optimiser_steps": facts["optimiser_steps"],
            "minutes": None if facts["seconds"] is None else facts["seconds"] / 60,
            "parameters": facts["parameters"] / 1e6,
            "kilobits_per_second": entry["kilobits_per_second"],
        }
    labels = {
        "optimiser_steps": "optimiser steps",
        "minutes": ("training, minutes", 0),
        "parameters": "parameters, million",
        "kilobits_per_second": "latents, kbit/s",
        "nine_band_db": "nine-band error, dB",
        "ktd_excess": "KTD over real",
        "snr_db": "SNR, dB",
        "power_bias_percent": "difference of the mean power, %",
        "seconds_per_segment": ("s per segment", 4),
    }
    note = (
        f"The same segments, {COMPARED_STEPS} steps where they were measured. Training counts all phases of LCTG. The "
        "rate counts the noise that the latents were trained with, or half precision."
    )
    table, picture = markdown_table(rows, labels=labels), f"![beside the anchors]({pictures}/beside.png)"
    return title("Beside other checkpoints", level) + f"{note}\n\n{table}\n\n{picture}"


def _paper(report, level, pictures):
    note = (
        "Mean spectra while one rating runs and the others are drawn at random (section 3.4), and the shift of the "
        "latent (section 3.3)."
    )
    shown = f"![mean spectra]({pictures}/spectra.png)\n\n![latent shift]({pictures}/latent_shift.png)"
    return title("The paper's protocols", level) + f"{note}\n\n{shown}"


def _speed(report, level, pictures):
    speed = report["speed"]
    labels = {
        "duration_s": ("lasts, s", 4),
        "seconds_per_step": ("s per step", 4),
        "real_time_steps": ("real-time steps", 0),
    }
    rows = {"segment": speed["segment"], "block": speed["block_100ms"]}
    others = [f"{key.replace('_', ' ')} {text(leaf, 4)}" for key, leaf in speed.items() if "mean" in leaf]
    return title("Speed", level) + markdown_table(rows, labels=labels) + "\n\n" + "; ".join(others) + "."


_LONG = (_bands, _steps, _speed)

"""report.md and README's results: tables written from a report, and nothing else."""

from ..training.surfaces import warning
from .labels import (
    BANDS,
    COMPARED_STEPS,
    NAMES,
    PAPER,
    SPECTRAL,
    compared_steps,
    default_guidance,
    default_steps,
)
from .study_report import latents_markdown, robustness_markdown
from .study_report_ratings import (
    control_markdown,
    generation_markdown,
    novel_markdown,
    obedience_markdown,
    paper_figures_markdown,
    responses_markdown,
    unseen_markdown,
)
from .tables import markdown_table, text, title
from .training_record import FLAT
from .winners import baselines_that_win

#: Fewer judged surfaces than this say nothing of distances between distributions (recipe).
ENOUGH_SURFACES = 5


def report_markdown(report):
    """The whole report as Markdown."""
    writers = {
        "reconstruction": (_reconstruction, _bands, _steps, *((_beside,) if report.get("anchors") else ())),
        "generation": (generation_markdown,),
        "unseen_surfaces": (unseen_markdown,),
        "control": (obedience_markdown, control_markdown, responses_markdown),
        "novel": (novel_markdown,),
        "paper": (paper_figures_markdown,),
        "speed": (_speed,),
        "long_textures": (_long,),
        "latents": (lambda whole: latents_markdown(whole["latents"]) + "\n\n![latents](latents.png)",),
        "robustness": (lambda whole: robustness_markdown(whole["robustness"]),),
    }
    parts = [_head(report), _side_by_side(report)]
    for key, section in writers.items():
        if report.get(key):
            parts += [writer(report) for writer in section]
    return "\n\n".join([*parts, _baselines_that_win(report)]) + "\n"


def readme_markdown(report, figures):
    """README's results: the tables that matter most, and the pictures under `figures` (a path in README's folder)."""
    parts = [_head(report, level=3), _side_by_side(report, 4)]
    if report.get("reconstruction"):
        parts += [_reconstruction(report, 4), f"![best, median and worst segment]({figures}/overlays.png)"]
        if report.get("anchors"):
            parts.append(_beside(report, 4, figures))
    if report.get("control"):
        parts += [obedience_markdown(report, 4), f"![one rating at a time]({figures}/control.png)"]
        parts += [responses_markdown(report, 4), control_markdown(report, 4)]
    if report.get("paper"):
        what = "Mean spectra while one rating runs and the others are drawn at random (paper, section 3.4):"
        parts.append(f"{what}\n\n![mean spectra]({figures}/spectra.png)")
    if report.get("unseen_surfaces"):
        parts += [unseen_markdown(report, 4), generation_markdown(report, 4)]
    if report.get("novel"):
        parts.append(novel_markdown(report, 4))
    if report.get("long_textures"):
        parts.append(_long(report, 4))
    return "\n\n".join([*parts, _baselines_that_win(report, 4)]) + "\n"


def _head(report, level=1):
    data, machine = report["data"], report["machine"]
    facts = (
        f"Checkpoint `{report['checkpoint']['name']}` on {data['segments']} segments of {data['surfaces']} "
        f"surfaces that the data hold out as {data['split']}; {data['source']}. Reference of the distances: "
        f"{data['reference_segments']} segments of {data['reference_surfaces']} training surfaces. Seed "
        f"{report['seed']}; {machine['processor']}, {machine['threads']} threads. Brackets: 95 % intervals over "
        "surfaces. A silent output has an SNR of 0 dB, a second take of the same surface about −3 dB: read waveform "
        "figures beside those rows only."
    )
    return title("Report" if level == 1 else "Measured", level) + "\n\n".join([*_warnings(report), facts])


def _warnings(report):
    """What makes a report worth less than it seems: it stands before everything else."""
    count = report["data"]["surfaces"]
    if seen := warning(report.get("seen_in_training"), count):
        yield f"**Warning: {seen}.**"
    if count < ENOUGH_SURFACES:
        yield f"**Warning: too few surfaces to judge distances by ({count}): differences between them are chance.**"


def _side_by_side(report, level=2):
    """What the paper reports, two yardsticks and ours: with the default steps and with those of the paper."""
    columns, rows = ("paper, on SENS3", "silence", "another take", "ours"), {}
    if report.get("reconstruction"):
        section, default = report["reconstruction"], default_steps(report)
        counts = dict.fromkeys([default, compared_steps(section["steps"])])
        columns = (*columns[:3], *(f"ours, {count} steps" for count in counts))
        base = section["baselines"]
        sources = (base["silence"], base["other_take"], *(section["steps"][count] for count in counts))
        newtons = report["data"]["unit"] == "N"
        real = f" (RMS of the segments {1e3 * section['real']['rms_n']['mean']:.2f})" if newtons else ""
        for key, (label, scale, digits) in {
            "rmse_n": (f"reconstruction RMSE, mN{real}", 1e3, 2),
            "snr_db": ("reconstruction SNR, dB", 1, 2),
            "power_difference_n2": ("mean power difference, N²", 1, 6),
            "power_difference_percent": ("the same, % of the mean power", 1, 2),
        }.items():
            values = [source[key]["mean"] for source in sources]
            shown = [text(None if value is None else scale * value, digits) for value in values]
            rows[label] = dict(zip(columns, [PAPER[key], *shown], strict=True))
        rows["fewest steps within 5 % of the best nine-band error"] = {
            columns[0]: PAPER["best_steps"],
            columns[3]: text(section["steps_within_5_percent"], 0),
        }
        best = {n: entry["efficiency_score"]["mean"] for n, entry in section["steps"].items()}
        if None not in best.values():
            rows["best RMSE × time at (steps)"] = {columns[0]: PAPER["best_steps"], columns[3]: min(best, key=best.get)}
    if report.get("speed"):
        for key, label in (("segment", "real-time steps, segment"), ("block_100ms", "real-time steps, 0.1 s block")):
            paper = PAPER["real_time_steps"] if key == "segment" else "–"
            steps = text(report["speed"][key]["real_time_steps"], 0)
            rows[label] = {columns[0]: paper, columns[3]: f"{steps} (CPU)"}
    if report.get("generation"):
        entry = report["generation"][default_guidance(report)]
        rmse = entry["rmse_protocol_n"]["mean"]
        shown = text(None if rmse is None else 1e3 * rmse)
        rows["full-pipeline RMSE (random ratings), mN"] = {columns[0]: PAPER["rmse_protocol_mn"], columns[3]: shown}
        for name in [key for key in entry if key.startswith("fad_") and not key.endswith(("_real_real", "_matched"))]:
            real = text(entry[f"{name}_real_real"])
            ours = (
                f"{text(entry[name])} ({entry[name]['n']} textures), {text(entry[f'{name}_matched'])} at equal number"
            )
            label = f"Fréchet audio distance ({name[4:].replace('_', '-')} embedding, not VGGish)"
            rows[label] = {columns[0]: PAPER["fad"], columns[2]: f"{real} (held-out real)", columns[3]: ours}
    if report.get("paper"):
        shifts = [
            values[end]["mean"]
            for values in report["paper"]["latent_shift_percent"].values()
            for end in ("-2.0", "2.0")
        ]
        rows["latent shift at ±2, %"] = {
            columns[0]: PAPER["latent_shift_percent"],
            columns[3]: f"{min(shifts):.0f}–{max(shifts):.0f}",
        }
    return title("Paper, yardsticks, ours", level) + markdown_table(rows, labels={column: column for column in columns})


def _rows(report, steps):
    section = report["reconstruction"]
    rows = {"real, held out": section["real"]}
    rows |= {f"**LCTG, {count} steps**": section["steps"][count] for count in steps}
    for name, anchor in (report.get("anchors") or {}).items():
        swept = anchor["steps"]
        errors = {n: swept[n]["nine_band_db"]["mean"] for n in swept if swept[n]["nine_band_db"]["mean"] is not None}
        best, shown = min(errors, key=errors.get, default=None), compared_steps(swept)
        rows |= {
            f"{name}, {count} steps" + (" (its best)" if count == best else ""): swept[count]
            for count in dict.fromkeys([shown, best or shown])
        }
    rows |= {NAMES[slug]: entry for slug, entry in section["baselines"].items()}
    return rows | {"a different surface": section["different_surface"]}


def _shown_steps(report):
    steps = report["reconstruction"]["steps"]
    return [count for count in ("2", "3", "5", "10", "25") if count in steps] or list(steps)


def _reconstruction(report, level=2):
    table = markdown_table(_rows(report, _shown_steps(report)), labels=SPECTRAL)
    note = "The level of a reconstruction is set after decoding, so its error is nothing by construction."
    return title("Reconstruction (LCTG)", level) + note + "\n\n" + table


def _bands(report, level=2):
    table = markdown_table(_rows(report, _shown_steps(report)), labels=BANDS)
    return title("Signed level error by band, dB", level) + table


def _steps(report, level=2):
    labels = {
        "nine_band_db": "nine-band error, dB",
        "ktd": "KTD",
        "snr_db": "SNR, dB",
        "rmse_n": ("RMSE, N", 5),
        "seconds_per_segment": ("s per segment", 4),
        "efficiency_score": ("efficiency score, N·s", 6),
    }
    rows = {f"{count} steps": entry for count, entry in report["reconstruction"]["steps"].items()}
    pictures = "![steps](steps.png)\n\n![best, median and worst segment](overlays.png)"
    return title("Steps", level) + markdown_table(rows, labels=labels) + "\n\n" + pictures


def _beside(report, level=2, figures="."):
    """Ours and the anchors at the same number of steps, with what their trainings took."""
    section = report["reconstruction"]
    ours = {key: section[key] for key in ("steps", "kilobits_per_second")} | {"training": report["training"]}
    rows, machines = {}, {}
    for name, entry in {"**ours**": ours, **report["anchors"]}.items():
        shown, facts = compared_steps(entry["steps"]), entry["training"]
        leaves, seconds, change = entry["steps"][shown], facts["seconds"], facts["flattening"]
        rows[f"{name}, {shown} steps"] = leaves | {
            "optimiser_steps": facts["optimiser_steps"],
            "minutes": None if seconds is None else seconds / 60,
            "parameters": facts["parameters"] / 1e6,
            "kilobits_per_second": entry["kilobits_per_second"],
            "bands": ", ".join(_signed(leaves[key]["mean"]) for key in BANDS),
            "flattened": change if change is None else f"{('no', 'yes')[abs(change) < FLAT]} ({100 * change:+.2f} %)",
        }
        if facts["machines"]:
            machines[name.strip("*")] = "; ".join(facts["machines"])
    labels = {
        "optimiser_steps": "optimiser steps",
        "minutes": ("training, minutes", 0),
        "parameters": "parameters, million",
        "kilobits_per_second": "latents, kbit/s",
        "nine_band_db": "nine-band error, dB",
        "ktd_excess": "KTD over real",
        "snr_db": "SNR, dB",
        "power_bias_percent": "difference of the mean power, %",
        "bands": f"signed error of {', '.join(BANDS.values())}, dB",
        "seconds_per_segment": ("s per segment", 4),
        "flattened": "loss flattened",
    }
    note = (
        f"The very same segments, {COMPARED_STEPS} steps where they were measured. Training is that of LCTG, all "
        "phases; a loss has flattened where its mean changes by less than 1 % from the fourth to the last fifth of the "
        "last phase. The rate counts the noise that the latents were trained with, or half precision where there is "
        "none. Wall times compare on one machine only"
        + "".join(f"; {name}: {machine}" for name, machine in machines.items())
        + "."
    )
    table, picture = markdown_table(rows, labels=labels), f"![ours beside the anchors]({figures}/beside.png)"
    return title("Beside the paper's configuration", level) + f"{note}\n\n{table}\n\n{picture}"


def _signed(value):
    return text(value) if value is None else f"{value:+.2f}"


def _speed(report, level=2):
    speed = report["speed"]
    rows = {
        name: {key: speed[part][key] for key in ("duration_s", "seconds_per_step", "real_time_steps")}
        for name, part in (("segment", "segment"), ("block", "block_100ms"))
    }
    labels = {
        "duration_s": ("lasts, s", 4),
        "seconds_per_step": ("s per step", 4),
        "real_time_steps": ("real-time steps", 0),
    }
    words = [f"{key.replace('_', ' ')} {text(speed[key], 4)}" for key in speed if key not in ("segment", "block_100ms")]
    return title("Speed", level) + markdown_table(rows, labels=labels) + "\n\n" + "; ".join(words) + "."


def _long(report, level=2):
    found = report["long_textures"]
    labels = {
        "overlap_level_db": "level where windows overlap against elsewhere, dB",
        "overlap_bands_db": "mean over bands, dB",
        "largest_correlation": "largest correlation with itself a second or more away",
    }
    name = f"{found['seconds']['n']} × {text(found['seconds'], 0)} s"
    return title("Long textures", level) + markdown_table({name: found}, labels=labels)


def _baselines_that_win(report, level=2):
    found = baselines_that_win(report)
    lines = [f"- {label}: {', '.join(winners)}" for label, winners in found] or ["- nowhere in the metrics compared"]
    note = (
        "Reconstruction is compared with every baseline and anchor, generation with those that know ratings or "
        "nothing. Another take and the phase-randomised copy are told the recording itself."
    )
    return title("Where a baseline still wins", level) + note + "\n\n" + "\n".join(lines)

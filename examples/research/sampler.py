"""Which sampler, in how many steps? `python examples/research/sampler.py --data prepared.h5 --output report`"""

import statistics
import sys
import time
from pathlib import Path

import numpy as np
import solver_study as study
import torch
from solver_study import TrainedStage, settled_at, trained_errors, trained_rules

from tactile_diffusers.cli.program import (
    Parser,
    add_checkpoint_argument,
    add_output_argument,
    add_seed_argument,
    existing_file,
    load_pipeline,
)
from tactile_diffusers.data import PreparedDataset
from tactile_diffusers.evaluation.metrics.distances import Reference
from tactile_diffusers.io.argument_types import count
from tactile_diffusers.schedulers import VDDIMScheduler
from tactile_diffusers.virtual import Collection

sys.path.append(str(Path(__file__).parents[1]))  # examples, for `report`

from report.figures import figure_panels
from report.fresh import fresh_textures
from report.result_files import write_results
from report.tables import markdown_table

#: Rules and spacings that the tables show; the JSON has all.
_SHOWN = ("ddim", "rotation_2", "rotation_2_lowered", "rotation_3", "adams_bashforth_2", "adams_bashforth_3", "data_2m")
_FEW, _MANY = "4", "10"
_SPACINGS = ("uniform", "both_ends")
#: Standard deviations of components in the table.
_SPREADS = (0.03, 0.1, 0.3, 1.0, 3.0)
# segments of the comparison of all rules
_RULE_SEGMENTS = 16


def analytic(pipe, real, sampling_rate):
    """Errors where the velocity is known: mixture, single components, spectra of textures."""
    errors, orders = study.mixture_errors()
    steps = [count for count in study.STEPS if count >= 3]
    components = {
        rule: {
            spacing: {str(n): [float(v) for v in study.component_levels(rule, n, spacing)] for n in steps}
            for spacing in study.SPACINGS
        }
        for rule in study.RULES
    }
    spectra = {
        name: study.spectrum_levels(study.texture_deviations(pipe, real, sampling_rate, whitened), steps)
        for name, whitened in (("whitened", True), ("not whitened", False))
    }
    return {
        "mixture": errors,
        "orders": orders,
        "components": {"spreads": list(study.COMPONENTS), "levels_db": components},
        "textures": spectra,
    }


def trained(pipe, data, segments, seed, quiet):
    """Errors of LCTG and DALE against a fine reference, and what they do to textures."""
    held_out, train = PreparedDataset(data, "validation"), PreparedDataset(data, "train")
    rate = held_out.sampling_rate
    reference = Reference(train.textures(train.non_overlapping(2, seed)), rate)
    rows = held_out.non_overlapping(1, seed)[:segments]
    real, ratings = held_out.textures(rows), held_out.ratings.mean[held_out.surface_ids[rows]]
    lctg = TrainedStage(pipe, "lctg", real, ratings, rate, seed)
    found = {"lctg": trained_errors(lctg, real, rate, reference, quiet=quiet)}
    few = slice(None, _RULE_SEGMENTS)
    found["rules"] = {"lctg": trained_rules(TrainedStage(pipe, "lctg", real[few], None, rate, seed), quiet=quiet)}
    if pipe.dale is not None:
        found["dale"] = trained_errors(TrainedStage(pipe, "dale", real, ratings, rate, seed), quiet=quiet)
        stage = TrainedStage(pipe, "dale", real[few], ratings[few], rate, seed)
        found["rules"]["dale"] = trained_rules(stage, quiet=quiet)
    found["real_ktd"] = reference.distances(reference.embed(real), np.arange(len(real)))["ktd"]
    return found, real, rate


def step_cost(pipe, repeats=200):
    """Seconds of one scheduler step of order 2 and of one evaluation of each network, batch 1: medians."""
    config = pipe.lctg.config
    wave = torch.randn(1, 1, config.segment_samples)
    latents = torch.zeros(1, config.latent_channels, config.segment_samples // config.latent_hop)

    def median(work, count):
        times = []
        for _ in range(count):
            start = time.perf_counter()
            work()
            times.append(time.perf_counter() - start)
        return statistics.median(times)

    scheduler = VDDIMScheduler(multistep_order=2)

    def one_step():
        scheduler.step(wave, scheduler.timesteps[scheduler.step_index or 0], wave)

    scheduler.set_timesteps(2 * repeats)
    costs = {"scheduler step": median(one_step, repeats)}
    with torch.no_grad():
        costs["LCTG"] = median(lambda: pipe.lctg(wave, 500.0, latents), max(3, repeats // 10))
        if pipe.dale is not None:
            state = torch.randn(1, pipe.dale.config.in_channels, pipe.dale.config.latent_frames)
            ratings = torch.zeros(1, 3)
            costs["DALE"] = median(lambda: pipe.dale(state, 500.0, ratings), max(3, repeats // 10))
    return costs


def markdown(report):
    """The report's tables."""
    parts = ["### Sampler", report["about"]]
    if report.get("trained"):
        for stage in ("lctg", "dale"):
            if stage in report["trained"]:
                parts += [f"#### Trained {stage.upper()}", _trained_table(report["trained"][stage])]
        parts.append(_settled_table(report))
    parts += ["#### All that was tried", _rules_table(report)]
    parts += [
        f"#### Level of one Gaussian component, {_MANY} steps, dB, by standard deviation",
        _component_table(report),
    ]
    return "\n\n".join([*parts, _step_cost_line(report)]) + "\n"


def _settled_table(report):
    settled = {
        metric: {name: settled_at(by, metric) for name, by in report["trained"]["lctg"].items()}
        for metric in ("nine_band_db", "ktd")
    }
    return f"Fewest steps within one standard error of the best:\n\n{markdown_table(settled)}"


def _step_cost_line(report):
    costs = report["costs"]
    share = {name: f"{100 * costs['scheduler step'] / costs[name]:.2f} %" for name in ("LCTG", "DALE") if name in costs}
    return f"One step of the sampler costs {', '.join(f'{s} of {n}' for n, s in share.items())} at batch 1."


def _rules_table(report):
    """Analytic and trained errors of every rule and spacing."""
    rows, trained = {}, (report.get("trained") or {}).get("rules", {})
    for rule in _SHOWN:
        for spacing in _SPACINGS:
            mixture, spectra = report["analytic"]["mixture"][rule][spacing], report["analytic"]["textures"]["whitened"]
            row = {"order": report["analytic"]["orders"][rule][spacing]}
            row |= {f"mixture, {n} steps": mixture[n]["rms"] for n in (_FEW, _MANY)}
            for n in (_FEW, _MANY):
                found = spectra[rule][spacing][n]
                row[f"components, {n} steps, dB"] = f"{found['lowest']:.2f} to {found['highest']:.2f}"
            for stage, by_rule in trained.items():
                row |= {f"{stage.upper()}, {n} steps": by_rule[rule][spacing][n] for n in (_FEW, _MANY)}
            rows[f"{rule}, {spacing}"] = row
    note = (
        "RMS errors on an analytic Gaussian mixture and on the trained models; observed order of the median error on "
        "the mixture, 20 to 160 steps; lowest and highest level error over components of whitened held-out textures."
    )
    return f"{note}\n\n{markdown_table(rows, 3)}"


def _component_table(report):
    found = report["analytic"]["components"]
    columns = {f"{spread:g}": found["spreads"].index(spread) for spread in _SPREADS}
    rows = {
        f"{rule}, {spacing}": {name: found["levels_db"][rule][spacing][_MANY][i] for name, i in columns.items()}
        for rule in ("ddim", "rotation_2", "adams_bashforth_2", "data_2m")
        for spacing in _SPACINGS
    }
    return markdown_table(rows)


def _trained_table(by_scheduler, steps=("3", "4", "5", "10", "25", "100")):
    rows = {}
    for name, by_steps in by_scheduler.items():
        for number in steps:
            if number in by_steps:
                entry = dict(by_steps[number])
                entry.pop("bands_db", None)
                if "rmse_n" in entry:
                    entry["score"] = entry["rmse_n"]["mean"] * entry["seconds"]["mean"]
                rows[f"{name}, {number}"] = entry
    labels = {
        "solver_rms": ("solver error, RMS", 4),
        "seconds": ("s per segment (batch 8)", 4),
        "nine_band_db": "nine-band error, dB",
        "ktd": "KTD",
        "rmse_n": ("RMSE, N", 5),
        "score": ("efficiency score, N·s", 6),
    }
    shown = {key: label for key, label in labels.items() if any(key in row for row in rows.values())}
    return markdown_table(rows, labels=shown)


def plot(report, output_path):
    """Log-log error against steps on the mixture, level of components, and the trained models."""
    found = report.get("trained")
    with figure_panels(output_path, 1, 3, (14, 4.2)) as panels:
        mixture, components, solver = panels[0]
        for rule, style in (("ddim", "-"), ("rotation_2", "-"), ("adams_bashforth_2", "--"), ("data_2m", ":")):
            for spacing, colour in (("uniform", "C0"), ("both_ends", "C1")):
                by = report["analytic"]["mixture"][rule][spacing]
                counts = sorted(map(int, by))
                marker = "o" if rule == "rotation_2" else None
                values = [by[str(n)]["median"] for n in counts]
                order = report["analytic"]["orders"][rule][spacing]
                mixture.loglog(
                    counts,
                    values,
                    style,
                    color=colour,
                    marker=marker,
                    markersize=3,
                    label=f"{rule}, {spacing}: order {order:.2f}",
                )
        mixture.set(title="Gaussian mixture", xlabel="steps", ylabel="median error")
        spreads = report["analytic"]["components"]["spreads"]
        for rule in ("ddim", "rotation_2", "adams_bashforth_2"):
            for count, style in ((_FEW, ":"), (_MANY, "-")):
                levels = report["analytic"]["components"]["levels_db"][rule]["both_ends"][count]
                components.semilogx(spreads, levels, style, label=f"{rule}, {count} steps")
        components.set(
            title="one Gaussian component, both_ends",
            xlabel="standard deviation",
            ylabel="level error, dB",
            ylim=(-30, 6),
        )
        for name, by_steps in (found or {}).get("lctg", {}).items():
            counts = [int(n) for n in by_steps]
            solver.loglog(
                counts, [e["solver_rms"]["mean"] for e in by_steps.values()], marker="o", markersize=3, label=name
            )
        solver.set(title="trained LCTG", xlabel="steps", ylabel="solver error, RMS")
        for panel in panels[0]:
            panel.legend(fontsize=6)


def main(argv=None):
    """Measures and writes scheduler.json, scheduler.md and scheduler.png."""
    parser = Parser(prog="sampler.py", description="Speed against error of the sampler and of what was tried for it.")
    add_output_argument(parser, "folder of the results")
    add_checkpoint_argument(parser)
    add_seed_argument(parser)
    parser.add_argument("--data", type=existing_file, metavar="PREPARED.h5", help="compare on trained models, too")
    parser.add_argument("--segments", type=count, default=60, metavar="N", help="one a surface; default: 60")
    parser.add_argument("--quiet", action="store_true", help="no progress bars")
    arguments = parser.parse_args(argv)
    pipe = load_pipeline(arguments.checkpoint)
    if arguments.data is not None:
        found, real, rate = trained(pipe, arguments.data, arguments.segments, arguments.seed, arguments.quiet)
        source = PreparedDataset(arguments.data, "validation").source
        where = f"{len(real)} segments of {len(real)} validation surfaces, {source}"
    else:
        rate, found = pipe.feature_extractor.delivery_rate, None
        real = np.concatenate(
            [fresh_textures(10**6 + k, Collection(12.0), per_surface=1)[0] for k in range(arguments.segments)]
        )
        where = f"{len(real)} segments of fresh virtual surfaces"
    report = {
        "about": f"{where}; reference: {study.REFERENCE_STEPS} steps. Textures' components: 64 bands at the working "
        "rate.",
        "analytic": analytic(pipe, real, rate),
        "trained": found,
        "costs": step_cost(pipe),
    }
    write_results(arguments.output, "scheduler", report, text := markdown(report), indent=1)
    plot(report, arguments.output / "scheduler.png")
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())

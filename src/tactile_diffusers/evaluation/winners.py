"""Where a baseline still does better than the model."""

import numpy as np

from .labels import FROM_RATINGS, NAMES, SETS, SPECTRAL, default_guidance, default_steps
from .metrics.statistics import number
from .tables import text

# metrics of which less is better, and of which more is
_LESS, _MORE = ("nine_band_db", "lsd_db", "ftd", "ktd"), ("gfc", "snr_db")


def baselines_that_win(report):
    """Where a baseline or an anchor still has the better figure: pairs of metric label and their names with figures."""
    found = []
    if report.get("reconstruction"):
        count = default_steps(report)
        ours = report["reconstruction"]["steps"][count]
        others = report["reconstruction"]["baselines"] | _anchors(report, count)
        for metric in (*_LESS, *_MORE):
            winners = _better(ours[metric], {slug: entry[metric] for slug, entry in others.items()}, metric in _MORE)
            found.append((f"reconstruction, {SPECTRAL[metric]} ({count} steps: {text(ours[metric])})", winners))
    if report.get("generation"):
        ours, others = report["generation"][default_guidance(report)], report["generation"]["baselines"]
        for metric, more in (("ftd", False), ("ktd", False), ("precision", True), ("recall", True)):
            chosen = {slug: others[slug][metric] for slug in FROM_RATINGS if slug in others}
            found.append((f"generation, {SETS[metric]} ({text(ours[metric])})", _better(ours[metric], chosen, more)))
        unseen = report["unseen_surfaces"]
        for metric, more in (("nine_band_db", False), ("level_r", True), ("log_friction_r", True)):
            known, model = unseen[metric], unseen[metric]["model"]
            chosen = {slug: known[slug] for slug in FROM_RATINGS if slug in known}
            found.append((f"unseen surfaces, {metric} ({text(model)})", _better(model, chosen, more)))
    if report.get("control"):
        found += _control_winners(report["control"], default_guidance(report))
    return [(label, winners) for label, winners in found if winners]


def _anchors(report, count):
    """Leaves of the anchors at a number of steps, at which some may not have been measured."""
    entries = (report.get("anchors") or {}).items()
    return {f"anchor {name}": entry["steps"][count] for name, entry in entries if count in entry["steps"]}


def _control_winners(control, guidance):
    """Mean deviations from the truth over all conditions, the model's and the baselines'."""

    def deviations(axes):
        entries = [entry for values in axes.values() for entry in values.values()]
        pairs = {"level, dB": ("level_db", "level_db_truth"), "log friction": ("log_friction", "log_friction_truth")}
        found = {
            name: [
                abs(e[made]["mean"] - e[real]["mean"])
                for e in entries
                if None not in (e[made]["mean"], e[real]["mean"])
            ]
            for name, (made, real) in pairs.items()
        }
        found["shape, dB"] = [entry["shape_difference_db"]["mean"] for entry in entries]
        return {name: number(np.mean(values) if values else None, len(values)) for name, values in found.items()}

    ours = deviations(control[guidance]["axes"])
    others = {slug: deviations(entry["axes"]) for slug, entry in control["baselines"].items()}
    return [
        (
            f"control, mean deviation of {name} from real ({text(leaf)})",
            _better(leaf, {slug: entry[name] for slug, entry in others.items()}, False),
        )
        for name, leaf in ours.items()
    ]


def _better(ours, others, more):
    if ours["mean"] is None:
        return []
    sign = -1 if more else 1
    better = {k: v for k, v in others.items() if v["mean"] is not None and sign * v["mean"] < sign * ours["mean"]}
    return [f"{NAMES.get(slug, slug)} ({text(leaf)})" for slug, leaf in better.items()]

"""Rows of the tables of a report: name -> {column: text, number or leaf}."""

from . import labels
from .labels import DECODERS, NAMES, compared_steps, default_guidance, default_steps
from .tables import markdown_table, text

#: What the paper reports (sections 3.1 to 3.4), on SENS3.
PAPER = {
    "rmse_n": "11.4 (6.2–18.1)",
    "snr_db": "−1.87 (−2.36 to −1.21)",
    "power_difference_n2": "5.0e-05, max 1.0e-04",
    "power_difference_percent": "59 (from its power difference, RMSE and SNR)",
    "best_steps": "10",
    "real_time_steps": "over 50 (RTX 4060)",
    "rmse_protocol_mn": "5.57",
    "latent_shift_percent": "0–2",
}
#: Metric -> label, factor and digits.
_OVERVIEW = {
    "rmse_n": ("reconstruction RMSE, mN", 1e3, 2),
    "snr_db": ("reconstruction SNR, dB", 1, 2),
    "power_difference_n2": ("mean power difference, N²", 1, 6),
    "power_difference_percent": ("the same, % of the mean power", 1, 2),
}


def overview(report):
    """The paper's figures beside silence, another take, no network and the checkpoint: Markdown."""
    paper, ours, rows = "paper, on SENS3", "this checkpoint", {}
    if section := report.get("reconstruction"):
        counts = dict.fromkeys([default_steps(report), compared_steps(section["steps"])])
        sources = {"silence": section["baselines"]["silence"], "another take": section["baselines"]["other_take"]}
        sources |= {"no network": section["decoders"]["no_network"]}
        sources |= {f"{ours}, {count} steps": section["steps"][count] for count in counts}
        ours = f"{ours}, {next(iter(counts))} steps"
        for key, (label, scale, digits) in _OVERVIEW.items():
            means = {name: source[key]["mean"] for name, source in sources.items()}
            shown = {name: text(None if mean is None else scale * mean, digits) for name, mean in means.items()}
            rows[label] = {paper: PAPER[key]} | shown
        fewest = text(section["steps_within_5_percent"], 0)
        rows["fewest steps within 5 % of the best nine-band error"] = {paper: PAPER["best_steps"], ours: fewest}
    if report.get("speed"):
        for key, label in (("segment", "real-time steps, segment"), ("block_100ms", "real-time steps, 0.1 s block")):
            steps = text(report["speed"][key]["real_time_steps"], 0)
            rows[label] = {paper: PAPER["real_time_steps"] if key == "segment" else "–", ours: f"{steps} (CPU)"}
    if report.get("generation"):
        rmse = report["generation"][default_guidance(report)]["rmse_protocol_n"]["mean"]
        shown = text(None if rmse is None else 1e3 * rmse)
        rows["full-pipeline RMSE (random ratings), mN"] = {paper: PAPER["rmse_protocol_mn"], ours: shown}
    if report.get("paper"):
        rows["latent shift at ±2, %"] = {paper: PAPER["latent_shift_percent"], ours: latent_shift(report)}
    return markdown_table(rows)


def latent_shift(report):
    """Least and largest shift of the latent from that of average ratings, one rating at ±2 (the paper's 3.3), %."""
    sweeps = report["paper"]["latent_shift_percent"].values()
    shifts = [values[end]["mean"] for values in sweeps for end in ("-2.0", "2.0")]
    return f"{min(shifts):.0f}–{max(shifts):.0f}"


def reconstruction_rows(report):
    """LCTG beside itself without its network and baselines."""
    section = report["reconstruction"]
    shown = dict.fromkeys([default_steps(report), compared_steps(section["steps"])])
    rows = {f"**LCTG, {count} steps**": section["steps"][count] for count in shown}
    rows[DECODERS["no_network"]] = section["decoders"]["no_network"]
    return rows | baseline_rows(section) | {"a different surface": section["different_surface"]}


def decoder_rows(report):
    """LCTG beside itself without its network, and without restored levels; then each at equal rate."""
    section, rows = report["reconstruction"], {}
    for name, entry in section["decoders"].items():
        noisy = section["equal_rate"].get(name, {})
        rate = {key: noisy[key] for key in ("kilobits_per_second", "sigma") if noisy}
        rows[DECODERS[name]] = entry | rate | {f"noisy_{key}": leaf for key, leaf in noisy.items()}
    return rows


def difference_rows(report):
    """LCTG minus no network, paired."""
    return {layers.replace("_", " "): entry for layers, entry in report["reconstruction"]["network"].items()}


def step_rows(report):
    """The sweep over LCTG's steps."""
    section = report["reconstruction"]
    rows = {f"{count} steps": entry for count, entry in section["steps"].items()}
    return rows | {DECODERS["no_network"]: section["decoders"]["no_network"]}


def generation_rows(report):
    """Sets of textures: real, generated at each guidance scale, baselines."""
    section = report["generation"]
    rows = {"real, held out": section["real"]}
    for scale, entry in section.items():
        if scale not in ("real", "baselines"):
            rows[f"**generated from ratings, guidance {scale}**"] = entry
    return rows | baseline_rows(section)


def baseline_rows(section):
    """Baselines by their names; those of older reports that are no more are left out."""
    return {NAMES[slug]: entry for slug, entry in section["baselines"].items() if slug in NAMES}


def unseen_rows(report):
    """Textures from the ratings of held-out surfaces, beside baselines."""
    section, rows = report["unseen_surfaces"], {}
    for slug, name in ({"model": "**generated from ratings**"} | NAMES).items():
        rows[name] = {metric: section[metric].get(slug) for metric in labels.UNSEEN if metric in section}
    for scale, entry in section["guidance"].items():
        if scale != default_guidance(report):
            rows[f"**guidance {scale}**"] = entry
    return rows


def variation_rows(report):
    """What textures do over time, generated, recorded again and of baselines."""
    return {
        {"model": "**generated from ratings**", **NAMES}[source]: {
            f"{name}_{kind}": leaf for name, leaves in entry.items() for kind, leaf in leaves.items()
        }
        for source, entry in report["unseen_surfaces"]["variation"].items()
    }


def told_apart_rows(report):
    """How often the second judge tells takes from real ones."""
    return {
        labels.JUDGED[name]: {
            f"{features}_{kind}{suffix}": leaves[key]
            for features, kinds in entry.items()
            for kind, leaves in kinds.items()
            for key, suffix in (("all", ""), ("eventful", "_eventful"))
        }
        for name, entry in report["second_judge"]["rows"].items()
    }


def network_rows(report):
    """Shares told apart of LCTG minus those of no network, paired."""
    return {
        layers.replace("_", " "): {
            f"{features}_{kind}": leaf for features, kinds in e.items() for kind, leaf in kinds.items()
        }
        for layers, e in report["second_judge"]["network"].items()
    }


def giveaway_rows(report):
    """The features by which the second judge tells takes of the signal apart, the strongest first."""

    def shown(feature):
        return f"{feature['name']} ({feature['difference']['mean']:+.1f}, ×{feature['spread_ratio']['mean']:.1f})"

    return {
        labels.JUDGED[name]: {
            kind: ", ".join(shown(feature) for feature in leaves["features"] if feature["contribution"]["mean"])
            for kind, leaves in entry["signal"].items()
        }
        for name, entry in report["second_judge"]["rows"].items()
    }


def speed_rows(report):
    """Real-time steps of a segment and of a block, and how long each part of the pipeline takes."""
    speed = report["speed"]
    rows = {"segment": speed["segment"], "block": speed["block_100ms"]}
    return rows | {key.replace("_", " "): {"seconds": leaf} for key, leaf in speed.items() if "mean" in leaf}


def durations(report):
    """How long each section took: "340 s: reconstruction 90 s, generation 250 s"."""
    seconds = report["seconds"]
    return f"{sum(seconds.values()):.0f} s: " + ", ".join(f"{name} {took:.0f} s" for name, took in seconds.items())

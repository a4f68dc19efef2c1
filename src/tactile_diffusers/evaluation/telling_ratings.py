"""Tables of what ratings make: generated sets, unseen surfaces, control, novel ratings."""

from .control_summary import VALUES, obedience_rows
from .labels import NAMES, SETS, default_guidance
from .tables import markdown_table, text, title


def generation_markdown(report, level=2):
    """How near generated sets are to held-out textures, how diverse, and how new."""
    section = report["generation"]
    rows = {"real, held out": section["real"]}
    for scale, entry in section.items():
        if scale not in ("real", "baselines"):
            rows[f"**generated from ratings, guidance {scale}**"] = entry
    rows |= {NAMES[slug]: entry for slug, entry in section["baselines"].items()}
    note = (
        "Sets of equal size. Precision and recall are against the held-out textures; a diversity of 1 means that takes "
        "of one rating differ as much as takes of one real surface (ratings do not settle a surface: more is right); "
        "a memoriser would have a large share closer to a training segment than the "
        "closest 1 % of real held-out ones."
    )
    return title("Generated sets", level) + note + "\n\n" + markdown_table(rows, labels=SETS)


def unseen_markdown(report, level=2):
    """Surfaces that training never saw, made from their ratings, beside baselines."""
    section = report["unseen_surfaces"]
    rows = {}
    for slug in section["nine_band_db"]:
        name = "**generated from ratings**" if slug == "model" else NAMES[slug]
        rows[name] = {metric: section[metric][slug] for metric in ("nine_band_db", "level_r", "log_friction_r")}
    for scale, entry in section["guidance"].items():
        if scale != default_guidance(report):
            rows[f"**guidance {scale}**"] = entry
    labels = {
        "nine_band_db": "error of the mean spectrum, dB",
        "level_r": "r of level",
        "log_friction_r": "r of log friction",
    }
    note = (
        "Only the blend, the ridge regression and the model work from ratings; the mean spectrum knows nothing; all "
        "others are told the surface's own recording."
    )
    return (
        title("Unseen surfaces from their ratings", level)
        + note
        + "\n\n"
        + markdown_table(rows, labels=labels, interval=True)
    )


def obedience_markdown(report, level=2):
    """Whether one rating changes what it changes between real surfaces."""
    labels = {
        "changes": "changes that are those of real surfaces",
        "matrix": "response matrix, largest difference from real",
        "spearman": "least Spearman over the sweeps",
        "nine_band_db": "unseen surfaces, dB",
        "ktd_excess": "KTD over real",
        "ftd": "FTD",
        "diversity_of_rating": "spread of takes over that of real textures of such ratings",
        "diversity": "over that of takes of one surface",
        "precision": "precision",
        "recall": "recall",
        "novelty_share": "closer to training than real 1st percentile",
    }
    moved = {
        axis: entry["moved_name"] for axis, entry in report["control"][default_guidance(report)]["spearman"].items()
    }
    note = (
        "A change is what one rating at -2, -1, +1 or +2 alone makes of level, nine-band shape, log friction or latent "
        "displacement; it is right within 20 % of what it is between real surfaces, or within the 95 % interval of "
        "either. Spearman is that of sweep means in what an axis moves most in real data: "
        + ", ".join(f"{axis}: {name.removesuffix('_db').replace('_', ' ')}" for axis, name in moved.items())
        + ". Under permuted ratings the same textures stand under the labels of others: it must fail."
    )
    table = markdown_table(obedience_rows(report), labels=labels)
    return title("Do ratings do what they do in real data", level) + note + "\n\n" + table


def control_markdown(report, level=2):
    """What one rating alone makes of level, spectrum, friction and latents, beside real surfaces."""
    control, guidance = report["control"], default_guidance(report)
    judges = ", ".join(f"{axis} {text(value, interval=True)}" for axis, value in control["judge_r2"].items())
    truth = control["truth"]
    few = [
        n for n, size in truth["effective_surfaces"].items() if (size["mean"] or 0) < truth["fewest_surfaces"]["mean"]
    ]
    far = [n for n, away in truth["rating_offset"].items() if abs(away["mean"] or 0) > truth["largest_offset"]["mean"]]
    fewest = min(size["mean"] or 0 for size in truth["effective_surfaces"].values())
    note = (
        f'One rating set, the others not specified, guidance {guidance}; "real" is what real surfaces with that '
        f"rating are. Fewest effective surfaces behind a row: {fewest:.0f}. Extrapolated for want of surfaces: "
        f"{', '.join(few) or 'none'}; because the surfaces found lie well inside of the request: "
        f"{', '.join(far) or 'none'}. R² of the judge on held-out surfaces: {judges}."
    )
    rows = {}
    for axis, values in control[guidance]["axes"].items():
        for value, entry in values.items():
            if value in VALUES:
                rows[f"{axis} {float(value):+g}"] = entry | {
                    f"shape_difference_{slug}": made["axes"][axis][value]["shape_difference_db"]
                    for slug, made in control["baselines"].items()
                }
    labels = {
        "rating_truth": "rating of the real",
        "level_db": "level, dB re 1 N",
        "level_db_truth": "real",
        "shape_db": "shape change, dB",
        "shape_db_truth": "real",
        "shape_difference_db": "shape against real: ours, dB",
        "shape_difference_knn_blend": "blend",
        "shape_difference_ridge": "ridge",
        "log_friction": "log friction",
        "log_friction_truth": "real",
        "latent_shift_percent": "latent shift, %",
        "latent_shift_dprime": "latent shift, d′",
        "latent_shift_dprime_truth": "real",
    }
    return title("Control", level) + note + "\n\n" + markdown_table(rows, labels=labels)


def responses_markdown(report, level=2):
    """Slopes of recovered on requested ratings, for each source."""
    control, guidance = report["control"], default_guidance(report)
    sources = {"real": control["response_real"], "generated": control[guidance]["response"]}
    sources |= {slug: entry["response"] for slug, entry in control["baselines"].items()}
    sources |= {"estimator, real": control["estimator_real"], "estimator, generated": control[guidance]["estimator"]}
    axes = list(control["judge_r2"])
    rows = {
        f"{source}: recovered {axis}": dict(zip(axes, row, strict=True))
        for source, matrix in sources.items()
        for axis, row in zip(axes, matrix, strict=True)
    }
    note = (
        "Slope of what the judge recovers on what was asked for, all three ratings of held-out surfaces. The estimator "
        "helped to train DALE and hears its result before decoding: more slope there than for the judge, each against "
        "its own slope on real textures, would be flattery."
    )
    labels = {axis: f"requested {axis}" for axis in axes}
    return title("Response", level) + note + "\n\n" + markdown_table(rows, labels=labels, interval=True)


def novel_markdown(report, level=2):
    """What ratings outside of training make."""
    section = report["novel"]
    rows = {name: entry for name, entry in section.items() if name != "range_db"}
    for entry in rows.values():
        least, largest = entry["level_db"]["min"], entry["level_db"]["max"]
        entry["levels"] = f"{text(least, 1)} to {text(largest, 1)}"
        least, largest = entry["friction"]["min"], entry["friction"]["max"]
        entry["frictions"] = f"{text(least)} to {text(largest)}"
    labels = {
        "levels": "level, dB re 1 N",
        "level_inside": "share of levels within those of training",
        "frictions": "friction coefficient",
        "beyond": "share farther from training than 99 % of real",
        "crest": "crest factor",
        "finite": "finite",
    }
    bounds = section["range_db"]
    note = (
        f"Training levels lie between {text(bounds['min'], 1)} and {text(bounds['max'], 1)} dB. People's mean ratings "
        "hardly reach 2; corners ask for combinations that hardly any surface has. The pipeline warns of both."
    )
    return title("Novel ratings", level) + note + "\n\n" + markdown_table(rows, labels=labels)


def paper_figures_markdown(report, level=2):
    """The pictures of the paper's own protocols."""
    pictures = "![latent shift](latent_shift.png)\n\n![spectra](spectra.png)"
    return title("The paper's protocols of conditioning", level) + pictures

"""Tables of textures from ratings: generated sets, unseen surfaces, control, ratings outside of training."""

from .control_summary import VALUES, control_rows
from .labels import NAMES, SETS, default_guidance
from .tables import markdown_table, text, title


def generation_markdown(report, level, pictures):
    """Distances, diversity and copying of generated sets."""
    section = report["generation"]
    rows = {"real, held out": section["real"]}
    for scale, entry in section.items():
        if scale not in ("real", "baselines"):
            rows[f"**generated from ratings, guidance {scale}**"] = entry
    rows |= {NAMES[slug]: entry for slug, entry in section["baselines"].items()}
    note = (
        "Sets of equal size. Precision and recall are against the held-out textures. A diversity of 1 means that takes "
        "of one rating differ as much as takes of one real surface; ratings do not determine a surface, so more is "
        "right. A generator that copies has a large share closer to a training segment than the closest 1 % of real "
        "held-out ones."
    )
    return title("Generated sets", level) + note + "\n\n" + markdown_table(rows, labels=SETS)


def unseen_markdown(report, level, pictures):
    """Textures from the ratings of held-out surfaces, beside baselines."""
    section, rows = report["unseen_surfaces"], {}
    labels = {
        "nine_band_db": "error of the mean spectrum, dB",
        "level_r": "r of level",
        "log_friction_r": "r of log friction",
    }
    for slug in section["nine_band_db"]:
        name = "**generated from ratings**" if slug == "model" else NAMES[slug]
        rows[name] = {metric: section[metric][slug] for metric in labels}
    for scale, entry in section["guidance"].items():
        if scale != default_guidance(report):
            rows[f"**guidance {scale}**"] = entry
    note = (
        "The model, the blend and the ridge regression work from ratings. The mean spectrum knows nothing. All others "
        "know the surface's own recording."
    )
    table = markdown_table(rows, labels=labels, interval=True)
    return title("Unseen surfaces from their ratings", level) + f"{note}\n\n{table}"


def control_effect_markdown(report, level, pictures):
    """Whether a change of one rating has the effect that it has between real surfaces."""
    labels = {
        "changes": "changes as between real surfaces",
        "matrix": "response matrix, largest difference from real",
        "spearman": "least Spearman over the sweeps",
        "nine_band_db": "unseen surfaces, dB",
        "ktd_excess": "KTD over real",
        "ftd": "FTD",
        "diversity_of_rating": "diversity over that of real textures of such ratings",
        "diversity": "over that of takes of one surface",
        "precision": "precision",
        "recall": "recall",
        "novelty_share": "closer to training than the real 1st percentile",
    }
    spearman = report["control"][default_guidance(report)]["spearman"]
    moved = {axis: entry["moved_name"].removesuffix("_db").replace("_", " ") for axis, entry in spearman.items()}
    note = (
        "One rating is set to −2, −1, +1 or +2, and the change of level, nine-band shape, log friction and latent "
        "displacement is compared with that between real surfaces: right within 20 % of it, or within the 95 % "
        "interval of either. Spearman: means of a sweep, in the quantity that the axis changes most in real data "
        f"({', '.join(f'{axis}: {name}' for axis, name in moved.items())}). Permuted ratings, the same textures under "
        "the labels of others, must fail."
    )
    table, picture = markdown_table(control_rows(report), labels=labels), f"![one rating]({pictures}/control.png)"
    return title("Effect of ratings", level) + f"{note}\n\n{table}\n\n{picture}"


def control_markdown(report, level, pictures):
    """Level, spectrum, friction and latents with one rating set, beside real surfaces."""
    control, guidance = report["control"], default_guidance(report)
    judges = ", ".join(f"{axis} {text(value, interval=True)}" for axis, value in control["judge_r2"].items())
    truth = control["truth"]
    sizes = {name: size["mean"] or 0 for name, size in truth["effective_surfaces"].items()}
    few = [name for name, size in sizes.items() if size < truth["fewest_surfaces"]["mean"]]
    far = [n for n, away in truth["rating_offset"].items() if abs(away["mean"] or 0) > truth["largest_offset"]["mean"]]
    note = (
        f'One rating set, the others not specified, guidance {guidance}; "real": real surfaces with that rating. '
        f"Fewest effective surfaces behind a row: {min(sizes.values()):.0f}. Extrapolated, too few surfaces: "
        f"{', '.join(few) or 'none'}; surfaces well inside of the request: {', '.join(far) or 'none'}. R² of the judge "
        f"on held-out surfaces: {judges}."
    )
    rows = {}
    for axis, values in control[guidance]["axes"].items():
        for value in (value for value in values if value in VALUES):
            rows[f"{axis} {float(value):+g}"] = values[value] | {
                f"shape_difference_{slug}": baseline["axes"][axis][value]["shape_difference_db"]
                for slug, baseline in control["baselines"].items()
            }
    labels = {
        "rating_truth": "rating of the real",
        "level_db": "level, dB re 1 N",
        "level_db_truth": "real",
        "shape_db": "shape change, dB",
        "shape_db_truth": "real",
        "shape_difference_db": "shape against real, dB",
        "shape_difference_knn_blend": "blend",
        "shape_difference_ridge": "ridge",
        "log_friction": "log friction",
        "log_friction_truth": "real",
        "latent_shift_percent": "latent shift, %",
        "latent_shift_dprime": "latent shift, d′",
        "latent_shift_dprime_truth": "real",
    }
    return title("One rating at a time", level) + note + "\n\n" + markdown_table(rows, labels=labels)


def response_markdown(report, level, pictures):
    """Slopes of estimated on requested ratings."""
    control, guidance = report["control"], default_guidance(report)
    sources = {"real": control["response_real"], "generated": control[guidance]["response"]}
    sources |= {slug: entry["response"] for slug, entry in control["baselines"].items()}
    sources |= {"estimator, real": control["estimator_real"], "estimator, generated": control[guidance]["estimator"]}
    axes = list(control["judge_r2"])
    rows = {
        f"{source}: estimated {axis}": dict(zip(axes, row, strict=True))
        for source, matrix in sources.items()
        for axis, row in zip(axes, matrix, strict=True)
    }
    note = (
        "Slope of the judge's estimate on the requested rating, for all three ratings of held-out surfaces. The "
        "estimator helped to train DALE and reads its result before decoding: a larger slope there than for the judge, "
        "each relative to its slope on real textures, would flatter the model."
    )
    table = markdown_table(rows, labels={axis: f"requested {axis}" for axis in axes}, interval=True)
    return title("Response to ratings", level) + f"{note}\n\n{table}"


def novel_markdown(report, level, pictures):
    """Textures from ratings outside of training."""
    section, rows = report["novel"], {}
    for name, entry in section.items():
        if name != "range_db":
            low, high = (text(entry["level_db"][end], 1) for end in ("min", "max"))
            least, largest = (text(entry["friction"][end]) for end in ("min", "max"))
            rows[name] = entry | {"levels": f"{low} to {high}", "frictions": f"{least} to {largest}"}
    labels = {
        "levels": "level, dB re 1 N",
        "level_inside": "share of levels within those of training",
        "frictions": "friction coefficient",
        "beyond": "share farther from training than 99 % of real",
        "crest": "crest factor",
        "finite": "finite",
    }
    low, high = (text(section["range_db"][end], 1) for end in ("min", "max"))
    note = (
        f"Training levels lie between {low} and {high} dB. Mean ratings of people hardly reach 2, and hardly any "
        "surface has the combinations at the corners. The pipeline warns of both."
    )
    return title("Ratings outside of training", level) + note + "\n\n" + markdown_table(rows, labels=labels)

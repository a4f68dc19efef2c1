"""The rows of an ablation side by side: tables and pictures."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1]))  # examples, for `report`

from report.figures import figure_panels
from report.labels import BANDS
from report.tables import markdown_table

#: Headings and digits of the main table.
_MAIN = {
    "millions": ("parameters, M", 2),
    "step_seconds": ("s per training step", 3),
    "training_minutes": ("minutes of training, with DALE", 1),
    "loss": ("last loss", 3),
    "nine_band_db_5": ("nine-band error at 5 steps, dB", 3),
    "nine_band_db": ("at 10", 3),
    "base_nine_band_db": ("from the base layer alone", 3),
    "ktd_excess_5": ("KTD over real at 5 steps", 1),
    "ktd_excess": ("at 10", 1),
    "base_ktd_excess": ("from the base layer alone", 1),
    "ftd_excess": ("FTD over real", 1),
    "snr_db": ("SNR, dB", 2),
    "power_difference_percent": ("power difference, %", 3),
    "seconds": ("s per segment", 3),
    "rate_kbit_s": ("kbit/s", 2),
}
_FINALISTS = {
    "ktd_excess": ("generated KTD over real", 1),
    "ftd_excess": ("generated FTD over real", 1),
    "nine_band_db": ("nine-band error on unseen surfaces, dB", 2),
    "level_r": ("r of level", 2),
    "dale_loss": ("last loss of DALE", 3),
}
_SEEDS = {
    "nine_band_db": ("reconstructed: nine-band error, dB", 2),
    "snr_db": ("SNR, dB", 2),
    "ktd_excess": ("KTD over real", 1),
    "base_ktd_excess": ("from the base layer alone", 1),
    "generated_ktd_excess": ("generated: KTD over real", 1),
    "generated_nine_band_db": ("nine-band error on unseen surfaces, dB", 2),
    "generated_level_r": ("r of level", 2),
}
_RATE = {
    "rate_kbit_s": ("kbit/s", 2),
    "nine_band_db": ("nine-band error, dB", 2),
    "decimated_nine_band_db": ("low-passed", 2),
    "snr_db": ("SNR, dB", 2),
    "decimated_snr_db": ("low-passed", 2),
    "ktd_excess": ("KTD over real", 1),
    "decimated_ktd_excess": ("low-passed", 1),
}


def averaged(results):
    """The mean over seeds of each row: name of a group -> result; what is not a number is the first seed's."""
    groups = {}
    for name, result in results.items():
        groups.setdefault(result.get("group", name), []).append(result)
    return {name: _mean(members) for name, members in groups.items()}


def _mean(values):
    first = values[0]
    if isinstance(first, dict):
        return {key: _mean([value[key] for value in values]) for key in first}
    if isinstance(first, list):
        return [_mean(list(members)) for members in zip(*values, strict=True)]
    numbers = all(isinstance(value, int | float) for value in values) and any(value != first for value in values)
    return sum(values) / len(values) if numbers else first


def seed_rows(results):
    """Each training by itself: name -> its reconstructions at 10 steps, and what it generates."""
    rows = {}
    for name, result in results.items():
        generated = {f"generated_{key}": value for key, value in result.get("generation", {}).items()}
        shown = {key: value for key, value in _main(result).items() if key in _MAIN}
        rows[name] = shown | generated
    return rows


def markdown(results, data, split, pictures=".", short=False, shortened=1):
    """Tables and pictures of an ablation.

    Args:
        results (`dict[str, dict]`): name of a row -> its result.json.
        data, split (`str`): what the rows were measured on.
        pictures (`str`): folder of the pictures, and of report.md, as the text links to it.
        short (`bool`): without the tables of bands and of rate and distortion, which are in report.md.
        shortened (`int`): how many times shorter than the rows say the trainings were.
    """
    seeds, trained = sorted({result["seed"] for result in results.values() if result.get("seed") is not None}), results
    results = averaged(results)
    titles = {name: f"{result['question']} (`{name}`)" for name, result in results.items()}
    finalists = {name: result for name, result in results.items() if "generation" in result}
    machines = sorted({f"{r['machine']['processor']}, {r['machine']['threads']} thread(s)" for r in results.values()})
    parts = [
        f"Trained on `{data}`, measured on its {split} surfaces ({'; '.join(machines)}), 10 steps, generated in the "
        "pipeline's own number (5 where nothing is distilled). Real "
        "held-out segments stand for 0 in every distance over real."
        + (f" Means of {len(seeds)} trainings, seeds {', '.join(map(str, seeds))}." if seeds else "")
        + (f" **A trial: trainings {shortened} times shorter than the rows say.**" if shortened > 1 else ""),
        markdown_table({titles[name]: _main(result) for name, result in results.items()}, labels=_MAIN),
        f"![nine-band error and KTD of every row]({pictures}/rows.png)",
    ]
    if not short:
        parts += [
            "Signed error of each band at 10 steps, dB:",
            markdown_table({titles[name]: _signed(result) for name, result in results.items()}, labels=BANDS),
        ]
    if finalists:
        table = {titles[name]: result["generation"] | result for name, result in finalists.items()}
        parts += ["The whole pipeline, from ratings, without guidance:", markdown_table(table, labels=_FINALISTS)]
    if len(seeds) > 1:
        parts += ["Each training:", markdown_table(seed_rows(trained), labels=_SEEDS)]
    parts += [
        "Rate and distortion: latents that carry Gaussian noise, beside the texture low-passed to as many numbers "
        "and bits a second:",
        f"![nine-band error and SNR over bits]({pictures}/rate_distortion.png)",
        f"[All tables]({pictures}/report.md)" if short else markdown_table(_points(results), labels=_RATE),
    ]
    return "\n\n".join(parts) + "\n"


def check_result(result):
    """Refuses a result.json of which no table or picture can be made.

    Raises:
        ValueError, KeyError, TypeError, AttributeError: saying what is missing or of another kind.
    """
    markdown({"row": {"question": "", **result}}, "", "")
    points = result["rate_distortion"]
    drawn = [result["steps"]["10"], result.get("generation", {}), *points, *(point["decimated"] for point in points)]
    for entry in drawn:
        for key in ("nine_band_db", "ktd_excess", "snr_db", "rate_kbit_s"):
            if not isinstance(entry.get(key), int | float | None):
                raise ValueError(f"{key} is {entry[key]!r}, no number")


def _points(results):
    """The points of every row's rate-distortion curve, flat."""
    points = {}
    for name, result in results.items():
        for point in result["rate_distortion"]:
            kind = ", base layer only" if point["base_only"] else ""
            low_passed = {f"decimated_{key}": value for key, value in point["decimated"].items()}
            points[f"`{name}`, noise {point['sigma']:g}{kind}"] = point | low_passed
    return points


def _main(result):
    few, many = result["steps"]["5"], result["steps"]["10"]
    shown = {f"{key}_5": few[key] for key in ("nine_band_db", "ktd_excess")}
    alone = [point for point in result["rate_distortion"] if point["base_only"]]
    shown |= {f"base_{key}": alone[0][key] if alone else None for key in ("nine_band_db", "ktd_excess")}
    scaled = {"millions": result["parameters"] / 1e6, "training_minutes": result["training_seconds"] / 60}
    return result | many | shown | scaled


def _signed(result):
    return result["steps"]["10"]["signed_db"]


def plot_rows(results, output_path):
    """Every row as a point: nine-band error against KTD of reconstructions, and of what finalists generate."""
    sets = {"reconstructed, 10 steps": {name: result["steps"]["10"] for name, result in results.items()}}
    generated = {name: result["generation"] for name, result in results.items() if "generation" in result}
    if generated:
        sets["generated for unseen surfaces"] = generated
    with figure_panels(output_path, 1, len(sets), (6.5 * len(sets), 4.5)) as panels:
        for panel, (title, entries) in zip(panels[0], sets.items(), strict=True):
            for name, entry in entries.items():
                if None in (entry["nine_band_db"], entry["ktd_excess"]):
                    continue
                place = (entry["nine_band_db"], entry["ktd_excess"])
                panel.plot(*place, linestyle="", marker="o", color=_colours(results)[name], label=name)
            panel.axhline(0, color="black", linewidth=1, label="real, held out")
            panel.set(title=title, xlabel="nine-band error, dB", ylabel="KTD over real")
            panel.legend(fontsize=7, loc="center left", bbox_to_anchor=(1, 0.5))


def plot_rate_distortion(results, output_path):
    """Nine-band error and SNR over bits: each row, and dotted the texture low-passed to its numbers and bits."""
    points = [point for result in results.values() for point in result["rate_distortion"]]
    with figure_panels(output_path, 1, 2, (13, 5)) as panels:
        for panel, key in zip(panels[0], ("nine_band_db", "snr_db"), strict=True):
            _plot_curves(panel, results, key)
            if key == "nine_band_db":
                panel.set_ylim(panel.get_ylim())  # missing highs are tens of dB: rows would all be one line
            _plot_low_passed(panel, results, key)
            if any(point["base_only"] for point in points):
                panel.plot([], [], color="grey", linestyle="", marker="*", markersize=9, label="base layer only")
            panel.plot([], [], color="grey", linestyle=":", label="low-passed to the same bits")
            panel.set(xscale="log", xlabel="kbit/s", title="SNR, dB")
            panel.legend(fontsize=7)
        far = [point["decimated"]["nine_band_db"] for point in points]
        panels[0, 0].set_title(f"nine-band error, dB (low-passed: {min(far):.1f} to {max(far):.1f})")


def _plot_curves(panel, results, key):
    """Each row's points, joined; a star where only the base layer was given."""
    for name, result in results.items():
        colour = _colours(results)[name]
        points = [point for point in result["rate_distortion"] if point[key] is not None]
        layers = [point for point in points if not point["base_only"]]
        rates, values = [point["rate_kbit_s"] for point in layers], [point[key] for point in layers]
        panel.plot(rates, values, marker="o", markersize=3, linewidth=1.2, color=colour, label=name)
        for point in points:
            if point["base_only"]:
                panel.plot(point["rate_kbit_s"], point[key], marker="*", markersize=9, color=colour)


def _plot_low_passed(panel, results, key):
    for name, result in results.items():
        points = [point for point in result["rate_distortion"] if not point["base_only"]]
        points = [point for point in points if point["decimated"][key] is not None]
        rates, values = [point["rate_kbit_s"] for point in points], [point["decimated"][key] for point in points]
        panel.plot(rates, values, linestyle=":", linewidth=1, color=_colours(results)[name])


def _colours(results):
    # the ten strong colours first, then their pale ones
    import matplotlib

    shades = matplotlib.colormaps["tab20"].colors
    shades = shades[::2] + shades[1::2]
    return {name: shades[index % len(shades)] for index, name in enumerate(results)}

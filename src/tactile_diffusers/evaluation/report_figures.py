"""Pictures of a report, and the one helper that writes pictures."""

from contextlib import contextmanager

import numpy as np

from ..io.files import atomic_path
from ..signal import RATING_AXES, nine_band_error_db, power_spectral_density
from .labels import BANDS, compared_steps

_DPI = 90
_DOTS = {"marker": "o", "markersize": 3}


@contextmanager
def figure_panels(output_path, rows, columns, size):
    """Yields an array of panels (rows, columns), then gives each a grid and writes the PNG; `size` in inches."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, panels = plt.subplots(rows, columns, figsize=size, constrained_layout=True, squeeze=False)
    try:
        for panel in panels.flat:
            panel.grid(alpha=0.3)
        yield panels
        with atomic_path(output_path) as temporary:
            figure.savefig(temporary, dpi=_DPI, format="png")
    finally:
        plt.close(figure)


def leaf_mean(leaf):
    """Mean of a leaf, NaN where there is none."""
    return np.nan if leaf["mean"] is None else leaf["mean"]


def share_limits(row):
    """Gives the panels of a row one vertical scale, so that axes can be compared."""
    limits = np.array([panel.get_ylim() for panel in row])
    for panel in row:
        panel.set_ylim(limits[:, 0].min(), limits[:, 1].max())


def _step_ticks(panel, counts):
    panel.set(xscale="log", xlabel="steps")
    panel.set_xticks(counts, [str(count) for count in counts], fontsize=6)
    panel.minorticks_off()


def plot_overlays(real, reconstructed, sampling_rate, edges, output_path, seconds=0.2):
    """Best, median and worst segment (n, samples) by nine-band error: original and reconstruction in time and
    frequency.

    `edges` are of the nine bands, Hz; `seconds` are shown of each waveform.
    """
    errors = nine_band_error_db(reconstructed, real, sampling_rate, edges)
    order = np.argsort(errors)
    shown = {"best": order[0], "median": order[len(order) // 2], "worst": order[-1]}
    start = real.shape[-1] // 2
    piece = slice(start, start + int(seconds * sampling_rate))
    with figure_panels(output_path, 2, 3, (13, 6)) as panels:
        for (waves, spectra), (name, row) in zip(panels.T, shown.items(), strict=True):
            for texture, label in ((real[row], "original"), (reconstructed[row], "reconstruction")):
                time = np.arange(piece.start, piece.stop) / sampling_rate
                waves.plot(time, 1e3 * texture[piece], linewidth=0.8, label=label)
                frequencies, density = power_spectral_density(texture, sampling_rate)
                spectra.semilogx(frequencies[1:], 10 * np.log10(density[1:] + 1e-20), linewidth=0.9, label=label)
            waves.set(title=f"{name}: nine-band error {errors[row]:.2f} dB", xlabel="s", ylabel="mN")
            spectra.set(xlim=(15, 2000), ylim=(-130, -40), xlabel="Hz", ylabel="dB re 1 N²/Hz")
        panels[0, 0].legend(fontsize=8)


def plot_steps(result, output_path):
    """Error, distance and cost against the number of steps, beside another take of the surface and no network."""
    steps = {int(count): entry for count, entry in result["steps"].items()}
    quantities = {
        "nine_band_db": "nine-band error, dB",
        "ktd": "KTD to the training surfaces",
        "snr_db": "SNR, dB",
        "seconds_per_segment": "s per segment",
        "efficiency_score": "efficiency score (RMSE × s), N·s",
    }
    with figure_panels(output_path, 1, len(quantities), (3.4 * len(quantities), 3.2)) as panels:
        for panel, (name, label) in zip(panels[0], quantities.items(), strict=True):
            panel.plot(list(steps), [leaf_mean(entry[name]) for entry in steps.values()], label="LCTG", **_DOTS)
            others = {"another take": ("grey", result["baselines"]["other_take"])}
            others["no network"] = ("C1", result["decoders"]["no_network"])
            for other, (colour, entry) in others.items():
                if entry.get(name, {}).get("mean") is not None:
                    panel.axhline(entry[name]["mean"], color=colour, linestyle="--", linewidth=1, label=other)
            if name == "ktd":
                panel.axhline(leaf_mean(result["real"]["ktd"]), color="green", linewidth=1, label="real, held out")
            panel.set_title(label)
            _step_ticks(panel, list(steps))
            panel.legend(fontsize=7)


def plot_beside(reconstruction, anchors, output_path):
    """The checkpoint beside the anchors (name -> entry with "steps"): nine-band error over steps, error by band."""
    sweeps = {"this checkpoint": reconstruction["steps"]} | {name: entry["steps"] for name, entry in anchors.items()}
    top = 1.0  # dB; a single step is far off and would set the scale
    with figure_panels(output_path, 1, 2, (12, 3.8)) as (panels,):
        for index, (name, steps) in enumerate(sweeps.items()):
            errors = [leaf_mean(entry["nine_band_db"]) for entry in steps.values()]
            panels[0].plot([int(count) for count in steps], errors, label=name, **_DOTS)
            shown = compared_steps(steps)
            leaves = [steps[shown][key] for key in BANDS]
            means = np.array([leaf_mean(leaf) for leaf in leaves])
            bounds = np.array([leaf["interval"] or [leaf_mean(leaf)] * 2 for leaf in leaves]).T
            # side by side, so that intervals do not hide each other
            places = np.arange(len(BANDS)) + 0.12 * (index - (len(sweeps) - 1) / 2)
            reach, top = np.abs(bounds - means), max(top, 2 * np.nan_to_num(leaf_mean(steps[shown]["nine_band_db"])))
            panels[1].errorbar(places, means, reach, fmt="o", markersize=4, capsize=2, label=f"{name}, {shown} steps")
        panels[0].set(ylabel="nine-band error, dB", ylim=(0, top))
        _step_ticks(panels[0], sorted({int(count) for steps in sweeps.values() for count in steps}))
        panels[1].axhline(0, color="grey", linewidth=1)
        panels[1].set_xticks(range(len(BANDS)), BANDS.values(), fontsize=8)
        panels[1].set(ylabel="signed error of the band, dB")
        for panel in panels:
            panel.legend(fontsize=8)


def plot_control(control, guidance, output_path):
    """Level, shape and friction against one requested rating: generated, ridge baseline, and the truth."""
    quantities = {"level_db": "level, dB re 1 N", "shape_db": "shape change, dB", "log_friction": "log friction"}
    generated, ridge = control[str(guidance)]["axes"], control["baselines"]["ridge"]["axes"]
    with figure_panels(output_path, len(quantities), len(RATING_AXES), (12, 8.5)) as panels:
        for row, (name, label) in zip(panels, quantities.items(), strict=True):
            for panel, axis in zip(row, RATING_AXES, strict=True):
                values, truth = [float(v) for v in generated[axis]], f"{name}_truth"
                for entries, key, style in (
                    (generated, name, {"color": "C0", "marker": "o", "label": "generated"}),
                    (ridge, name, {"color": "C1", "marker": "o", "linestyle": ":", "label": "ridge"}),
                    (generated, truth, {"color": "black", "marker": "s", "label": "real"}),
                ):
                    panel.plot(values, [leaf_mean(e[key]) for e in entries[axis].values()], markersize=3, **style)
                bounds = [entry[truth]["interval"] or [np.nan] * 2 for entry in generated[axis].values()]
                panel.fill_between(values, *np.transpose(bounds), color="black", alpha=0.15, linewidth=0)
                panel.set(xlabel=f"requested {axis}, z", ylabel=label)
            share_limits(row)
        panels[0, 0].legend(fontsize=8)


def plot_curves(curves, output_path):
    """Level, centroid, friction and the judge's estimate over the whole range of one rating: generated and blend."""
    quantities = {"level_db": "level, dB re 1 N", "centroid_hz": "centroid, Hz", "log_friction": "log friction"}
    quantities["estimate"] = "judge's estimate, z"
    styles = {"model": {"color": "C0", "label": "generated"}, "knn_blend": {"color": "C1", "label": "blend"}}
    with figure_panels(output_path, len(quantities), len(RATING_AXES), (12, 11)) as panels:
        for row, (name, label) in zip(panels, quantities.items(), strict=True):
            for panel, axis in zip(row, RATING_AXES, strict=True):
                for source, by_axis in curves.items():
                    values, leaves = zip(*by_axis[axis]["values"].items(), strict=True)
                    ratings, shown = list(map(float, values)), [entry[name] for entry in leaves]
                    panel.plot(ratings, list(map(leaf_mean, shown)), **styles[source], **_DOTS)
                    bounds = np.transpose([leaf["interval"] or [np.nan] * 2 for leaf in shown])
                    panel.fill_between(ratings, *bounds, color=styles[source]["color"], alpha=0.2, linewidth=0)
                panel.axvspan(-2, 2, color="grey", alpha=0.12, linewidth=0)
                panel.set(xlabel=f"requested {axis}, z (grey: as in training)", ylabel=label)
            share_limits(row)
        panels[0, 0].legend(fontsize=8)


def plot_responses(control, guidance, output_path):
    """Response matrices: slope of the judge's estimates on requested ratings."""
    matrices = {
        "real, held out": control["response_real"],
        f"generated, guidance {guidance:g}": control[str(guidance)]["response"],
        **{slug: entry["response"] for slug, entry in control["baselines"].items()},
    }
    with figure_panels(output_path, 1, len(matrices), (3.4 * len(matrices), 3.3)) as panels:
        for panel, (name, matrix) in zip(panels[0], matrices.items(), strict=True):
            slopes = np.array([[leaf_mean(leaf) for leaf in row] for row in matrix])
            panel.imshow(slopes, cmap="RdBu_r", vmin=-1, vmax=1)
            for (i, j), slope in np.ndenumerate(slopes):
                colour = "white" if abs(slope) > 0.6 else "black"
                panel.text(j, i, f"{slope:.2f}", ha="center", va="center", color=colour)
            panel.set_xticks(range(3), RATING_AXES, fontsize=8)
            panel.set_yticks(range(3), RATING_AXES, fontsize=8, rotation=90, va="center")
            panel.set(title=name, xlabel="requested", ylabel="estimated")
            panel.grid(False)


def plot_latent_shift(shift, output_path):
    """The paper's Figure 2: shift of the latent against one rating, the noise fixed."""
    with figure_panels(output_path, 1, 1, (5.5, 3.6)) as ((panel,),):
        for axis, values in shift.items():
            panel.plot([float(v) for v in values], list(map(leaf_mean, values.values())), label=axis, **_DOTS)
        panel.axhspan(0, 2, color="grey", alpha=0.3, linewidth=0, label="range in the paper")
        panel.set(xlabel="rating, z (others 0)", ylabel="latent shift, %", ylim=(0, None))
        panel.legend(fontsize=8)


def plot_spectra(densities, frequencies, output_path):
    """Average spectra, dB re 1 N²/Hz, while one rating runs (paper section 3.4)."""
    import matplotlib

    colours = matplotlib.colormaps["coolwarm"]
    with figure_panels(output_path, 1, len(densities), (13, 3.8)) as panels:
        for panel, (axis, spectra) in zip(panels[0], densities.items(), strict=True):
            low, high = min(spectra), max(spectra)
            for value, density in spectra.items():
                colour = colours((value - low) / (high - low))
                panel.semilogx(frequencies[1:], density[1:], color=colour, label=f"{value:+.1f}")
            panel.set(title=axis, xlim=(15, 1300), ylim=(-115, -45), xlabel="Hz", ylabel="dB re 1 N²/Hz")
        panels[0, 0].legend(fontsize=6, ncols=2, title="rating, z", title_fontsize=7)


def plot_told_apart(rows, output_path):
    """Shares of right answers of the second judge in each row, with 95 % intervals, and chance."""
    colours = {"signal": "tab:blue", "afferents": "tab:orange"}
    with figure_panels(output_path, 1, 2, (11, 0.4 * len(rows) + 1.2)) as panels:
        for panel, kind in zip(panels[0], ("alone", "beside_surface"), strict=True):
            for shift, (features, colour) in zip((-0.12, 0.12), colours.items(), strict=True):
                for place, entry in enumerate(rows.values()):
                    leaf = entry[features][kind]["all"]
                    label = features if place == 0 else None
                    panel.plot(leaf_mean(leaf), place + shift, "o", color=colour, markersize=4, label=label)
                    panel.plot(leaf["interval"] or [], [place + shift] * len(leaf["interval"] or []), color=colour)
            panel.axvline(0.5, color="grey", linestyle="--")
            panel.set(title=kind.replace("_", " the "), xlabel="share told from real takes", xlim=(0.3, 1.02))
            panel.set_yticks(range(len(rows)), [name.replace("_", " ") for name in rows])
            panel.invert_yaxis()
        panels[0, 0].legend(fontsize=7)


def plot_unseen(bands, output_path):
    """Mean spectra of unseen surfaces, real against generated, one dot a surface and band: name -> two (n, 9) dB."""
    with figure_panels(output_path, 1, len(bands), (3.6 * len(bands), 3.6)) as panels:
        for panel, (name, (real, generated)) in zip(panels[0], bands.items(), strict=True):
            colour = np.tile(np.arange(real.shape[1]), (len(real), 1))
            panel.scatter(real, generated, c=colour, cmap="viridis", s=6)
            panel.plot([real.min(), real.max()], [real.min(), real.max()], color="grey", linewidth=1)
            panel.set(title=f"{name}: {np.abs(generated - real).mean():.2f} dB")
            panel.set(xlabel="real, dB re 1 N²", ylabel="generated")

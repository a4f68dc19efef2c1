"""Pictures of a report, and the one helper that writes pictures of results."""

from contextlib import contextmanager

import numpy as np

from tactile_diffusers.io.files import atomic_path
from tactile_diffusers.signal import nine_band_error_db, power_spectral_density

_DPI = 90
_TICKS_HZ = (30, 100, 300, 1000)
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


def plot_overlays(real, reconstructed, sampling_rate, edges, output_path, unit="N", seconds=0.2):
    """Best, median and worst segment (n, samples) by nine-band error, in time (`seconds` of it) and frequency."""
    factor, name_of_unit, squared = (1e3, "mN", "N²") if unit == "N" else (1, "counts", "count²")
    errors = nine_band_error_db(reconstructed, real, sampling_rate, edges)
    order = np.argsort(errors)
    shown = {"best": order[0], "median": order[len(order) // 2], "worst": order[-1]}
    start = real.shape[-1] // 2
    piece = slice(start, start + int(seconds * sampling_rate))
    with figure_panels(output_path, 2, 3, (13, 6)) as panels:
        for (waves, spectra), (name, row) in zip(panels.T, shown.items(), strict=True):
            top = -200.0
            for texture, label in ((real[row], "original"), (reconstructed[row], "reconstruction")):
                time = np.arange(piece.start, piece.stop) / sampling_rate
                waves.plot(time, factor * texture[piece], linewidth=0.8, label=label)
                frequencies, density = power_spectral_density(texture, sampling_rate)
                level = 10 * np.log10(density[1:] + 1e-20)
                spectra.semilogx(frequencies[1:], level, linewidth=0.9, label=label)
                top = max(top, 10 * np.ceil(level.max() / 10))
            waves.set(title=f"{name}: nine-band error {errors[row]:.2f} dB", xlabel="s", ylabel=name_of_unit)
            spectra.set(xlim=(15, 2000), ylim=(top - 80, top), xlabel="Hz", ylabel=f"dB re 1 {squared}/Hz")
        panels[0, 0].legend(fontsize=8)


def _over_ratings(quantities, axes, path, draw):
    """A panel for each quantity (row) and rating axis: `draw` gets panel, axis and the quantity's key."""
    with figure_panels(path, len(quantities), len(axes), (12, 2.8 * len(quantities))) as panels:
        for row, (name, label) in zip(panels, quantities.items(), strict=True):
            for panel, axis in zip(row, axes, strict=True):
                draw(panel, axis, name)
                panel.set(xlabel=f"requested {axis}, z", ylabel=label)
            share_limits(row)
        panels[0, 0].legend(fontsize=8)


def _band(panel, values, leaves, colour):
    """The intervals of leaves."""
    bounds = np.transpose([leaf["interval"] or [np.nan] * 2 for leaf in leaves])
    panel.fill_between(values, *bounds, color=colour, alpha=0.2, linewidth=0)


def plot_control(control, guidance, output_path):
    """Level, shape and friction against one requested rating: generated, ridge baseline, and the truth."""
    generated, ridge = control[str(guidance)]["axes"], control["baselines"]["ridge"]["axes"]

    def draw(panel, axis, name):
        values, truth = [float(value) for value in generated[axis]], f"{name}_truth"
        for entries, key, style in (
            (generated, name, {"color": "C0", "label": "generated"}),
            (ridge, name, {"color": "C1", "linestyle": ":", "label": "ridge"}),
            (generated, truth, {"color": "black", "label": "real"}),
        ):
            panel.plot(values, [leaf_mean(entry[key]) for entry in entries[axis].values()], **_DOTS, **style)
        _band(panel, values, [entry[truth] for entry in generated[axis].values()], "black")

    quantities = {"level_db": "level, dB re 1 N", "shape_db": "shape change, dB", "log_friction": "log friction"}
    _over_ratings(quantities, generated, output_path, draw)


def plot_curves(curves, output_path):
    """Level, centroid, friction and the judge's estimate over the whole range of one rating: generated and blend."""
    styles = {"model": {"color": "C0", "label": "generated"}, "knn_blend": {"color": "C1", "label": "blend"}}

    def draw(panel, axis, name):
        for source, by_axis in curves.items():
            values, shown = zip(*((float(v), e[name]) for v, e in by_axis[axis]["values"].items()), strict=True)
            panel.plot(values, list(map(leaf_mean, shown)), **styles[source], **_DOTS)
            _band(panel, values, shown, styles[source]["color"])
        panel.axvspan(-2, 2, color="grey", alpha=0.12, linewidth=0)  # as in training

    quantities = {"level_db": "level, dB re 1 N", "centroid_hz": "centroid, Hz", "log_friction": "log friction"}
    _over_ratings(quantities | {"estimate": "judge's estimate, z"}, curves["model"], output_path, draw)


def plot_latent_shift(shift, output_path):
    """The paper's Figure 2: shift of the latent against one rating, the noise fixed."""
    with figure_panels(output_path, 1, 1, (5.5, 3.6)) as ((panel,),):
        for axis, values in shift.items():
            panel.plot([float(v) for v in values], list(map(leaf_mean, values.values())), label=axis, **_DOTS)
        panel.axhspan(0, 2, color="grey", alpha=0.3, linewidth=0, label="range in the paper")
        panel.set(xlabel="rating, z (others 0)", ylabel="latent shift, %", ylim=(0, None))
        panel.legend(fontsize=8)


def plot_axis_spectra(spectra, output_path):
    """Mean nine-band spectra while one rating runs (paper section 3.4), a row of panels for each of some checkpoints.

    `spectra` is name -> axis -> rating -> band such as "20-31 Hz" -> leaf, dB re 1 N².
    """
    import matplotlib

    colours = matplotlib.colormaps["coolwarm"]
    with figure_panels(output_path, len(spectra), max(map(len, spectra.values())), (12, 3.4 * len(spectra))) as panels:
        for row, (name, axes) in zip(panels, spectra.items(), strict=True):
            for panel, axis in zip(row, axes, strict=False):
                values = sorted(axes[axis], key=float)
                low, high = float(values[0]), float(values[-1])
                for value in values:
                    bands, colour = axes[axis][value], colours((float(value) - low) / (high - low))
                    means = list(map(leaf_mean, bands.values()))
                    panel.semilogx(list(map(band_centre, bands)), means, color=colour, label=f"{float(value):+.1f}")
                panel.set(title=f"{name}: {axis}", xlabel="Hz", ylabel="dB re 1 N²")
                panel.set_xticks(_TICKS_HZ, labels=[str(tick) for tick in _TICKS_HZ])
                panel.minorticks_off()
        share_limits(panels.ravel())  # with one scale, a checkpoint that hardly responds is seen
        panels[0, 0].legend(fontsize=6, ncols=2, title="rating, z", title_fontsize=7)


def band_centre(band):
    """Geometric mean of the edges of a band such as "20-31 Hz", Hz."""
    low, high = (float(edge) for edge in band.removesuffix(" Hz").split("-"))
    return (low * high) ** 0.5


def plot_told_apart(rows, output_path):
    """Shares of right answers of the second judge in each row, with 95 % intervals, and chance."""
    colours = {"signal": "tab:blue", "afferents": "tab:orange"}
    with figure_panels(output_path, 1, 2, (11, 0.4 * len(rows) + 1.2)) as panels:
        for panel, kind in zip(panels[0], ("alone", "beside_surface"), strict=True):
            for shift, (features, colour) in zip((-0.12, 0.12), colours.items(), strict=True):
                leaves = [entry[features][kind]["all"] for entry in rows.values()]
                means, places = np.array(list(map(leaf_mean, leaves))), np.arange(len(rows)) + shift
                bounds = np.transpose([leaf["interval"] or [np.nan] * 2 for leaf in leaves])
                panel.errorbar(means, places, xerr=np.abs(bounds - means), fmt="o", color=colour, label=features)
            panel.axvline(0.5, color="grey", linestyle="--")
            panel.set(title=kind.replace("_", " the "), xlabel="share told from real takes", xlim=(0.3, 1.02))
            panel.set_yticks(range(len(rows)), [name.replace("_", " ") for name in rows])
            panel.invert_yaxis()
        panels[0, 0].legend(fontsize=7)

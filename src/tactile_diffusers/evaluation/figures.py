"""Pictures of the studies."""


def plot_sweeps(sweeps, output_path):
    """Mean spectra while one rating moves, one panel an axis, and the quantities that move, as a PNG.

    Args:
        sweeps (`dict[str, dict]`): axis -> result of `rating_sweep`.
        output_path (`str` or `Path`): the PNG.
    """
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    import numpy as np

    quantities = {"level_db": "level, dB re 1 N", "share_150_400": "share 150–400 Hz", "log_friction": "log friction"}
    figure, panels = plt.subplots(
        2, len(sweeps), figsize=(4.6 * len(sweeps), 6.2), constrained_layout=True, squeeze=False
    )
    for (spectrum_panel, lines_panel), (axis, sweep) in zip(panels.T, sweeps.items(), strict=True):
        values = np.array(sweep["values"])
        for value, spectrum in zip(values, sweep["spectrum_db"], strict=True):
            colour = plt.cm.coolwarm((value - values[0]) / (values[-1] - values[0]))
            spectrum_panel.semilogx(sweep["frequencies"][1:], spectrum[1:], color=colour, label=f"{value:+.1f}")
        spectrum_panel.set(title=axis, xlim=(15, 1300), ylim=(-115, -45), xlabel="Hz", ylabel="dB re 1 N²/Hz")
        spectrum_panel.grid(alpha=0.3)
        for name, label in quantities.items():
            track = np.array(sweep[name])
            spread = {"level_db": 10.0, "share_150_400": 0.3, "log_friction": 0.5}[name]
            lines_panel.plot(
                values, (track - track.mean()) / spread, marker="o", markersize=3, label=f"{label} / {spread:g}"
            )
        lines_panel.set(xlabel=f"requested {axis}, z", ylabel="change from the mean, scaled")
        lines_panel.grid(alpha=0.3)
    panels[0, 0].legend(fontsize=6, ncols=2, title="rating, z", title_fontsize=7)
    panels[1, 0].legend(fontsize=7)
    figure.savefig(output_path, dpi=90)
    plt.close(figure)

"""Picture of the latents: what a blend of two surfaces does to the nine bands, and how the channels are distributed."""

import numpy as np

from .report_figures import figure_panels

# of the histogram: range in standard deviations and number of bins
_REACH, _BINS = 4.0, 65


def plot_latents(blends, standardised, edges, output_path):
    """Band levels over the blend of pairs of surfaces, and histograms of the standardised channels.

    Args:
        blends (`dict[str, np.ndarray]`): title -> (weights, bands), dB re 1 N^2.
        standardised (`dict[str, np.ndarray]`): layer -> (n, channels, frames), zero mean and unit variance a channel;
            channels that hold NaN are left out.
        edges (`np.ndarray`): (bands + 1,) Hz.
        output_path (`Path`): the PNG.
    """
    import matplotlib

    with figure_panels(output_path, 1, len(blends) + 1, (3.4 * (len(blends) + 1), 3.6)) as panels:
        *shown, histogram = panels[0]
        colours = matplotlib.colormaps["viridis"](np.linspace(0, 0.95, len(edges) - 1))
        for panel, (title, curves) in zip(shown, blends.items(), strict=True):
            weights = np.linspace(0, 1, len(curves))
            for levels, low, high, colour in zip(curves.T, edges[:-1], edges[1:], colours, strict=True):
                panel.plot(weights, levels, color=colour, marker="o", markersize=2, label=f"{low:.0f}–{high:.0f} Hz")
            panel.set_title(title, fontsize=9)
            panel.set(xlabel="weight of the second surface", ylabel="dB re 1 N²")
            panel.grid(alpha=0.3)
        if shown:
            shown[0].legend(fontsize=6, ncols=2)
        _plot_histogram(histogram, standardised)


def _plot_histogram(panel, standardised):
    bins = np.linspace(-_REACH, _REACH, _BINS)
    centres = 0.5 * (bins[1:] + bins[:-1])
    for layer, values in standardised.items():
        density, _ = np.histogram(values[np.isfinite(values)], bins, density=True)
        panel.plot(centres, density, label=layer)
    panel.plot(centres, np.exp(-0.5 * centres**2) / np.sqrt(2 * np.pi), color="black", linestyle=":", label="Gaussian")
    panel.set_title("channels, each standardised", fontsize=9)
    panel.set(xlabel="standard deviations", ylabel="density")
    panel.grid(alpha=0.3)
    panel.legend(fontsize=7)

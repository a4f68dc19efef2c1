"""Pictures of a training, drawn from its log; each is whole or absent."""

from ..io.files import atomic_path
from .record import read_entries


def plot_losses(log_path, output_path):
    """Loss curves of a training (`log.jsonl`) as a PNG: training values left, validation values right.

    Args:
        log_path (`str` or `Path`): one JSON object a line, with "step" and scalars; damaged lines are left out.
        output_path (`str` or `Path`): the PNG.
    """
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    entries = read_entries(log_path)
    figure, axes = plt.subplots(1, 2, figsize=(10, 3.5), constrained_layout=True)
    for axis, prefix in zip(axes, ("train/", "validation/"), strict=True):
        for key in sorted({k for entry in entries for k in entry if k.startswith(prefix)}):
            points = [(entry["step"], entry[key]) for entry in entries if key in entry]
            alone = "o" if len(points) == 1 else ""  # a line needs two
            axis.plot(*zip(*points, strict=True), label=key.removeprefix(prefix), linewidth=1.2, marker=alone)
        axis.set(xlabel="optimiser step", title=prefix.rstrip("/"))
        if prefix == "train/":
            axis.set_yscale("log")
        axis.grid(alpha=0.3)
        axis.legend(fontsize=8)
    _save(figure, output_path, dpi=100)


def plot_reconstructions(references, textures, sampling_rate, output_path):
    """Waveforms (first 0.2 s) and spectra of textures over their references, one row each, as a PNG.

    Args:
        references, textures (`np.ndarray`): (n, samples), N.
        sampling_rate (`int`): Hz.
        output_path (`str` or `Path`): the PNG.
    """
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    import numpy as np

    from ..signal import power_spectral_density

    figure, axes = plt.subplots(len(references), 2, figsize=(11, 2.2 * len(references)), constrained_layout=True)
    shown = slice(0, int(0.2 * sampling_rate))
    for (left, right), *pair in zip(np.atleast_2d(axes), references, textures, strict=True):
        for signal, label, width in zip(pair, ("real", "reconstructed"), (1.6, 0.8), strict=True):
            left.plot(np.arange(len(signal))[shown] / sampling_rate, signal[shown] * 1e3, label=label, linewidth=width)
            frequencies, density = power_spectral_density(signal, sampling_rate)
            right.loglog(frequencies[1:], density[1:], linewidth=width)
        left.set(xlabel="s", ylabel="mN")
        right.set(xlabel="Hz", ylabel="N²/Hz", xlim=(10, sampling_rate / 2), ylim=(1e-14, None))
    axes.flat[0].legend(fontsize=8)
    _save(figure, output_path, dpi=80)


def plot_axis_sweep(pipe, output_path, takes=8, values=(-2.0, -1.0, 0.0, 1.0, 2.0)):
    """Mean spectra of textures while one rating moves and the others are not specified, one panel an axis, as a PNG.

    Args:
        pipe (`TactileTexturePipeline`): with a DALE.
        output_path (`str` or `Path`): the PNG.
        takes (`int`): textures averaged per value, in dB.
        values (`tuple[float, ...]`): ratings, z-scores, as far as training surfaces reach.
    """
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    import numpy as np
    import torch

    from ..models import RatingStatistics
    from ..signal import power_spectral_density

    names = pipe.dale.config.rating_axes
    ranges = RatingStatistics.from_config(pipe.dale.config).range or [(min(values), max(values))] * len(names)
    figure, axes = plt.subplots(1, len(names), figsize=(4.5 * len(names), 3.4), constrained_layout=True, sharey=True)
    for axis, name, (low, high) in zip(axes, names, ranges, strict=True):
        generator = torch.Generator("cpu").manual_seed(0)
        asked = sorted({min(max(value, low), high) for value in values})  # two of them may end at the same bound
        told = _told_apart(asked)
        out = pipe([{name: v} for v in asked], num_textures_per_rating=takes, generator=generator)
        frequencies, density = power_spectral_density(out.textures, out.sampling_rate)
        spectra = (10 * np.log10(density + 1e-20)).reshape(len(asked), takes, -1).mean(1)
        friction = out.friction_coefficient.reshape(len(asked), takes).mean(1)
        for value, name_of_value, spectrum, mu in zip(asked, told, spectra, friction, strict=True):
            colour = plt.cm.coolwarm(0.5 + value / 2 / max(values) if max(values) else 0.5)
            axis.semilogx(frequencies[1:], spectrum[1:], color=colour, label=f"{name_of_value}, friction {mu:.2f}")
        axis.set(title=name, xlabel="Hz", xlim=(20, 1250), ylim=(-115, -45))
        axis.grid(alpha=0.3)
        axis.legend(fontsize=7)
    axes[0].set_ylabel("dB re 1 N²/Hz")
    _save(figure, output_path, dpi=80)


def _save(figure, path, dpi):
    import matplotlib.pyplot as plt

    try:
        with atomic_path(path) as temporary:
            figure.savefig(temporary, dpi=dpi, format="png")
    finally:
        plt.close(figure)


def _told_apart(values):
    """Different numbers as text, with as many decimals as tell them apart: three at most."""
    for decimals in (1, 2, 3):
        told = [f"{value:+.{decimals}f}" for value in values]
        if len(set(told)) == len(told):
            break
    return told

"""What validation measures and draws during a training: reconstructions, the effect of ratings, losses."""

from pathlib import Path

import numpy as np
import torch

from ..data.dataset import PreparedDataset
from ..io.files import atomic_path
from ..models import RatingStatistics
from ..signal import nine_band_error_db, power_spectral_density, resample
from .record import read_log


class Reconstructions:
    """Held-out textures, encoded and decoded with a fixed seed.

    Args:
        path (`str` or `Path`): of the prepared data set, whose split "validation" is read.
        pipe (`TactileTexturePipeline`): whose decoder is trained.
        count (`int`): textures.
        batch_size (`int`): decoded at once.

    Attributes:
        references (`np.ndarray`): (count, samples) the textures, in N, at `rate`.
        rate (`int`): Hz, at which textures are delivered.
    """

    def __init__(self, path, pipe, count, batch_size):
        dataset, self.pipe, self.batch_size = PreparedDataset(path, "validation", "filtered"), pipe, batch_size
        count = min(count, len(dataset))
        self.textures = dataset.textures(np.sort(np.random.default_rng(0).permutation(len(dataset))[:count]))
        self.sampling_rate, self.rate = dataset.sampling_rate, pipe.feature_extractor.delivery_rate
        self.references = resample(self.textures, dataset.sampling_rate, self.rate)

    def decode(self, model, steps, base_only=False):
        """Textures (count, samples), in N, that a decoder makes of the latents in so many steps.

        Args:
            model (`LCTGModel`): encodes and decodes.
            steps (`int`): of the solver.
            base_only (`bool`): from the base layer alone, which is what DALE generates.
        """
        others = dict.fromkeys(("dale", "dale_scheduler", "rating_estimator", "lctg_distilled"))
        pipe = type(self.pipe).from_pipe(self.pipe, lctg=model, **others)
        pipe.set_progress_bar_config(disable=True)
        decoded = []
        for start in range(0, len(self.textures), self.batch_size):
            encoded = pipe.encode(self.textures[start : start + self.batch_size], self.sampling_rate)
            latents = encoded.latents
            if base_only:
                latents = model.pad_detail(latents[:, : model.base_channels])
            generator = torch.Generator("cpu").manual_seed(start)
            out = pipe.decode(latents, encoded.level, num_inference_steps=steps, generator=generator)
            decoded.append(out.textures[:, : self.references.shape[-1]])
        return np.concatenate(decoded)

    def nine_band_db(self, decoded):
        """Mean nine-band error of decoded textures, dB."""
        return nine_band_error_db(decoded, self.references, self.rate).mean()

    def snr_db(self, decoded):
        """Mean signal-to-noise ratio of decoded textures, dB; silence has 0 dB."""
        error = np.square(decoded - self.references).mean(-1)
        return (10 * np.log10(np.square(self.references).mean(-1) / error)).mean()


# --- figures; each PNG is whole or absent


def plot_losses(folder):
    """Draws the losses of a training's folder from `log.jsonl` into `loss.png`: training left, validation right."""
    entries = read_log(folder)
    figure, axes = _subplots(1, 2, (10, 3.5))
    for axis, prefix in zip(axes[0], ("train/", "validation/"), strict=True):
        for key in sorted({k for entry in entries for k in entry if k.startswith(prefix)}):
            points = [(entry["step"], entry[key]) for entry in entries if key in entry]
            marker = "o" if len(points) == 1 else ""  # a line needs two points
            axis.plot(*zip(*points, strict=True), label=key.removeprefix(prefix), linewidth=1.2, marker=marker)
        axis.set(xlabel="optimiser step", title=prefix.rstrip("/"))
        if prefix == "train/":
            axis.set_yscale("log")
        axis.grid(alpha=0.3)
        if axis.lines:
            axis.legend(fontsize=8)
    _save(figure, Path(folder) / "loss.png")


def plot_reconstructions(references, textures, sampling_rate, output_path):
    """Draws waveforms (first 0.2 s) and spectra of textures over their references, both (n, samples) in N, as a PNG."""
    figure, axes = _subplots(len(references), 2, (11, 2.2 * len(references)))
    shown = slice(0, int(0.2 * sampling_rate))
    for (left, right), *pair in zip(axes, references, textures, strict=True):
        for signal, label, width in zip(pair, ("real", "reconstructed"), (1.6, 0.8), strict=True):
            left.plot(np.arange(len(signal))[shown] / sampling_rate, signal[shown] * 1e3, label=label, linewidth=width)
            frequencies, density = power_spectral_density(signal, sampling_rate)
            right.loglog(frequencies[1:], density[1:], linewidth=width)
        left.set(xlabel="s", ylabel="mN")
        right.set(xlabel="Hz", ylabel="N²/Hz", xlim=(10, sampling_rate / 2), ylim=(1e-14, None))
    axes.flat[0].legend(fontsize=8)
    _save(figure, output_path)


def plot_axis_sweep(pipe, output_path, takes=8, values=(-2.0, -1.0, 0.0, 1.0, 2.0)):
    """Draws mean spectra of textures while one rating moves and the others are not specified, one panel an axis.

    Args:
        pipe (`TactileTexturePipeline`): with a DALE.
        output_path (`str` or `Path`): the PNG.
        takes (`int`): textures per value, whose spectra are averaged in dB.
        values (`tuple[float, ...]`): ratings, z-scores; those beyond the training surfaces' are moved to their range.
    """
    from matplotlib.cm import coolwarm

    names = pipe.dale.config.rating_axes
    ranges = RatingStatistics.from_config(pipe.dale.config).range or [(min(values), max(values))] * len(names)
    figure, axes = _subplots(1, len(names), (4.5 * len(names), 3.4), sharey=True)
    for axis, name, (low, high) in zip(axes[0], names, ranges, strict=True):
        generator = torch.Generator("cpu").manual_seed(0)
        ratings = sorted({min(max(value, low), high) for value in values})  # two may end at the same bound
        out = pipe([{name: v} for v in ratings], num_textures_per_rating=takes, generator=generator)
        frequencies, density = power_spectral_density(out.textures, out.sampling_rate)
        spectra = (10 * np.log10(density + 1e-20)).reshape(len(ratings), takes, -1).mean(1)
        friction = out.friction_coefficient.reshape(len(ratings), takes).mean(1)
        for value, spectrum, mu in zip(ratings, spectra, friction, strict=True):
            colour = coolwarm(0.5 + value / 2 / max(values) if max(values) else 0.5)
            axis.semilogx(frequencies[1:], spectrum[1:], color=colour, label=f"{value:+.2f}, friction {mu:.2f}")
        axis.set(title=name, xlabel="Hz", xlim=(20, 1250), ylim=(-115, -45))
        axis.grid(alpha=0.3)
        axis.legend(fontsize=7)
    axes[0, 0].set_ylabel("dB re 1 N²/Hz")
    _save(figure, output_path)


def _subplots(rows, columns, size, **options):
    from matplotlib.figure import Figure

    figure = Figure(size, layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, **options)


def _save(figure, path):
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=90, format="png")

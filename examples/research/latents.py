"""`python latents.py`: are the latents near-Gaussian, smooth in time, and do blends of two surfaces make sense?

Layers, as far as the checkpoint has them: DALE generates "levels" (of bands, measured), "envelope" (fast,
measured) and "base" (learned, bounded by 1); "detail" (the low end of the waveform, measured) only reconstructs.
All measures are recipes of ours; the participation ratio is (sum of eigenvalues)^2 / sum of their squares.
"""

import sys
from itertools import combinations, pairwise
from pathlib import Path

import numpy as np
import torch
from study_context import run_study
from tqdm.auto import tqdm

from tactile_diffusers.evaluation.metrics.statistics import jackknife, leaf, number
from tactile_diffusers.signal import band_levels_db, rms

sys.path.append(str(Path(__file__).parents[1]))  # examples, for `report`

from report.figures import figure_panels
from report.sampling import encode, noise_seeds
from report.tables import markdown_table
from report.tables import text as shown

#: Learned latents are bounded by 1 (tanh): beyond this they count as driven into the bound. Others have no bound.
NEAR_BOUND = 0.95
BOUNDED = ("base",)
#: Delays in latent frames that must delay the latents alike.
DELAYS = (1, 4)
#: Pairs of held-out surfaces that are blended, and weights of the second one.
PAIRS, BLEND_WEIGHTS = 12, np.linspace(0, 1, 9)
#: A band counts where the two surfaces differ by more; a step back of less is none, dB.
DIFFERENT_DB, TOLERANCE_DB = 3.0, 0.5
# pairs in the picture
_SHOWN = 4
# of the histogram: range in standard deviations and number of bins
_REACH, _BINS = 4.0, 65
_LAYERS = {
    "largest": "largest magnitude",
    "near_bound_share": ("share above 0.95", 4),
    "channel_std": "standard deviation",
    "skew": "skew",
    "excess_kurtosis": "excess kurtosis",
    "neighbour_correlation": "correlation of neighbouring frames",
    "slow_share": "power below a quarter of the frame rate",
    "effective_dimension": ("effective dimension", 1),
}
_SHIFTS = {
    "delay_1_frames": "delayed by 1 frame",
    "delay_4_frames": "by 4 frames",
    "half_frame": "by half a frame, against the midpoint",
    "neighbour_frames": "neighbouring frames",
}


def main(argv=None):
    """Writes latents.json, latents.md and latents.png."""
    description = "Statistics of a checkpoint's latents on held-out surfaces."
    return run_study("latents", description, study, markdown, argv)


def study(context):
    """The statistics as leaves: "layers", "time_shift" and "interpolation"; draws latents.png."""
    data, pipe = context.data, context.pipe
    layers, latents = layers_of(pipe.lctg), encode(pipe, data.real, data.rate)
    frame_seconds = pipe.lctg.config.latent_hop / pipe.feature_extractor.sampling_rate
    pairs = _pairs(context)
    progress = tqdm(pairs, desc="blends", disable=context.quiet, leave=False)
    curves = np.stack([_blend(context, first, second) for first, second in progress])
    names = [" → ".join(data.dataset.surfaces[surface] for surface in pair) for pair in pairs[:_SHOWN]]
    standardised = {name: _standardised(latents[:, rows])[0] for name, rows in layers.items()}
    plot_latents(dict(zip(names, curves, strict=False)), standardised, data.edges, context.output / "latents.png")
    return {
        "layers": {
            name: layer_statistics(latents[:, rows], data.surfaces, name in BOUNDED) for name, rows in layers.items()
        },
        "time_shift": time_shift(
            lambda textures: encode(pipe, textures, data.rate),
            data.real,
            data.rate,
            frame_seconds,
            layers,
            surfaces=data.surfaces,
        ),
        "interpolation": monotony(curves),
    }


def layers_of(lctg):
    """Channels of each layer of the latents that a model has: name -> slice."""
    ends = (0, lctg.level_channels, lctg.passed_channels, lctg.base_channels, lctg.config.latent_channels)
    names = ("levels", "envelope", "base", "detail")
    layers = {name: slice(*pair) for name, pair in zip(names, pairwise(ends), strict=True)}
    return {name: rows for name, rows in layers.items() if rows.stop > rows.start}


def layer_statistics(latents, surfaces, bounded=True):
    """Leaves of one layer of the latents.

    Args:
        latents (`np.ndarray`): (n, channels, frames).
        surfaces (`np.ndarray`): (n,) surface of each texture.
        bounded (`bool`): whether they cannot pass 1.

    Returns:
        `dict`: of textures "largest" (|z|) and, if `bounded`, "near_bound_share" (else empty); of channels, all
        textures together (n = channels, the interval is over them) "channel_mean", "channel_std", "skew",
        "excess_kurtosis", "neighbour_correlation" (of frames) and "slow_share" (power below a quarter of the frame
        rate: 0.5 of white noise); and "effective_dimension". A channel that never changes has no shape and is left out.
    """
    latents = np.asarray(latents, dtype=np.float64)
    shape, spread = _standardised(latents)
    size = np.abs(latents)
    spectrum = np.abs(np.fft.rfft(shape * np.hanning(shape.shape[-1]), axis=-1)) ** 2
    slow = np.fft.rfftfreq(shape.shape[-1]) < 0.25
    dimension, interval = jackknife(lambda mask: _participation(latents[mask]), surfaces)
    with np.errstate(invalid="ignore"):  # of channels that never change
        slow_share = spectrum[..., slow].sum((0, 2)) / spectrum.sum((0, 2))
    return {
        "largest": leaf(size.max((1, 2)), surfaces),
        "near_bound_share": leaf((size > NEAR_BOUND).mean((1, 2)), surfaces) if bounded else number(),
        "channel_mean": leaf(latents.mean((0, 2))),
        "channel_std": leaf(spread),
        "skew": leaf((shape**3).mean((0, 2))),
        "excess_kurtosis": leaf((shape**4).mean((0, 2)) - 3),
        "neighbour_correlation": leaf((shape[..., 1:] * shape[..., :-1]).mean((0, 2))),
        "slow_share": leaf(slow_share),
        "effective_dimension": number(dimension, latents.shape[1], interval),
    }


def _standardised(latents):
    """Each channel at zero mean and unit variance, NaN if it never changes, and the standard deviations (channels,)."""
    deviations = latents - latents.mean((0, 2), keepdims=True)
    spread = deviations.std((0, 2))
    return deviations / np.where(spread > 1e-6, spread, np.nan)[:, None], spread


def _participation(latents):
    covariance = np.cov(np.moveaxis(latents, 1, 0).reshape(latents.shape[1], -1)).reshape(latents.shape[1], -1)
    return np.trace(covariance) ** 2 / max(np.sum(covariance**2), 1e-30)


def time_shift(encode, textures, sampling_rate, frame_seconds, layers, surfaces):
    """Whether a delayed texture has delayed latents, in the middle half of it, because the ends differ.

    Args:
        encode (`Callable`): textures (n, samples) -> latents (n, channels, frames).
        textures (`np.ndarray`): (n, samples).
        sampling_rate (`float`): Hz.
        frame_seconds (`float`): duration of a latent frame, s.
        layers (`dict[str, slice]`): channels of each layer.
        surfaces (`np.ndarray`): (n,).

    Returns:
        `dict`: for each layer leaves, all over textures and relative to the latents' deviation from their mean over
        time: "delay_<k>_frames", RMS of the difference after undoing the delay; "neighbour_frames", RMS of the
        difference of neighbouring frames; and "half_frame", after a delay of half a frame, RMS of the difference from
        the midpoint of the two frames around (the root of 1.5 where frames have nothing in common).
    """
    result = {name: {} for name in layers}
    for frames in (*DELAYS, 0.5):
        delay = round(frames * frame_seconds * sampling_rate)
        late, early = encode(textures[:, :-delay]), encode(textures[:, delay:])  # late(t) = early(t - delay)
        edge = late.shape[-1] // 4
        middle, moved = slice(edge, late.shape[-1] - edge), int(np.ceil(frames))
        before = slice(middle.start - moved, middle.stop - moved)
        for name, rows in layers.items():
            made, wanted, following = late[:, rows, middle], early[:, rows, before], early[:, rows, middle]
            if frames == 0.5:
                midpoint = 0.5 * (wanted + following)
                values = {
                    "neighbour_frames": _relative(following, wanted),
                    "half_frame": _relative(made, midpoint, wanted),
                }
            else:
                values = {f"delay_{frames}_frames": _relative(made, wanted)}
            result[name] |= {key: leaf(value, surfaces) for key, value in values.items()}
    return result


def _relative(made, wanted, varying=None):
    """RMS of the difference over that of the deviation of `varying`, `wanted` by default, from its mean over time."""
    varying = wanted if varying is None else varying
    deviation = varying - varying.mean(-1, keepdims=True)
    return rms(_rows(made - wanted)) / np.maximum(rms(_rows(deviation)), 1e-12)


def _rows(values):
    return values.reshape(len(values), -1)


def _pairs(context):
    """Pairs of held-out surfaces, drawn at random without repetition."""
    possible = list(combinations(np.unique(context.data.surfaces).tolist(), 2))
    chosen = context.rng("blends").permutation(len(possible))[:PAIRS]
    return [possible[index] for index in chosen]


def _blend(context, first, second):
    """Nine band levels from one surface to another, dB: (weights, bands).

    What DALE generates (the latents but for the detail layer, which belongs to one waveform, and the level) is blended
    linearly between a segment of either and decoded from the same noise. Means are over pairs of segments.
    """
    pipe, rows = context.pipe, [np.flatnonzero(context.data.surfaces == surface) for surface in (first, second)]
    count = min(map(len, rows))
    ends = [pipe.encode(context.data.real[own[:count]], context.data.rate) for own in rows]
    weights = torch.as_tensor(BLEND_WEIGHTS, dtype=torch.float32, device=ends[0].latents.device)
    latents, level = (
        torch.lerp(a.float(), b.float(), weights.view(-1, *[1] * a.ndim)).flatten(0, 1)
        for a, b in ((ends[0].latents, ends[1].latents), (ends[0].level, ends[1].level))
    )
    latents = pipe.lctg.pad_detail(latents[:, : pipe.lctg.base_channels])
    seeds = np.tile(noise_seeds([context.seed, first, second], count), len(weights))
    generators = [torch.Generator("cpu").manual_seed(int(seed)) for seed in seeds]
    out = pipe.decode(latents, level, None, context.steps, generators)
    bands = band_levels_db(out.textures, out.sampling_rate, context.data.edges)
    return bands.reshape(len(weights), count, -1).mean(1)


def monotony(curves):
    """Whether band levels go one way while one surface becomes another.

    Args:
        curves (`np.ndarray`): (pairs, weights, bands), dB.

    Returns:
        `dict`: leaves over the (pair, band) curves whose ends differ by more than 3 dB: "monotone_share", which share
        never goes back by more than 0.5 dB; "reversal_db", the largest way back; "departure_db", the largest
        difference from the straight line between the ends.
    """
    start, end = curves[:, :1], curves[:, -1:]
    rising = (curves - start) * np.sign(end - start)
    reversal = (np.maximum.accumulate(rising, axis=1) - rising).max(1)
    straight = start + np.linspace(0, 1, curves.shape[1])[:, None] * (end - start)
    departure = np.abs(curves - straight).max(1)
    counted = np.abs(end - start)[:, 0] > DIFFERENT_DB
    pairs = np.broadcast_to(np.arange(len(curves))[:, None], counted.shape)[counted]
    return {
        "monotone_share": leaf(reversal[counted] <= TOLERANCE_DB, pairs),
        "reversal_db": leaf(reversal[counted], pairs),
        "departure_db": leaf(departure[counted], pairs),
    }


def markdown(section):
    """The statistics as tables."""
    blend = section["interpolation"]
    counted = blend["monotone_share"]["n"] or 0
    words = (
        f"Blends of two held-out surfaces: {counted} band levels differ by more than 3 dB between the two, "
        f"{shown(100 * (blend['monotone_share']['mean'] or 0), 0)} % of them change one way only (within 0.5 dB); "
        f"largest way back {shown(blend['reversal_db']['max'])} dB, largest difference from a straight line "
        f"{shown(blend['departure_db']['max'])} dB (mean {shown(blend['departure_db']['mean'])})."
    )
    shift = "Difference of the latents of a delayed texture, relative to their variation over time:"
    layers = markdown_table({f"{name} layer": entry for name, entry in section["layers"].items()}, labels=_LAYERS)
    shifts = markdown_table(
        {f"{name} layer": entry for name, entry in section["time_shift"].items()}, digits=3, labels=_SHIFTS
    )
    return "\n\n".join(["# Latents", layers, shift, shifts, words, "![latents](latents.png)"])


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
    panel.legend(fontsize=7)


if __name__ == "__main__":
    sys.exit(main())

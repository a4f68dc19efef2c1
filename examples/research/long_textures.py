"""`python long_textures.py`: is a texture that is longer than a segment even, and does it repeat?"""

import sys
from pathlib import Path

import numpy as np
import torch
from scipy.signal import fftconvolve

from tactile_diffusers.cli.program import Parser, add_checkpoint_argument, add_seed_argument, count, load_pipeline
from tactile_diffusers.pipelines.velocities import Windows
from tactile_diffusers.signal import band_edges, band_levels_db

sys.path.append(str(Path(__file__).parents[1]))  # examples, for `report`

from report.tables import markdown_table


def main(argv=None):
    """Prints the figures as a Markdown table."""
    parser = Parser(prog="long_textures.py", description="Is a texture longer than a segment even, and does it repeat?")
    add_checkpoint_argument(parser)
    parser.add_argument("--textures", type=count, default=4, help="number of textures; default: 4")
    parser.add_argument("--duration_s", type=float, default=30.0, help="of each, s; default: 30")
    add_seed_argument(parser)
    arguments = parser.parse_args(argv)
    pipe, ratings = load_pipeline(arguments.checkpoint), [[None] * 3] * arguments.textures
    found = long_texture_study(pipe, ratings, arguments.duration_s, arguments.seed)
    found["overlap_bands_db"] = ", ".join(f"{value:.2f}" for value in found["overlap_bands_db"])
    labels = {
        "overlap_rms_db": "level where windows overlap against elsewhere, dB",
        "overlap_bands_db": "the same in the upper seven bands, dB",
        "largest_correlation": "largest correlation with itself a second or more away",
    }
    print(markdown_table({f"{arguments.textures} x {arguments.duration_s:g} s": found}, labels=labels))
    return 0


def long_texture_study(pipe, ratings, duration_s=30.0, seed=0):
    """Levels where windows overlap, and repetition, in long textures.

    Args:
        pipe (`TactileTexturePipeline`): with a DALE.
        ratings: any form that the pipeline takes; figures are means over the textures.
        duration_s (`float`): seconds.
        seed (`int`): of the noise.

    Returns:
        `dict`: "overlap_rms_db" and "overlap_bands_db" (the upper seven of the nine bands): level where generated
        windows overlap over level elsewhere; "largest_correlation": see `largest_correlation`.
    """
    generator = torch.Generator("cpu").manual_seed(seed)
    out = pipe(ratings, duration_s=duration_s, generator=generator)
    rate = out.sampling_rate
    # frames of 0.1 s that lie wholly inside or wholly outside the overlaps; they resolve all but the two lowest bands
    frame = int(0.1 * rate)
    count = out.textures.shape[-1] // frame
    share = overlap_mask(pipe, out.textures.shape[-1], rate)[: count * frame].reshape(count, frame).mean(1)
    frames = out.textures[:, : count * frame].reshape(len(out.textures), count, frame)
    power = 10 ** (band_levels_db(frames, rate, band_edges()[2:]) / 10)

    def ratio_db(values):
        return 10 * np.log10(values[:, share == 1].mean(1) / values[:, share == 0].mean(1)).mean(0)

    correlations = [largest_correlation(texture, rate) for texture in out.textures]
    return {
        "overlap_rms_db": float(ratio_db(np.square(frames.astype(np.float64)).mean(-1))),
        "overlap_bands_db": [round(float(value), 3) for value in ratio_db(power)],
        "largest_correlation": float(max(correlations)),
    }


def overlap_mask(pipe, samples, sampling_rate):
    """Which samples of a long texture come from more than one window: (samples,) bool."""
    seconds = pipe.lctg.config.latent_hop / pipe.feature_extractor.sampling_rate
    size = pipe.dale.config.latent_frames
    frames = max(size, int(np.ceil(samples / sampling_rate / seconds)))
    covered = np.zeros(frames, dtype=np.int64)
    for start in Windows(frames, size).starts:
        covered[start : start + size] += 1
    positions = np.minimum((np.arange(samples) / sampling_rate / seconds).astype(np.int64), frames - 1)
    return covered[positions] > 1


def largest_correlation(texture, sampling_rate):
    """Largest normalised correlation of any whole second with a place at least a second away; a repeat gives 1."""
    texture = np.asarray(texture, dtype=np.float64)
    second, largest = int(sampling_rate), 0.0
    energy = np.convolve(np.square(texture), np.ones(second), mode="valid")
    for start in range(0, len(texture) - second + 1, second):
        piece = texture[start : start + second]
        correlation = fftconvolve(texture, piece[::-1], mode="valid") / np.sqrt(energy * np.sum(piece**2) + 1e-30)
        correlation[max(0, start - second) : start + second] = 0.0
        largest = max(largest, float(np.abs(correlation).max()))
    return largest


if __name__ == "__main__":
    sys.exit(main())

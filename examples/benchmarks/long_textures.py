"""Is a texture that is longer than a segment even, and does it repeat? `python examples/benchmarks/long_textures.py`"""

import sys
from pathlib import Path

import numpy as np
import torch
from benchmarking import finish, make_parser, parse
from scipy.signal import fftconvolve

from tactile_diffusers.cli.program import load_pipeline
from tactile_diffusers.io.argument_types import count, positive_number
from tactile_diffusers.pipelines.velocities import Windows
from tactile_diffusers.signal import band_edges, band_levels_db

sys.path.append(str(Path(__file__).parents[1]))  # examples, for `report`

from report.tables import markdown_table, title

#: Frames in which levels are compared, s: they lie inside an overlap or outside, and resolve the upper seven bands.
FRAME_S = 0.1
LABELS = {
    "overlap_db": "level where windows overlap over the level elsewhere, dB",
    "overlap_band_db": "the same of one of the upper seven bands, the largest, dB",
    "itself": "largest correlation of a second with another place of its texture",
    "another": "the same with another texture: chance",
}


def main(argv=None):
    """Runs the command."""
    parser = make_parser("long_textures.py", "Is a texture longer than a segment even, and does it repeat?")
    parser.add_argument("--textures", type=count, default=8, help="number of textures; default: 8")
    parser.add_argument("--duration_s", type=positive_number, default=30.0, help="of each, s; default: 30")
    arguments = parse(parser, argv)
    pipe = load_pipeline(arguments.checkpoint)
    pipe.set_progress_bar_config(disable=arguments.quiet)
    found = evenness(pipe, arguments.textures, arguments.duration_s, arguments.seed)
    heading = title(f"{arguments.textures} textures of {arguments.duration_s:g} s, ratings open", 1)
    rows = {label: {"value": found[name]} for name, label in LABELS.items()}
    return finish(arguments, "long_textures", found, f"{heading}{markdown_table(rows, 3)}\n")


def evenness(pipe, textures, duration_s, seed):
    """Levels where windows overlap, and repetition, in long textures of open ratings; a dict, see `LABELS`."""
    ratings = [[None] * len(pipe.dale.config.rating_axes)] * textures
    out = pipe(ratings, duration_s=duration_s, generator=torch.Generator("cpu").manual_seed(seed))
    made, rate = out.textures, out.sampling_rate
    frame = int(FRAME_S * rate)
    frames = made.shape[-1] // frame
    share = overlap_mask(pipe, made.shape[-1], rate)[: frames * frame].reshape(frames, frame).mean(1)
    pieces = made[:, : frames * frame].reshape(textures, frames, frame)
    power = 10 ** (band_levels_db(pieces, rate, band_edges()[2:]) / 10)

    def ratio_db(values):
        return 10 * np.log10(values[:, share == 1].mean(1) / values[:, share == 0].mean(1)).mean(0)

    return {
        "overlap_db": float(ratio_db(np.square(pieces.astype(np.float64)).mean(-1))),
        "overlap_band_db": float(max(ratio_db(power), key=abs)),
        "itself": max(largest_correlation(texture, texture, rate) for texture in made),
        "another": max(largest_correlation(*pair, rate) for pair in zip(made, np.roll(made, 1, 0), strict=True)),
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


def largest_correlation(texture, other, sampling_rate):
    """Largest normalised correlation of any whole second with a place of another texture a second or more away."""
    texture, other = np.asarray(texture, dtype=np.float64), np.asarray(other, dtype=np.float64)
    second, largest = int(sampling_rate), 0.0
    energy = np.convolve(np.square(other), np.ones(second), mode="valid")
    for start in range(0, len(texture) - second + 1, second):
        piece = texture[start : start + second]
        correlation = fftconvolve(other, piece[::-1], mode="valid") / np.sqrt(energy * np.sum(piece**2) + 1e-30)
        correlation[max(0, start - second) : start + second] = 0.0
        largest = max(largest, float(np.abs(correlation).max()))
    return largest


if __name__ == "__main__":
    sys.exit(main())

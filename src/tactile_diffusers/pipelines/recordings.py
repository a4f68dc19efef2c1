"""Checks of recordings that are to be edited, and of the ratings that an edit asks for."""

import numpy as np
import torch

from ..signal import rms
from .inputs import LARGEST_RATING, parse_ratings

#: Share of a recording's power that may lie outside of the band.
LARGEST_SHARE_OUTSIDE = 0.5
#: Standard deviations of the training textures' level beyond which a recording is no force of a fingertip.
LARGEST_DEVIATION = 6.0
#: The scale of ratings that are added to those of the recording.
DIFFERENCE = "difference"


def check_recording(texture, sampling_rate, extractor, config):
    """Refuses textures (n, samples), N, that DALE, of this config, cannot know: of another band, or another level.

    Raises:
        ValueError: naming the row, what is wrong with it and the remedy.
    """
    spectrum = np.abs(np.fft.rfft(texture - texture.mean(-1, keepdims=True), axis=-1)) ** 2
    frequencies, (low, high) = np.fft.rfftfreq(texture.shape[-1], 1 / sampling_rate), extractor.band
    outside = spectrum[:, (frequencies < low) | (frequencies > high)].sum(-1)
    reach = np.exp(LARGEST_DEVIATION * config.level_std) if config.level_std else np.inf
    least, most = np.exp(config.level_mean) / reach, np.exp(config.level_mean) * reach
    for row, (level, share) in enumerate(
        zip(rms(texture), outside / np.maximum(spectrum.sum(-1), 1e-300), strict=True)
    ):
        if share > LARGEST_SHARE_OUTSIDE:
            raise ValueError(
                f"`texture` has {100 * share:.0f} % of its power outside of {low:g}-{high:g} Hz (row {row}). Band-pass "
                "it first: `tactile_diffusers.signal.band_pass(texture, sampling_rate)`."
            )
        if not least <= level <= most:
            kind = "quiet" if level < least else "loud"
            raise ValueError(
                f"`texture` is too {kind} for a fingertip: an RMS of {level:.3g} N in row {row}, textures have "
                f"{least:.2g} to {most:.2g} N. Calibrate it to newtons, or leave this recording out."
            )


def target_ratings(ratings, rating_scale, source, config):
    """Ratings to edit towards: (n, axes) z-scores.

    Args:
        ratings: in any form that the pipeline takes, for one texture or each; what is not specified stays.
        rating_scale (`str`): a scale of the pipeline, or "difference": z-scores, added to the source's.
        source (`torch.Tensor`): (n, axes), NaN = unknown.
        config: DALE's.

    Raises:
        ValueError: if they are not ratings, of another number of textures, or differ from a rating that is unknown.
    """
    relative = rating_scale == DIFFERENCE
    asked = parse_ratings(ratings, config, "z" if relative else rating_scale)
    if len(asked) not in (1, len(source)):
        raise ValueError(f"`ratings` must be those of one texture or of {len(source)}, got {len(asked)}.")
    asked = asked.expand(len(source), -1)
    if not relative:
        return torch.where(asked.isnan(), source, asked)
    if (unknown := source.isnan() & (asked.nan_to_num() != 0)).any():
        names = [name for name, found in zip(config.rating_axes, unknown.any(0), strict=True) if found]
        raise ValueError(
            f'`ratings` with `rating_scale="difference"` need the recording\'s own rating of {", ".join(names)}: give '
            "`source_ratings`."
        )
    return (source + asked.nan_to_num()).clamp(-LARGEST_RATING, LARGEST_RATING)

"""Stretches of a recording that are missing: a first guess, which to fill, and how what is drawn joins its neighbours.

What fills a gap is a take that knows the gap's surroundings as latents alone, so that it meets them at the right level,
but not in phase. It is joined by conditional simulation (Journel and Huijbregts 1978, Mining Geostatistics, section
VII.A.2): what the take misses of the known samples is continued into the gap as their own autocorrelation has it. Of
Gaussian textures the result is distributed as if the gap had been recorded, so nothing fades and no seam is left.
"""

import numpy as np

from ..signal.checks import check_number
from ..signal.masks import mask_of_runs, true_runs

#: What is known must last so long, s: five periods of the lowest frequency.
LEAST_SECONDS = 0.25
#: How far known samples reach into a gap, s, the period of the lowest frequency; and in samples, which bounds the work.
REACH_SECONDS, MOST_REACH = 0.05, 600
#: White noise under the autocorrelation, as a share of its power: what a filter leaves empty is not continued.
NUGGET = 1e-5
#: What a loop makes anew on either side of its seam, s; of a short texture, at most this share of it.
SEAM_SECONDS, LARGEST_SEAM = 0.1, 0.125
#: Longest texture, s, of `continue_s` and what it continues.
LONGEST_SECONDS = 3600.0


def parse_mask(mask, samples, sampling_rate):
    """Masked samples as bool (samples,).

    Args:
        mask: `None`, bool (samples,), or pairs of start and stop in s, `[(0.8, 0.9), ...]`, or one such pair.

    Raises:
        ValueError: if it is none of these, or lies beyond the texture.
    """
    if mask is None:
        return np.zeros(samples, dtype=bool)
    found = np.asarray(mask)
    if found.dtype == bool:
        if found.shape != (samples,):
            raise ValueError(f"`mask` must have one bool for each of the {samples} samples, got {found.shape}.")
        return found.copy()
    if found.dtype.kind not in "iuf" or found.shape[-1:] != (2,) or found.ndim > 2:
        raise ValueError(f"`mask` must be bool (samples,) or pairs of start and stop in seconds, got {mask!r}.")
    seconds = samples / sampling_rate
    for start, stop in found.reshape(-1, 2):
        if not 0 <= start < stop <= seconds + 0.5 / sampling_rate:  # NaN fails, too
            raise ValueError(f"`mask` must lie within the texture, 0 <= start < stop <= {seconds:g} s, got {mask!r}.")
    return mask_of_runs(np.rint(found.reshape(-1, 2) * sampling_rate).astype(int), samples)


def lay_out(texture, sampling_rate, mask, continue_s, loop):
    """A texture (samples,) as it is to be filled.

    Returns:
        `tuple[np.ndarray, np.ndarray, int]`: the samples, of which those to be filled hold anything, those (bool), and
        by how many samples they are to be rolled back afterwards.

    Raises:
        ValueError: if less than `LEAST_SECONDS` are known, or the result is longer than an hour.
    """
    missing = parse_mask(mask, len(texture), sampling_rate)
    if continue_s is not None:
        continue_s = check_number("continue_s", continue_s, "seconds", above=0, at_most=LONGEST_SECONDS)
        more = max(1, round(continue_s * sampling_rate))
        texture, missing = np.pad(texture, (0, more)), np.pad(missing, (0, more), constant_values=True)
        if len(texture) > LONGEST_SECONDS * sampling_rate:
            raise ValueError(f"`continue_s` ({continue_s:g}) makes a texture of more than {LONGEST_SECONDS:g} s.")
    shift = 0
    if loop:
        half = max(1, int(min(SEAM_SECONDS * sampling_rate, LARGEST_SEAM * len(texture))))
        if continue_s is None:
            missing[:half] = missing[-half:] = True
        # the seam lies inside, the cut between two samples that are known
        known = true_runs(~missing)
        start, stop = known[np.argmax(known[:, 1] - known[:, 0])] if len(known) else (0, 0)
        shift = (start + stop) // 2
        texture, missing = np.roll(texture, -shift), np.roll(missing, -shift)
    if np.count_nonzero(~missing) < LEAST_SECONDS * sampling_rate:
        name = "continue_s" if mask is None else "mask"
        raise ValueError(
            f"`{name}` leaves {np.count_nonzero(~missing) / sampling_rate:.3g} s of the texture as they are, at least "
            f"{LEAST_SECONDS} s are needed to go on from."
        )
    return texture, missing, shift


def guessed(texture, missing):
    """A texture (samples,) in which its own neighbourhood, mirrored from both ends and faded, stands for each gap."""
    guess, known = np.where(missing, 0.0, texture), true_runs(~missing)
    for start, stop in true_runs(missing):
        before = [texture[a:b][::-1] for a, b in known if b == start]
        after = [texture[a:b] for a, b in known if a == stop]
        sides = [_mirrored(side[0], stop - start) for side in (before, after) if side]
        if not before:
            sides = [sides[0][::-1]]
        elif after:
            share = (np.arange(stop - start) + 0.5) / (stop - start) * np.pi / 2
            sides = [np.cos(share) * sides[0], np.sin(share) * sides[1][::-1]]
        guess[start:stop] = sum(sides)
    return guess


def _mirrored(away, count):
    """Samples that go on from an edge: those on its other side, `away` from it, then back again: (count,)."""
    place = np.arange(count) % (2 * len(away))
    return away[np.minimum(place, 2 * len(away) - 1 - place)]


def share_drawn(missing, frames, ramp):
    """How much of each latent frame is drawn anew: 0 where all is known, rising over `ramp` frames to 1: (frames,)."""
    edges = np.linspace(0, len(missing), frames + 1).astype(int)
    known = np.flatnonzero([not missing[a:b].all() for a, b in zip(edges[:-1], edges[1:], strict=True)])
    distance = np.abs(np.arange(frames)[:, None] - known).min(1)
    return np.minimum(distance / ramp, 1.0)


def joined(texture, drawn, missing, guess, sampling_rate):
    """The texture (samples,), of which the gaps hold what is drawn, conditioned on the known samples around them."""
    reach = min(round(REACH_SECONDS * sampling_rate), MOST_REACH)
    spectrum = np.abs(np.fft.rfft(guess, 2 * len(guess))) ** 2
    covariance = np.fft.irfft(spectrum)[:reach] * (1 - np.arange(reach) / reach)  # both stay positive definite
    covariance = np.pad(covariance / max(covariance[0], 1e-300), (0, 1))
    result, missing = np.where(missing, drawn, texture), missing.copy()
    for start, stop in true_runs(missing):  # one gap after the other: one that is filled is known to the next
        places = np.arange(max(0, start - reach), min(len(texture), stop + reach))
        known, inside = places[~missing[places]], (places >= start) & (places < stop)
        unknown = places[inside & ((places < start + reach) | (places >= stop - reach))]

        def between(a, b):
            return covariance[np.minimum(np.abs(a[:, None] - b), reach)]

        weights = np.linalg.solve(between(known, known) + NUGGET * np.eye(len(known)), (result - drawn)[known])
        result[unknown] += between(unknown, known) @ weights
        missing[start:stop] = False
    return result

"""What DALE's diffusion sees of LCTG's base layer: numbers of the whole texture, and shapes of a normal distribution.

How much a texture varies differs far more between textures than how it varies. So the size is kept apart from the
shape, as vector quantisers of speech keep gain and shape apart: the sizes are numbers that ratings can move. Of the
fast envelope they are its quantiles, because a texture with a few catches and one with many small bumps may vary as
much; and the powers of its modulation, because what varies may be slow or fast. What is left of it to diffuse is the
order of its values in time, made white.
"""

import math

import torch

#: Least RMS of the departures, and least gap between quantiles of the envelope: a steady texture has no shape.
LEAST_SPREAD, LEAST_GAP = 0.02, 0.002
#: Least power of a band of modulation frequency.
LEAST_POWER = 1e-3
#: Where the quantiles of the envelope are taken, as standard normal values; closer on the side of events. The highest
#: is as rare as one value of a segment.
KNOTS = (-2.4, -1.2, 0.0, 0.8, 1.6, 2.1, 2.6)
#: How many numbers they become: the median and the log gaps between them.
QUANTILES = len(KNOTS)
#: Between bands of modulation frequency, as shares of the highest: 2, 4, 8, 13, 20, 29, 39 and 55 Hz of the bundled
#: checkpoint.
MODULATION_EDGES = (0.025, 0.05, 0.1, 0.165, 0.25, 0.375, 0.5, 0.7)
MODULATIONS = len(MODULATION_EDGES) + 1


def cosines(count, like):
    """Orthonormal DCT-II, (count, count): band levels (count, ...) to their cepstrum, which is hardly correlated."""
    places = torch.arange(count, device=like.device, dtype=torch.float32)
    matrix = torch.cos(math.pi / max(count, 1) * places[:, None] * (places + 0.5)) * (2 / max(count, 1)) ** 0.5
    matrix[:1] *= 0.5**0.5
    return matrix.to(like)


def cepstra(levels, patch_size):
    """Cepstrum of band levels (batch, bands, frames): its mean over the texture, and how patches depart from it.

    Returns:
        `tuple[torch.Tensor, torch.Tensor]`: (batch, bands) and (batch, bands, patches).
    """
    values = cosines(levels.shape[1], levels) @ levels
    means = values.mean(-1)
    return means, (values - means[..., None]).unflatten(-1, (-1, patch_size)).mean(-1)


def standardized(values, mean, std):
    """Values at unit variance; 0 where the standard deviation is 0."""
    return torch.zeros_like(values) if std == 0 else (values - mean) / std


def unit_shape(values):
    """What varies over a texture (batch, channels, n) as shape, of RMS 1, and log RMS (batch, 0 or 1)."""
    if not values.numel():
        return values, values.new_zeros(len(values), 0)
    spread = values.square().mean((1, 2), keepdim=True).sqrt().clamp_min(LEAST_SPREAD)
    return values / spread, spread[..., 0].log()


def normal_scores(values):
    """Values (batch, channels, n) by their rank over the texture: the standard normal value of that rank."""
    flat = values.flatten(1).float()
    ranks = flat.argsort(dim=1).argsort(dim=1)
    return (math.sqrt(2) * torch.erfinv((2 * ranks + 1) / flat.shape[1] - 1)).view_as(values).to(values)


def quantile_numbers(values):
    """Median of values (batch, channels, n), and log gaps between their quantiles at `KNOTS`: (batch, QUANTILES)."""
    if not values.numel():
        return values.new_zeros(len(values), 0)
    knots = torch.tensor(KNOTS, device=values.device)
    quantiles = values.flatten(1).float().quantile(0.5 * (1 + torch.erf(knots / math.sqrt(2))), dim=1).T
    gaps = quantiles.diff(dim=1).clamp_min(LEAST_GAP).log()
    return torch.cat([quantiles[:, KNOTS.index(0.0), None], gaps], dim=1).to(values)


def with_quantiles(values, numbers):
    """Values (batch, channels, n) in their own order, with the quantiles of the numbers (batch, QUANTILES)."""
    return from_scores(normal_scores(values), numbers) if values.numel() else values


def from_scores(scores, numbers):
    """Values of normal scores (batch, channels, n) by the numbers of their quantiles (batch, QUANTILES).

    Straight between the quantiles; beyond the outermost, as between the last two.
    """
    gaps = numbers[:, 1:].exp()
    found = numbers[:, 0] - gaps[:, : KNOTS.index(0.0)].sum(1)
    found = found[:, None, None].expand_as(scores)
    for k, (low, high) in enumerate(zip(KNOTS[:-1], KNOTS[1:], strict=True)):
        inside = scores.clamp(None if k == 0 else low, None if k == len(KNOTS) - 2 else high) - low
        found = found + gaps[:, k, None, None] / (high - low) * inside
    return found


def modulation_numbers(scores):
    """Log power of scores (batch, channels, frames) in bands of modulation frequency: (batch, MODULATIONS)."""
    if not scores.numel():
        return scores.new_zeros(len(scores), 0)
    return _band_powers(_spectrum(scores)).log().to(scores)


def whitened(scores):
    """Scores (batch, channels, frames) at equal power in all bands of modulation frequency."""
    return coloured(scores, scores.new_zeros(len(scores), MODULATIONS))


def coloured(values, numbers):
    """Values (batch, channels, frames) of which the modulation has the log powers (batch, MODULATIONS)."""
    if not values.numel():
        return values
    channels, frames = values.shape[1:]
    spectrum = _spectrum(values)
    gains = (0.5 * numbers.float()).exp() * _band_powers(spectrum).rsqrt()
    gains = gains[:, _band_of_bins(spectrum)]
    spectrum = torch.cat([spectrum[:, :1], spectrum[:, 1:] * gains], dim=1)
    series = torch.fft.irfft(spectrum, channels * frames, norm="ortho")
    return series.unflatten(1, (frames, channels)).transpose(1, 2).to(values)


def _spectrum(values):
    """Spectrum of the series that the channels of one frame after the other make: (batch, bins)."""
    return torch.fft.rfft(values.transpose(1, 2).flatten(1).float(), norm="ortho")


def _band_of_bins(spectrum):
    """Band of each bin but the first, the mean: (bins - 1,)."""
    bins = spectrum.shape[1] - 1
    shares = torch.arange(1, bins + 1, device=spectrum.device) / max(bins, 1)
    return torch.bucketize(shares, torch.tensor(MODULATION_EDGES, device=spectrum.device))


def _band_powers(spectrum):
    """Mean power of the bins in each band, (batch, MODULATIONS); a short series has none in some."""
    band, power = _band_of_bins(spectrum), spectrum[:, 1:].abs().square()
    sums = power.new_zeros(len(power), MODULATIONS).index_add_(1, band, power)
    return (sums / torch.bincount(band, minlength=MODULATIONS).clamp_min(1)).clamp_min(LEAST_POWER)


def latent_statistics(latents, level_channels=0, envelope_channels=0, patch_size=1):
    """What `DALEModel`'s config keeps of the training set's latents.

    Args:
        latents (`torch.Tensor`): (n, latent_channels, frames), base layers of `LCTGModel.encode`.
        level_channels, envelope_channels, patch_size (`int`): of the model.

    Returns:
        `dict[str, list[float]]`: its `latent_mean`, `latent_std`, `departure_std`, `size_mean` and `size_std`.
    """
    levels, envelope, learned = latents.tensor_split([level_channels, level_channels + envelope_channels], dim=1)
    means, departures = cepstra(levels, patch_size)

    def deviation(values, dims):
        return values.std(dims, correction=0).clamp_min(1e-3) if values.numel() else values.new_zeros(0)

    departure_std = deviation(departures, (0, 2))
    sizes = [unit_shape(departures / departure_std[:, None])[1], quantile_numbers(envelope)]
    sizes = torch.cat([*sizes, modulation_numbers(normal_scores(envelope))], dim=1)
    found = {
        "latent_mean": torch.cat([means.mean(0), learned.mean((0, 2))]),
        "latent_std": torch.cat([deviation(means, 0), deviation(learned, (0, 2))]),
        "departure_std": departure_std,
        "size_mean": sizes.mean(0),
        "size_std": deviation(sizes, 0),
    }
    return {name: values.tolist() for name, values in found.items()}


def log_friction_statistics(config):
    """Mean and standard deviation; NaN where no friction coefficient was known in training."""
    mean, std = config.log_friction_mean, config.log_friction_std
    return (math.nan, math.nan) if mean is None or std is None else (mean, std)

"""Studies of a checkpoint on held-out surfaces: reconstruction, one rating swept, long textures."""

import numpy as np
import torch
from scipy.signal import fftconvolve
from scipy.stats import spearmanr

from ..pipelines.windows import Windows
from ..signal import BAND_HZ, band_edges, band_levels_db, nine_band_error_db, power_spectral_density, resample, rms
from .distances import frechet_tactile_distance, kernel_tactile_distance
from .embedding import TactileEmbedding
from .reconstruction import signed_band_error_db, snr_db

#: bands of the signed error, Hz: where lows fade and where noise appears (paper section 4)
SIGNED_BANDS_HZ = ((20, 60), (60, 150), (150, 400), (400, 650), (650, 1000))

#: band whose share of the power a sweep reports, Hz
SHARE_BAND_HZ = (150.0, 400.0)
#: ratings of a sweep, z-scores (paper section 3.4)
SWEEP_VALUES = (-2.0, -1.5, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5, 2.0)


def other_segments(dataset, indices, same_surface, seed=0):
    """For each segment another one that shares no sample with it: of the same surface, or of a different one.

    Returns:
        `np.ndarray`: (n,) indices, -1 where there is none.
    """
    rng = np.random.default_rng(seed)
    candidates = dataset.non_overlapping(len(dataset), seed)
    others = np.full(len(indices), -1)
    for row, index in enumerate(indices):
        same = dataset.surface_ids[candidates] == dataset.surface_ids[index]
        pool = candidates[same if same_surface else ~same]
        pool = pool[[not dataset.overlap(int(index), int(other)) for other in pool]] if same_surface else pool
        if len(pool):
            others[row] = rng.choice(pool)
    return others


def reconstruct(pipe, textures, sampling_rate, num_inference_steps, seed=0, batch_size=32, quiet=True):
    """Reconstructions at the textures' own rate and length: (n, samples) float64."""
    from tqdm.auto import tqdm

    made = []
    for start in tqdm(range(0, len(textures), batch_size), disable=quiet, desc=f"{num_inference_steps} steps"):
        rows = textures[start : start + batch_size]
        generator = torch.Generator("cpu").manual_seed(seed + start)
        out = pipe.reconstruct(rows, sampling_rate, num_inference_steps, generator=generator)
        made.append(resample(out.textures, out.sampling_rate, sampling_rate)[:, : rows.shape[-1]])
    return np.concatenate(made)


def reconstruction_study(pipe, held_out, reference, steps=(10,), per_surface=4, seed=0, quiet=True):
    """Reconstructions of held-out surfaces beside what costs nothing.

    Args:
        pipe (`TactileTexturePipeline`): any checkpoint with an LCTG.
        held_out, reference (`PreparedDataset`): at their native rate; the embedding is fitted on `reference` (training
            surfaces), everything is judged on `held_out`.
        steps (`tuple[int, ...]`): numbers of LCTG steps.
        per_surface (`int`): non-overlapping segments per surface.
        seed (`int`): of segments and noise.
        quiet (`bool`): no progress bar.

    Returns:
        `dict[str, dict[str, float]]`: row name -> metric -> value. SNR is left out where the unit is not newtons,
        because the sign of such recordings need not be measured. FTD is NaN for sets too small for a covariance.
    """
    rate, edges = held_out.sampling_rate, band_edges(9, held_out.band)
    chosen = held_out.non_overlapping(per_surface, seed)
    pair = other_segments(held_out, chosen, True, seed)
    chosen, pair = chosen[pair >= 0], pair[pair >= 0]
    different = other_segments(held_out, chosen, False, seed)
    real = held_out.textures(chosen)
    _, embedding, train_points = _reference_points(reference, rate, per_surface, seed)

    rows = {
        "silence": np.zeros_like(real),
        "another take of the surface": held_out.textures(pair),
        "a different surface": held_out.textures(different),
    }
    for count in steps:
        rows[f"LCTG, {count} steps"] = reconstruct(pipe, real, rate, count, seed, quiet=quiet)

    table = {"real (held out)": _set_metrics(embedding(real, rate), train_points, embedding.width)}
    for name, textures in rows.items():
        silent = name == "silence"
        entry = {} if silent else {"nine_band_db": float(nine_band_error_db(textures, real, rate, edges).mean())}
        if held_out.unit == "N":
            entry["snr_db"] = float(snr_db(textures, real).mean())
        if not silent:
            bands = [(max(low, edges[0]), high) for low, high in SIGNED_BANDS_HZ]
            signed = signed_band_error_db(textures, real, rate, bands).mean(0)
            entry |= {f"signed_{b[0]}_{b[1]}_db": float(v) for b, v in zip(SIGNED_BANDS_HZ, signed, strict=True)}
            entry |= _set_metrics(embedding(textures, rate), train_points, embedding.width)
        table[name] = entry
    table["real (held out)"]["segments"] = len(real)
    if held_out.unit == "N":
        table["real (held out)"]["rms_mn"] = float(1e3 * rms(real).mean())
    return table


def _reference_points(reference, rate, per_surface, seed):
    """Training textures, the embedding fitted on them, and them embedded: what distances refer to."""
    train = reference.textures(reference.non_overlapping(per_surface, seed))
    embedding = TactileEmbedding.fit(train, rate)
    return train, embedding, embedding(train, rate)


def _set_metrics(points, reference, width):
    enough = min(len(points), len(reference)) > points.shape[1]
    return {
        "ktd": float(kernel_tactile_distance(points, reference, width)),
        "ftd": float(frechet_tactile_distance(points, reference)) if enough else float("nan"),
    }


def generation_study(pipe, held_out, reference, takes=8, steps=10, guidance_scale=1.0, seed=0, quiet=True):
    """Textures generated from the ratings of held-out surfaces, beside those surfaces' own textures.

    Args:
        pipe (`TactileTexturePipeline`): with a DALE.
        held_out, reference (`PreparedDataset`): at their native rate, which must be the pipeline's delivery rate;
            `reference` holds the training surfaces.
        takes (`int`): textures per surface, and real ones at most.
        steps (`int`): of both stages.
        guidance_scale (`float`): 1.0 = off.
        seed (`int`): of segments and noise.
        quiet (`bool`): no progress bar.

    Returns:
        `dict[str, dict[str, float]]`: row -> "ktd", "ftd" against the training surfaces; "surface_nine_band_db", error
        of each surface's mean spectrum (averaged in dB); "level_r" and "log_friction_r", correlation over surfaces of
        generated and real means.
    """
    from tqdm.auto import tqdm

    rate, edges = held_out.sampling_rate, band_edges(9, held_out.band)
    train, embedding, train_points = _reference_points(reference, rate, 4, seed)
    train_bands = band_levels_db(train, rate, edges).mean(0)
    chosen = held_out.non_overlapping(takes, seed)
    surfaces = np.unique(held_out.surface_ids[chosen])
    real_sets, made_sets, means = [], [], []
    for surface in tqdm(surfaces, disable=quiet, desc="unseen surfaces"):
        rows = chosen[held_out.surface_ids[chosen] == surface]
        real = held_out.textures(rows)
        out = pipe(
            held_out.surface_ratings[surface],
            num_inference_steps=steps,
            guidance_scale=guidance_scale,
            num_textures_per_rating=takes,
            duration_s=held_out.segment_samples / rate,
            generator=torch.Generator("cpu").manual_seed(seed + int(surface)),
        )
        bands = [band_levels_db(textures, rate, edges).mean(0) for textures in (real, out.textures)]
        friction = [np.log(held_out.friction_coefficients[rows]).mean(), np.log(out.friction_coefficient).mean()]
        means.append([*bands, [held_out.levels[rows].mean(), out.level.mean()], friction])
        real_sets.append(real)
        made_sets.append(out.textures)
    real_bands, made_bands, levels, frictions = (np.array(column) for column in zip(*means, strict=True))
    return {
        "real (held out)": _set_metrics(embedding(np.concatenate(real_sets), rate), train_points, embedding.width),
        "generated from their ratings": {
            **_set_metrics(embedding(np.concatenate(made_sets), rate), train_points, embedding.width),
            "surface_nine_band_db": float(np.abs(made_bands - real_bands).mean()),
            "level_r": float(np.corrcoef(levels.T)[0, 1]),
            "log_friction_r": float(np.corrcoef(frictions.T)[0, 1]),
        },
        "mean spectrum of the training set": {
            "surface_nine_band_db": float(np.abs(train_bands - real_bands).mean()),
        },
    }


def rating_sweep(pipe, axis, values=SWEEP_VALUES, takes=40, steps=10, guidance_scale=1.0, seed=0):
    """Textures while one rating moves and the others are not specified.

    Args:
        pipe (`TactileTexturePipeline`): with a DALE.
        axis (`str`): name of the axis.
        values (`tuple[float, ...]`): ratings, z-scores.
        takes (`int`): textures per value.
        steps (`int`): of both stages.
        guidance_scale (`float`): 1.0 = off.
        seed (`int`): each value starts from the same noise.

    Returns:
        `dict`: "values"; per value "level_db" (mean, re 1 N), "share_150_400" (mean share of the power in 150-400 Hz),
        "log_friction" (mean), "spectrum_db" (values, bins) and "frequencies"; "spearman" of level, share and log
        friction with the values; "shape_db": nine-band change between the ends after RMS normalisation.
    """
    levels, shares, frictions, spectra, shapes = [], [], [], [], []
    for value in values:
        generator = torch.Generator("cpu").manual_seed(seed)
        out = pipe(
            {axis: float(value)},
            num_inference_steps=steps,
            guidance_scale=guidance_scale,
            num_textures_per_rating=takes,
            generator=generator,
        )
        power = 10 ** (
            band_levels_db(out.textures, out.sampling_rate, np.array([BAND_HZ[0], *SHARE_BAND_HZ, BAND_HZ[1]])) / 10
        )
        shares.append(float((power[:, 1] / power.sum(-1)).mean()))
        levels.append(float(20 / np.log(10) * out.level.mean()))
        frictions.append(float(np.log(out.friction_coefficient).mean()))
        frequencies, density = power_spectral_density(out.textures, out.sampling_rate)
        spectra.append((10 * np.log10(density + 1e-20)).mean(0))
        unit = out.textures / rms(out.textures)[:, None]
        shapes.append(band_levels_db(unit, out.sampling_rate).mean(0))
    quantities = {"level_db": levels, "share_150_400": shares, "log_friction": frictions}
    return {
        "values": [float(v) for v in values],
        **quantities,
        "spearman": {name: float(spearmanr(values, q).statistic) for name, q in quantities.items()},
        "shape_db": float(np.abs(shapes[-1] - shapes[0]).mean()),
        "frequencies": frequencies,
        "spectrum_db": np.array(spectra),
    }


def long_texture_study(pipe, ratings, duration_s=30.0, seed=0):
    """Whether a long texture is as even and as unlike itself as it should be.

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

"""What was measured on hands: public data that may not be copied here, and the numbers that this file made of them.

`QUOTED` stands in where the folder of data is absent.
"""

import json

import numpy as np

from tactile_diffusers.signal import DEVICE_RATE, SEGMENT_SAMPLES, band_pass
from tactile_diffusers.signal.waveform_shape import waveform_shape

#: Short names of sources, as the table's rows give them.
SOURCES = {
    "Cleland 2024": "bare hand, 16 textures, 19 raters, three trials; magnitude ratings, analysed by us",
    "Culbertson 2017": "Culbertson & Kuchenbecker, stylus, 15 surfaces, 15 raters; quoted",
    "traction": "finger, 10 textures, medians of 40 raters; traction in place of slipperiness, analysed by us",
    "HaTT": "Culbertson et al. 2014, rigid stylus, 100 surfaces; models, analysed by us",
    "Fradin 2023": "bare finger on fabrics, acceleration; 21 segments, or 23 with raised dots, analysed by us",
    "Grigorii 2021": "one stroke of a bare finger at 40 mm/s, force; positive opposes the motion, analysed by us",
    "fingers": "sd over mean on sandpaper 0.16, aluminium 0.34 and wet glass 0.45; quoted in `virtual/exploration.py`",
    "Seo 2009": "finger pad on aluminium and four rubbers, -46 % from 1 to 20 N; quoted",
    "Drewing 2016": "bare finger on gratings 0.3 mm deep: judged roughness rises with the period up to a peak; also "
    "Lawrence et al. 2007: with groove width; quoted",
}
#: What `measure_hands` gives.
QUOTED = {
    "pooled": -0.941,
    "within": -0.793,
    "rough_single": 0.623,
    "rough_means": 0.763,
    "rough_retest": 0.738,
    "slippery_single": 0.604,
    "slippery_means": 0.685,
    "slippery_retest": 0.830,
    "fabrics_kurtosis": 3.914,
    "fabrics_crest_factor": 4.831,
    "fabrics_kurtosis_95": 6.145,
    "dots_kurtosis_95": 12.795,
    "stroke_kurtosis": 3.388,
    "stroke_crest_factor": 4.596,
    "stroke_skew": 0.164,
    "stroke_slope_skew": -0.135,
    "force_50": 0.026,
    "force_5": -0.082,
    "force_95": 0.192,
    "speed_50": 0.409,
    "speed_5": 0.139,
    "speed_95": 0.824,
    "friction_and_level": 0.503,
}


def measure_hands(folder):
    """What the rows need from the folder of measured data: a dict like `QUOTED`."""
    import pandas
    from scipy.io import wavfile

    table = pandas.read_csv(folder / "foot_sole_collated_ratings.csv")
    table = table[(table.Condition == "hand") & table.Metric.isin(["roughness", "slipperiness"])]
    table = table.pivot_table("Rating", ["Participant", "Trial"], ["Metric", "Texture"])
    answers = table.to_numpy().reshape(-1, 3, 2, table.shape[1] // 2).swapaxes(2, 3)
    found = rating_statistics(answers * (1, -1))  # the file's slipperiness is large where it is sticky

    fabrics, dots, seen = [], [], set()
    for path in sorted((folder / "isir_textsense").glob("*.wav")):  # dots.wav comes first
        rate, wave = wavfile.read(path)
        if wave.tobytes() not in seen:  # three files repeat the samples of another
            (dots if path.stem == "dots" else fabrics).extend(cut(band_pass(wave.astype(float), rate)))
        seen.add(wave.tobytes())
    shapes = {"fabrics": waveform_shape(fabrics), "stroke": waveform_shape(stroke(folder))}
    found |= {f"{name}_{key}": np.median(value) for name, shape in shapes.items() for key, value in shape.items()}
    found["fabrics_kurtosis_95"] = np.percentile(shapes["fabrics"]["kurtosis"], 95)
    found["dots_kurtosis_95"] = np.percentile(waveform_shape(fabrics + dots)["kurtosis"], 95)

    hatt = json.loads((folder / "hatt_summary.json").read_text())
    for name in ("force", "speed"):
        found |= percentiles(name, [surface[f"p_{name}_power"] / 2 for surface in hatt])
    mu, levels = (np.array([surface[name] for surface in hatt]) for name in ("mu", "level80"))
    found["friction_and_level"] = correlation(np.log(mu), levels)
    return {name: float(found[name]) for name in QUOTED}


def percentiles(name, values):
    """Median and 5th and 95th percentile: a dict."""
    return {f"{name}_{percent}": np.percentile(values, percent) for percent in (50, 5, 95)}


def cut(wave, margin=1000):
    """Segments of a filtered waveform, a list: they overlap by half, and the filter's ends are left out."""
    wave = wave[margin:-margin]
    starts = range(0, len(wave) - SEGMENT_SAMPLES + 1, SEGMENT_SAMPLES // 2)
    return [wave[start : start + SEGMENT_SAMPLES] for start in starts]


def stroke(folder):
    """The measured stroke where it slides at a steady 40 mm/s, N, 20-1000 Hz: (n,).

    Positive opposes the motion: the sign is settled by the mean force, which differs while the finger slides.
    """
    from scipy.io import loadmat
    from scipy.signal import savgol_filter

    lateral, encoder = loadmat(folder / "finger_stroke.mat")["dataQ"].astype(float).T[[0, 4]]
    position = np.where(encoder > 2**31, encoder - 2**32, encoder) * 5e-4
    speed = savgol_filter(position, 1001, 1, deriv=1, delta=1 / DEVICE_RATE)
    sliding = np.abs(speed - 40) < 4  # the way back, at -40 mm/s, is without a finger
    force = lateral * 4 / 9
    sign = np.sign(force[sliding].mean() - force[-DEVICE_RATE:].mean())
    return sign * band_pass(force, DEVICE_RATE)[sliding]


def correlation(x, y):
    """Pearson's r along the last axis."""
    x, y = (values - values.mean(-1, keepdims=True) for values in (x, y))
    return (x * y).sum(-1) / np.sqrt((x**2).sum(-1) * (y**2).sum(-1))


def mean_over_pairs(rows):
    """Mean correlation of pairs of rows: (..., rows, textures) -> (...)."""
    first, second = np.triu_indices(rows.shape[-2], 1)
    return np.nanmean(correlation(rows[..., first, :], rows[..., second, :]), axis=-1)


def z_scores(answers):
    """Answers of each rater and trial, standardised over textures: (raters, trials, textures, axes)."""
    z = answers - answers.mean(2, keepdims=True)
    return z / np.maximum(z.std(2, keepdims=True), 1e-9)


def rating_statistics(answers):
    """Correlations of axes, raters and trials: a dict, of (raters, trials, textures, 2: rough, slippery) answers."""
    z = z_scores(answers)
    found = {
        "pooled": correlation(*z.mean((0, 1)).T),
        "within": correlation(*np.moveaxis(z.mean(1), -1, 0)).mean(),
    }
    for axis, name in enumerate(("rough", "slippery")):
        found[f"{name}_single"] = mean_over_pairs(z[:, 0, :, axis])
        found[f"{name}_means"] = mean_over_pairs(z[:, :, :, axis].mean(1))
        found[f"{name}_retest"] = mean_over_pairs(z[:, :, :, axis]).mean()
    return {name: float(value) for name, value in found.items()}

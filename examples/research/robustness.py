"""`python robustness.py`: hard inputs and surfaces, half precision, long textures decoded whole and in windows."""

import sys
from copy import deepcopy
from pathlib import Path

import numpy as np
import torch
from study_context import run_study

from tactile_diffusers.data import PreparedDataset
from tactile_diffusers.evaluation.metrics.errors import DB_PER_NEPER, out_of_band_ratio_db, snr_db
from tactile_diffusers.evaluation.metrics.statistics import leaf, number
from tactile_diffusers.pipelines.velocities import texture_velocity
from tactile_diffusers.signal import band_levels_db, band_pass, level, nine_band_error_db, rms

sys.path.append(str(Path(__file__).parents[1]))  # examples, for `report`

from report.sampling import noise_seeds, reconstruct
from report.tables import markdown_table
from report.tables import text as shown

#: Steps at which hard inputs are reconstructed.
STEPS = (1, 5, 10)
#: Textures of each kind: real ones of as many surfaces, and as many draws of noise.
COUNT = 4
#: RMS of made-up inputs, N: about that of a recording (FIELD.md section 5).
RMS_N = 0.01
#: A constant force, N, as a sensor's offset or a mean friction force; and the height of a click, N.
CONSTANT_N, CLICK_N = 0.5, 0.1
#: The least and largest level of an input, N.
FAINT_N, LOUD_N = 1e-6, 10.0
#: A level counts from here on, dB re 1 N; a band counts down to this below the strongest one, dB.
LEAST_LEVEL_DB, WEAKEST_BAND_DB = -200.0, 40.0
#: Margin around the band in which the level of a hard input is measured: tones lie on its edges.
BAND_MARGIN = 1.05
#: Duration in s and number of the textures that are decoded whole and in windows; number of half precision.
LONG_SECONDS, LONG_TEXTURES, HALF_TEXTURES = 10.0, 2, 16

_INPUTS = {
    "silence": "silence",
    "constant": "a constant, 0.5 N",
    "click": "a single click",
    "low_tone": "sine at the band's lower edge",
    "high_tone": "sine at the band's upper edge",
    "clipped": "real, clipped at 1 σ",
    "faint": "real, at 1e-6 N",
    "loud": "real, at 10 N",
    "white_noise": "white noise, full band",
    "band_noise": "white noise in the band",
}


def main(argv=None):
    """Writes robustness.json and robustness.md."""
    description = "Hard inputs and surfaces, half precision, windows of long textures."
    return run_study("robustness", description, study, markdown, argv)


def study(context):
    """The figures as leaves: "inputs", "bfloat16", "any_length" and "hard_split"."""
    data = context.data
    first = np.unique(data.surfaces, return_index=True)[1][:COUNT]  # one segment a surface
    inputs = hard_inputs(data.real[first], data.rate, data.dataset.band, context.rng("hard inputs"))
    return {
        "inputs": {
            name: {str(steps): _hard(context, textures, steps) for steps in STEPS} for name, textures in inputs.items()
        },
        "bfloat16": _half_precision(context),
        "any_length": _any_length(context),
        "hard_split": _hard_split(context),
    }


def hard_inputs(textures, sampling_rate, band, rng):
    """What a model is not trained on, by name.

    Args:
        textures (`np.ndarray`): (n, samples) real ones, N.
        sampling_rate (`float`): Hz.
        band (`tuple[float, float]`): Hz; tones lie on its edges.
        rng (`np.random.Generator`): of noises and phases.

    Returns:
        `dict[str, np.ndarray]`: each (n, samples) float64, N.
    """
    textures = np.asarray(textures, dtype=np.float64)
    count, samples = textures.shape
    unit = textures / rms(textures)[:, None]
    noise = rng.standard_normal(textures.shape)
    click = np.zeros_like(textures)
    click[:, samples // 2] = CLICK_N
    turns = np.arange(samples) / sampling_rate
    phases = rng.uniform(0, 2 * np.pi, (count, 1))
    tones = [RMS_N * np.sqrt(2) * np.sin(2 * np.pi * edge * turns + phases) for edge in band]
    inside = band_pass(noise, sampling_rate, band)
    return {
        "silence": np.zeros_like(textures),
        "constant": np.full_like(textures, CONSTANT_N),
        "click": click,
        "low_tone": tones[0],
        "high_tone": tones[1],
        "clipped": rms(textures)[:, None] * np.clip(unit, -1, 1),
        "faint": FAINT_N * unit,
        "loud": LOUD_N * unit,
        "white_noise": RMS_N * noise,
        "band_noise": RMS_N * inside / rms(inside)[:, None],
    }


def _hard(context, textures, steps):
    made = reconstruct(context.pipe, textures, context.data.rate, steps, context.seed, quiet=context.quiet)
    return hard_metrics(made, textures, context.data.rate, context.data.edges)


def hard_metrics(made, textures, sampling_rate, edges):
    """Leaves of reconstructions of hard inputs.

    Args:
        made, textures (`np.ndarray`): (n, samples), N; `made` may hold NaN.
        sampling_rate (`float`): Hz.
        edges (`np.ndarray`): (10,) of the nine bands, Hz.

    Returns:
        `dict`: "finite", the share of finite outputs, and, of these, "level_db" of the output (dB re 1 N, -300 of
        silence); "level_error_db", of the levels inside the band, where the input has one there; "nine_band_db", over
        the bands within 40 dB of the input's strongest; "out_of_band_db", where the output is not silent.
    """
    finite = np.isfinite(made).all(-1)
    made, textures = made[finite], textures[finite]
    names = ("level_db", "level_error_db", "nine_band_db", "out_of_band_db")
    result = {"finite": number(finite.mean(), len(finite)), **dict.fromkeys(names, number())}
    if not finite.any():
        return result
    band = (edges[0] / BAND_MARGIN, min(edges[-1] * BAND_MARGIN, sampling_rate / 2))
    wanted, found = (band_levels_db(x, sampling_rate, band)[:, 0] for x in (textures, made))
    has_level = wanted > LEAST_LEVEL_DB
    bands, made_bands = (band_levels_db(x, sampling_rate, edges) for x in (textures, made))
    strong = (bands > bands.max(-1, keepdims=True) - WEAKEST_BAND_DB) & has_level[:, None]
    nine_band = np.where(strong, np.abs(made_bands - bands), 0).sum(-1) / np.maximum(strong.sum(-1), 1)
    output = DB_PER_NEPER * level(made)
    return result | {
        "level_db": leaf(output),
        "level_error_db": leaf(np.where(has_level, found - wanted, np.nan)),
        "nine_band_db": leaf(np.where(has_level, nine_band, np.nan)),
        "out_of_band_db": leaf(np.where(output > LEAST_LEVEL_DB, out_of_band_ratio_db(made, sampling_rate), np.nan)),
    }


def _half_precision(context):
    """A bfloat16 LCTG against the float32 one, from the same noise."""
    rows = slice(0, HALF_TEXTURES)
    half = type(context.pipe)(
        lctg=deepcopy(context.pipe.lctg).bfloat16(),
        feature_extractor=context.pipe.feature_extractor,
        scheduler=deepcopy(context.pipe.scheduler),
    )
    half.set_progress_bar_config(disable=True)
    made = [
        reconstruct(pipe, context.data.real[rows], context.data.rate, context.steps, context.seed, quiet=context.quiet)
        for pipe in (half, context.pipe)
    ]
    return differences(*made, context.data.rate, context.data.edges, context.data.surfaces[rows])


def differences(made, wanted, sampling_rate, edges, surfaces):
    """Leaves "rms_difference", relative to the RMS of `wanted`, and "nine_band_db", of two sets of textures."""
    return {
        "rms_difference": leaf(rms(made - wanted) / rms(wanted), surfaces),
        "nine_band_db": leaf(nine_band_error_db(made, wanted, sampling_rate, edges), surfaces),
    }


def _hard_split(context):
    """Reconstructions of the surfaces, classes and fingers that the data keep apart, beside the ordinary held-out ones.

    Returns:
        `dict` or `None`: leaves "nine_band_db", "snr_db", "ordinary_nine_band_db", "ordinary_snr_db" and "times", the
        ratio of the nine-band errors; None where the data keep nothing apart.
    """
    if "hard" not in context.data.dataset.splits or context.data.dataset.split == "hard":
        return None
    hard = PreparedDataset(context.data.dataset.path, "hard")
    rows = hard.non_overlapping(context.data.per_surface, context.seed)
    sets = {"": (hard.textures(rows), hard.surface_ids[rows]), "ordinary_": (context.data.real, context.data.surfaces)}
    found = {}
    for name, (textures, surfaces) in sets.items():
        made = reconstruct(context.pipe, textures, context.data.rate, context.steps, context.seed, quiet=context.quiet)
        error = nine_band_error_db(made, textures, context.data.rate, context.data.edges)
        found[f"{name}nine_band_db"] = leaf(error, surfaces)
        newtons = context.data.dataset.unit == "N"
        found[f"{name}snr_db"] = leaf(snr_db(made, textures), surfaces) if newtons else number()
    found["times"] = number(found["nine_band_db"]["mean"] / found["ordinary_nine_band_db"]["mean"], len(rows))
    return found


def _any_length(context):
    """Long latents decoded in the pipeline's windows against in one piece, from the same noise."""
    textures, surfaces = long_stretches(context.data.dataset, LONG_SECONDS, LONG_TEXTURES)
    pipe = context.pipe
    made = pipe.encode(textures, context.data.rate)
    steps, seeds = context.steps, noise_seeds([context.seed, 2], 2)
    whole = _decode(pipe, made, one_piece, steps, seeds[0])
    windows = _decode(pipe, made, texture_velocity, steps, seeds[0])
    other = _decode(pipe, made, one_piece, steps, seeds[1])
    rate = pipe.feature_extractor.delivery_rate
    return {
        "seconds": number(textures.shape[-1] / context.data.rate, len(textures)),
        "windows": differences(windows, whole, rate, context.data.edges, surfaces),
        "other_noise": differences(other, whole, rate, context.data.edges, surfaces),
    }


def one_piece(lctg, latents, timesteps):
    """LCTG's velocity of the whole at once, however long: `texture_velocity` without windows."""
    return lambda waveform, step: lctg(waveform.to(lctg.dtype), timesteps[step], latents, return_dict=False)[0]


@torch.no_grad()
def _decode(pipe, made, make_velocity, steps, seed):
    """The pipeline's decoding with a velocity of our own: (n, samples) float32, N."""
    latents, scheduler = made.latents, deepcopy(pipe.scheduler)
    shape = (len(latents), 1, latents.shape[-1] * pipe.lctg.config.latent_hop)
    state = torch.randn(shape, generator=torch.Generator("cpu").manual_seed(int(seed))).to(latents.device)
    scheduler.set_timesteps(steps, device=latents.device)
    velocity = make_velocity(pipe.lctg, latents, scheduler.timesteps)
    for step, t in enumerate(scheduler.timesteps):
        state = scheduler.step(velocity(state, step), t, state, return_dict=False)[0]
    return pipe.feature_extractor.denormalize(state[:, 0], made.level, **pipe.lctg.restored(latents))


def long_stretches(dataset, seconds, count):
    """The longest stretches of recording that a data set's segments cover without a gap, of different surfaces.

    Args:
        dataset (`PreparedDataset`): of any split.
        seconds (`float`): longer ones are cut off.
        count (`int`): at most so many.

    Returns:
        `tuple[np.ndarray, np.ndarray]`: (n, samples) float32, N, as long as the shortest of them, and surfaces (n,).
    """
    order = np.lexsort((dataset.starts, dataset.recording_ids))
    recordings, starts = dataset.recording_ids[order], dataset.starts[order]
    apart = (np.diff(recordings) != 0) | (np.diff(starts) > dataset.segment_samples)
    runs = np.split(order, np.flatnonzero(apart) + 1)
    runs.sort(key=lambda rows: dataset.starts[rows[0]] - dataset.starts[rows[-1]])
    chosen = {}
    for rows in runs:
        chosen.setdefault(int(dataset.surface_ids[rows[0]]), rows)
    longest = dict(list(chosen.items())[:count])
    joined = [_joined(dataset, rows) for rows in longest.values()]
    samples = min(round(seconds * dataset.sampling_rate), *map(len, joined)) if joined else 0
    return np.stack([texture[:samples] for texture in joined]), np.array(list(longest))


def _joined(dataset, rows):
    """Segments that follow each other or overlap, as the one texture that they were cut from."""
    places = dataset.starts[rows] - dataset.starts[rows[0]]
    texture = np.empty(places[-1] + dataset.segment_samples, dtype=np.float32)
    for place, segment in zip(places, dataset.textures(rows), strict=True):
        texture[place : place + len(segment)] = segment
    return texture


def markdown(section):
    """The figures as tables."""
    steps = list(next(iter(section["inputs"].values())))
    rows = {}
    for name, by_steps in section["inputs"].items():
        last = by_steps[steps[-1]]
        rows[_INPUTS[name]] = {
            "finite": min(entry["finite"]["mean"] for entry in by_steps.values()),
            "level_db": last["level_db"],
            **{f"level_error_{count}": by_steps[count]["level_error_db"] for count in steps},
            **{f"nine_band_{count}": by_steps[count]["nine_band_db"] for count in steps},
            "out_of_band": last["out_of_band_db"],
        }
    labels = {
        "finite": ("finite", 0),
        "level_db": ("output, dB re 1 N", 1),
        **{f"level_error_{count}": f"level error in the band, dB, {count} steps" for count in steps},
        **{f"nine_band_{count}": f"nine-band error, dB, {count}" for count in steps},
        "out_of_band": (f"above 1.05 kHz, dB, {steps[-1]}", 1),
    }
    half, long = section["bfloat16"], section["any_length"]
    words = (
        f"LCTG in bfloat16 differs from float32 by {_both(half)}. Latents of {shown(long['seconds'], 1)} s decoded in "
        f"windows differ from the same decoded in one piece by {_both(long['windows'])}; another noise makes "
        f"{_both(long['other_noise'])}."
    )
    parts = ["# Hard inputs, half precision, any length", markdown_table(rows, labels=labels), words]
    if section["hard_split"]:
        parts.append(_hard_split_words(section["hard_split"]))
    return "\n\n".join(parts)


def _hard_split_words(entry):
    return (
        f"Surfaces, classes and fingers that the data keep apart ({entry['nine_band_db']['n']} segments): nine-band "
        f"error {shown(entry['nine_band_db']['mean'], 3)} dB, {shown(entry['times']['mean'])} times that of the "
        f"ordinary held-out surfaces ({shown(entry['ordinary_nine_band_db']['mean'], 3)} dB); SNR "
        f"{shown(entry['snr_db']['mean'])} dB against {shown(entry['ordinary_snr_db']['mean'])} dB."
    )


def _both(entry):
    share = shown(_percent(entry["rms_difference"]["mean"]), 1)
    return f"{share} % of the RMS and {shown(entry['nine_band_db'])} dB in the nine bands"


def _percent(share):
    return None if share is None else 100 * share


if __name__ == "__main__":
    sys.exit(main())

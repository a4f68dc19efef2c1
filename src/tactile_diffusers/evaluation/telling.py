"""Markdown of the sections "latents" and "robustness": tables and one sentence each, nothing is measured here."""

from .tables import markdown_table, text

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


def latents_markdown(section, level=2):
    """The section "latents" of a report as Markdown under a heading of that level."""
    blend = section["interpolation"]
    counted = blend["monotone_share"]["n"] or 0
    words = (
        f"Blends of two held-out surfaces: {counted} band levels differ by more than 3 dB between the two, "
        f"{text(_percent(blend['monotone_share']['mean']), 0)} % of them change one way only (within 0.5 dB); largest "
        f"way back {text(blend['reversal_db']['max'])} dB, largest difference from a straight line "
        f"{text(blend['departure_db']['max'])} dB (mean {text(blend['departure_db']['mean'])})."
    )
    shift = "Difference of the latents of a delayed texture, relative to their variation over time:"
    layers = markdown_table({f"{name} layer": entry for name, entry in section["layers"].items()}, labels=_LAYERS)
    shifts = markdown_table(
        {f"{name} layer": entry for name, entry in section["time_shift"].items()}, digits=3, labels=_SHIFTS
    )
    return "\n\n".join([f"{'#' * level} Latents", layers, shift, shifts, words])


def robustness_markdown(section, level=2):
    """The section "robustness" of a report as Markdown under a heading of that level."""
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
        f"LCTG in bfloat16 differs from float32 by {_both(half)}. Latents of {text(long['seconds'], 1)} s decoded in "
        f"windows differ from the same decoded in one piece by {_both(long['windows'])}; another noise makes "
        f"{_both(long['other_noise'])}."
    )
    parts = [f"{'#' * level} Hard inputs, half precision, any length", markdown_table(rows, labels=labels), words]
    if section["hard_split"]:
        parts.append(_hard_split(section["hard_split"]))
    return "\n\n".join(parts)


def _hard_split(entry):
    return (
        f"Surfaces, classes and fingers that the data keep apart ({entry['nine_band_db']['n']} segments): nine-band "
        f"error {text(entry['nine_band_db']['mean'], 3)} dB, {text(entry['times']['mean'])} times that of the ordinary "
        f"held-out surfaces ({text(entry['ordinary_nine_band_db']['mean'], 3)} dB); SNR "
        f"{text(entry['snr_db']['mean'])} dB against {text(entry['ordinary_snr_db']['mean'])} dB."
    )


def _both(entry):
    share = text(_percent(entry["rms_difference"]["mean"]), 1)
    return f"{share} % of the RMS and {text(entry['nine_band_db'])} dB in the nine bands"


def _percent(share):
    return None if share is None else 100 * share

"""Columns of the tables of a report: key of a metric -> heading, or (heading, digits after the point)."""

from tactile_diffusers.evaluation.metrics.errors import SIGNED_BANDS_HZ, signed_band_key

from .baselines import NAMES

#: Names of LCTG and of what stands in for it.
DECODERS = {
    "lctg": "**LCTG, all layers**",
    "no_network": "no network: stored low end, white noise above, levels restored",
    "nothing_imposed": "LCTG, levels not restored",
    "lctg_base": "**LCTG, base layer alone**",
    "no_network_base": "no network, base layer alone: white noise, levels restored",
    "nothing_imposed_base": "LCTG, base layer alone, levels not restored",
}
#: Steps at which configurations are compared: the paper's best (section 3.1).
COMPARED_STEPS = "10"
#: Headings of metrics of reconstructions and of sets.
HEADINGS = {
    "nine_band_db": "nine-band error, dB",
    "lsd_db": "LSD, dB",
    "out_of_band_db": "above 1.05 kHz, dB",
    "snr_db": "SNR, dB",
    "rmse_n": ("RMSE, N", 5),
    "ftd_excess": "FTD over real",
    "ktd_excess": "KTD over real",
    "seconds_per_segment": ("s per segment, one thread", 4),
    "efficiency_score": ("efficiency score (RMSE × s), N·s", 6),
    "precision": "precision",
    "recall": "recall",
    "diversity": "diversity over takes of one surface",
    "diversity_of_rating": "over real textures of such ratings",
    "copied_share": "copied (0.05 = none)",
}


def _columns(names):
    return {name: HEADINGS[name] for name in names.split()}


RECONSTRUCTION = _columns("nine_band_db lsd_db out_of_band_db snr_db rmse_n ktd_excess")
DECODING = {
    "nine_band_db": ("nine-band error, dB", 3),
    **_columns("snr_db ktd_excess"),
    "kilobits_per_second": "kbit/s",
    "sigma": ("noise on the latents", 3),
    "noisy_nine_band_db": ("with it: nine-band error, dB", 3),
    "noisy_snr_db": "SNR, dB",
    "noisy_ktd_excess": "KTD over real",
}
DIFFERENCES = {"ktd": "KTD", "nine_band_db": ("nine-band error, dB", 3), "snr_db": "SNR, dB"}
BANDS = {signed_band_key((low, high)): f"{low}–{high} Hz" for low, high in SIGNED_BANDS_HZ}
STEPS = _columns("nine_band_db ktd_excess snr_db seconds_per_segment efficiency_score")
SETS = _columns("ftd_excess ktd_excess precision recall diversity diversity_of_rating copied_share out_of_band_db")
UNSEEN = {
    "nine_band_db": "error of the mean spectrum, dB",
    "nine_band_over_model_db": "more than generated, the same surfaces, dB",
    "level_r": "r of level",
    "log_friction_r": "r of log friction",
}
#: What textures do over time: its spread over textures, and its correlation over surfaces.
VARIATION = {
    f"{name}_{kind}": f"{label}{name.replace('_', ' ')}"
    for kind, label in (("spread", "spread of "), ("r", "r of "))
    for name in ("envelope_variation", "kurtosis", "crest", "skew", "slope_skew", "event_rate")
}
#: Rows of the second judge.
JUDGED = {
    **{"other_take": "another real take (chance)", "model": "**generated from ratings**"},
    **{"nearest_surface": "real take of the training surface with the nearest ratings"},
    **{slug: NAMES[slug] for slug in ("knn_blend", "ridge")},
    **DECODERS,
}
TOLD_APART = {
    "signal_alone": "alone",
    "signal_alone_eventful": "eventful",
    "signal_beside_surface": "beside the surface",
    "signal_beside_surface_eventful": "eventful",
    "afferents_alone": "afferents alone",
    "afferents_beside_surface": "afferents beside the surface",
}
NETWORK = {key: heading for key, heading in TOLD_APART.items() if not key.endswith("_eventful")}
GIVEAWAYS = {"alone": "alone", "beside_surface": "beside the surface"}
EFFECTS = {
    "changes": "changes as between real surfaces",
    "matrix": "response matrix, largest difference from real",
    "nine_band_db": "unseen surfaces, dB",
    "nine_band_over_model_db": "more than generated, dB",
}
CHANGES = {
    "changes": "right",
    "level_db_change": "of level",
    "shape_db": "of shape",
    "log_friction_change": "of friction",
    "closer": "generated is closer in",
    "alone": "right alone: generated / this",
    "right_more": "share right, generated minus this",
}
CURVES = {
    "level_db": "level",
    "centroid_hz": "centroid",
    "log_friction": "log friction",
    "estimate": "judge's estimate",
}
SPEED = {
    "duration_s": ("lasts, s", 4),
    "seconds_per_step": ("s per step", 4),
    "real_time_steps": ("real-time steps", 0),
    "seconds": ("s", 4),
}


def default_steps(report):
    """Key of the step sweep at the pipeline's default."""
    steps, default = report["reconstruction"]["steps"], str(report["pipeline"]["num_inference_steps"])
    return default if default in steps else next(iter(steps))


def compared_steps(steps):
    """Key of the step sweep at which configurations are compared: `COMPARED_STEPS`, or the most that there are."""
    return COMPARED_STEPS if COMPARED_STEPS in steps else max(steps, key=int)


def default_guidance(report):
    """Key of the pipeline's default guidance scale."""
    return str(float(report["pipeline"]["guidance_scale"]))

"""Names of rows, columns and metrics in tables."""

from .metrics.errors import SIGNED_BANDS_HZ, signed_band_key

#: Names of the baselines.
NAMES = {
    "silence": "silence",
    "other_take": "another take of the surface",
    "phase_randomised": "phase-randomised copy",
    "mean_spectrum": "noise of the mean spectrum",
    "lpc20": "autoregressive model (LPC 20)",
    "beta_envelope": "beta envelope (ours, after arXiv 2605.23804)",
    "slope_envelope": "slope envelope (ours, after arXiv 2605.23804)",
    "nine_band_noise": "nine-band noise",
    "decimated": "low-passed to the latent's bits",
    "knn_blend": "blend of 5 nearest surfaces (from ratings)",
    "ridge": "ridge regression and noise (from ratings)",
}
#: What the paper reports (sections 3.1 to 3.4), on SENS3.
PAPER = {
    "rmse_n": "11.4 (6.2–18.1)",
    "snr_db": "−1.87 (−2.36 to −1.21)",
    "power_difference_n2": "5.0e-05, max 1.0e-04",
    "power_difference_percent": "59 (from its power difference, RMSE and SNR)",
    "best_steps": "10",
    "real_time_steps": "over 50 (RTX 4060)",
    "rmse_protocol_mn": "5.57",
    "latent_shift_percent": "0–2",
}
#: Steps at which configurations are compared: the paper's best (section 3.3).
COMPARED_STEPS = "10"
#: Metrics of a reconstruction.
SPECTRAL = {
    "nine_band_db": "nine-band error, dB",
    "lsd_db": "LSD, dB",
    "gfc": "GFC",
    "level_error_db": "level error, dB",
    "out_of_band_db": "above 1.05 kHz, dB",
    "snr_db": "SNR, dB",
    "rmse_n": ("RMSE, N", 5),
    "power_bias_percent": "difference of the mean power, %",
    "power_difference_percent": "mean power difference, % of the mean power",
    "ftd": "FTD",
    "ktd": "KTD",
    "ktd_excess": "KTD over real",
}
BANDS = {signed_band_key((low, high)): f"{low}–{high} Hz" for low, high in SIGNED_BANDS_HZ}
#: Metrics of a set of generated textures.
SETS = {
    "ftd": "FTD",
    "ftd_excess": "FTD over real",
    "ktd": "KTD",
    "ktd_excess": "KTD over real",
    "precision": "precision",
    "recall": "recall",
    "diversity": "diversity",
    "nearest_correlation": "nearest training segment, correlation",
    "novelty_share": "closer than the real 1st percentile: correlation",
    "novelty_share_embedding": "embedding (reference only)",
    "novelty_share_latent": "latent (reference only)",
    "out_of_band_db": "above 1.05 kHz, dB",
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

"""Evaluation: metrics of single textures and of sets, a judge, and the truth of ratings."""

from ..lazy import importing

_PLACES = {
    ".judge": ("Judge", "response_matrix"),
    ".truth": ("RatedTextures",),
    ".metrics.copying": ("TrainingEnvelopes", "copied_share"),
    ".metrics.distances": ("frechet_tactile_distance", "kernel_tactile_distance"),
    ".metrics.diversity": ("covered", "diversity"),
    ".metrics.embedding": ("EMBEDDING_VERSION", "FEATURE_NAMES", "TactileEmbedding", "tactile_features"),
    ".metrics.errors": (
        *("goodness_of_fit", "level_error_db", "log_spectral_distance_db", "out_of_band_ratio_db"),
        *("power_difference", "rmse", "signed_band_error_db", "snr_db"),
    ),
    ".metrics.reference": ("Reference",),
    ".metrics.statistics": ("jackknife", "leaf"),
}
__all__ = sorted(name for names in _PLACES.values() for name in names)
__getattr__ = importing(__name__, _PLACES)

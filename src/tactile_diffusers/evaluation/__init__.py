"""Evaluation: metrics of single textures and of sets, a judge, and the truth of ratings."""

from importlib import import_module

_PLACES = {
    "judge": ("Judge", "response_matrix"),
    "truth": ("RatedTextures",),
    "metrics.copying": ("TrainingEnvelopes", "copied_share"),
    "metrics.distances": ("frechet_tactile_distance", "kernel_tactile_distance"),
    "metrics.diversity": ("covered", "diversity"),
    "metrics.embedding": ("EMBEDDING_VERSION", "FEATURE_NAMES", "TactileEmbedding", "tactile_features"),
    "metrics.errors": (
        *("goodness_of_fit", "level_error_db", "log_spectral_distance_db", "out_of_band_ratio_db"),
        *("power_difference", "rmse", "signed_band_error_db", "snr_db"),
    ),
    "metrics.reference": ("Reference",),
    "metrics.statistics": ("jackknife", "leaf"),
}
_MODULES = {name: module for module, names in _PLACES.items() for name in names}

__all__ = sorted(_MODULES)


def __getattr__(name):
    """Imports a module when one of its names is first used."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{_MODULES[name]}", __name__), name)

"""What the encoder hears."""

from .feature_extraction_tactile import TactileFeatureExtractor, fit_preemphasis

__all__ = ["TactileFeatureExtractor", "fit_preemphasis"]

"""Features of textures for the encoder, and the way back to newtons."""

from .feature_extraction_tactile import TactileFeatureExtractor

__all__ = ["TactileFeatureExtractor"]

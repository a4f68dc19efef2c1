"""To find a texture that somebody prefers, by comparisons of two."""

from .preference_search import BestTexture, PreferenceSearch

__all__ = ["BestTexture", "PreferenceSearch"]

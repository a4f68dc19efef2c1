"""Metrics: pure functions on arrays of textures, embeddings and latents."""

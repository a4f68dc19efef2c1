"""Metrics: pure functions on arrays of textures, embeddings, latents and ratings."""

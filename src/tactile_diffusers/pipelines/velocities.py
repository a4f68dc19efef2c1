"""Velocity functions `velocity(state, t)` of both stages, for segments and for longer textures."""

from .windows import Windows, in_chunks


def rating_velocity(dale, scheduler, ratings, frames, guidance):
    """DALE's velocity given ratings.

    Args:
        dale (`DALEModel`): its `latent_frames` is the window of long textures.
        scheduler (`VDDIMScheduler`): DALE's.
        ratings (`torch.Tensor`): (batch, axes), z-scores, NaN = not specified.
        frames (`int`): latent frames of the whole, at least one window.
        guidance (`Guidance`): pushes away from what DALE would answer without ratings.
    """

    dtype = dale.dtype  # read once: it is searched for among all weights

    def guided(state, t, ratings):
        state = state.to(dtype)  # the sampler's state is wider than a half-precision model
        return guidance.velocity(dale, scheduler, state, t, ratings)

    windows = Windows(frames, dale.config.latent_frames)
    if len(windows.starts) == 1:
        return lambda state, t: guided(state, t, ratings)
    window_ratings = windows.repeat(ratings)

    def fused(state, t):
        field, scalars = dale.split(state)  # every window sees the level and friction of the whole
        pieces = dale.join(windows.split(field), windows.repeat(scalars))
        velocity = in_chunks(lambda piece, rating: guided(piece, t, rating), pieces, window_ratings)
        field, scalars = dale.split(velocity)
        return dale.join(windows.fuse(field), scalars.unflatten(0, (len(windows.starts), -1)).mean(0))

    return fused


def texture_velocity(lctg, latents):
    """LCTG's velocity given latents (batch, latent_channels, frames)."""
    size = lctg.config.segment_samples // lctg.config.latent_hop
    windows, dtype = Windows(latents.shape[-1], min(size, latents.shape[-1])), lctg.dtype
    if len(windows.starts) == 1:
        conditions = lctg.condition(latents)
        return lambda waveform, t: lctg(waveform.to(dtype), t, conditions, return_dict=False)[0]
    fine, contexts = windows.scaled(lctg.config.latent_hop), windows.split(latents)

    def fused(waveform, t):
        pieces = fine.split(waveform.to(dtype))
        return fine.fuse(in_chunks(lambda x, z: lctg(x, t, z, return_dict=False)[0], pieces, contexts))

    return fused

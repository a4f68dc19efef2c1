"""Velocity functions `velocity(state, step)` of both stages, for one window and for longer textures."""

from ..models.hooks import has_hooks
from .windows import Windows, in_chunks


def rating_velocity(dale, scheduler, ratings, frames, guidance):
    """DALE's velocity given ratings (batch, axes) in z-scores, NaN = not specified, at the scheduler's timesteps.

    `frames` (at least DALE's `latent_frames`, the window) are those of the whole. `guidance()` is the `Guidance` of the
    next step, which a callback may change.
    """
    windows = Windows(frames, dale.config.latent_frames)
    if len(windows.starts) == 1:
        return _segment_velocity(dale, scheduler, ratings, guidance)
    dtype, timesteps, window_ratings = dale.dtype, scheduler.timesteps, windows.repeat(ratings)

    def guided(state, t, ratings):
        weights, rows = guidance().conditions(ratings)
        return guidance().velocity(dale, scheduler, state, t, rows, weights)

    def fused(state, step):
        field, scalars = dale.split_scalars(state.to(dtype))  # every window gets the level and friction of the whole
        pieces = dale.append_scalars(windows.cut(field), windows.repeat(scalars))
        t = timesteps[step]
        velocity = in_chunks(lambda piece, rating: guided(piece, t, rating), pieces, window_ratings)
        field, scalars = dale.split_scalars(velocity)
        return dale.append_scalars(windows.fuse(field), scalars.unflatten(0, (len(windows.starts), -1)).mean(0))

    return fused


def _segment_velocity(dale, scheduler, ratings, guidance):
    """`rating_velocity` of one window: conditions of all steps are computed together, again if guidance changes."""
    dtype, timesteps = dale.dtype, scheduler.timesteps
    current = weights = conditions = None

    def velocity(state, step):
        nonlocal current, weights, conditions
        if guidance() != current:
            current = guidance()
            weights, rows = current.conditions(ratings)
            conditions = [rows] * len(timesteps) if has_hooks(dale) else dale.condition(rows, timesteps)
        # the sampler's state is wider than a half-precision model
        return current.velocity(dale, scheduler, state.to(dtype), timesteps[step], conditions[step], weights)

    return velocity


def texture_velocity(lctg, latents, timesteps):
    """LCTG's velocity given latents (batch, latent_channels, frames) of its dtype, at timesteps (steps,)."""
    size = lctg.config.segment_samples // lctg.config.latent_hop
    windows, dtype = Windows(latents.shape[-1], min(size, latents.shape[-1])), latents.dtype
    if len(windows.starts) == 1:
        conditions = [latents] * len(timesteps) if has_hooks(lctg) else lctg.condition(latents, timesteps)
        return lambda waveform, step: lctg(waveform.to(dtype), timesteps[step], conditions[step], return_dict=False)[0]
    fine, contexts = windows.scaled(lctg.config.latent_hop), windows.cut(latents)

    def fused(waveform, step):
        pieces, t = fine.cut(waveform.to(dtype)), timesteps[step]
        return fine.fuse(in_chunks(lambda x, z: lctg(x, t, z, return_dict=False)[0], pieces, contexts))

    return fused

"""Section "speed": what a step costs, and how many steps are still real time on this machine."""

import time

import numpy as np
import torch

from ..metrics.statistics import leaf, number

#: The paper's display works in blocks of about this length.
BLOCK_SECONDS = 0.1
# steps between which the cost of a step is measured
_FEW, _MANY = 4, 20


def run(context):
    """The section: `{"speed": ...}`."""
    pipe, config = context.pipe, context.pipe.lctg.config
    rate = pipe.feature_extractor.sampling_rate
    frames = config.segment_samples // config.latent_hop
    block = max(1, round(BLOCK_SECONDS * rate / config.latent_hop))
    result = {
        "segment": _real_time(context, frames, rate),
        "block_100ms": _real_time(context, block, rate),
        "encode_seconds": leaf(_timed(context, lambda: pipe.encode(context.real[:1], context.rate))),
    }
    if pipe.dale is not None:
        ratings = [[None] * len(pipe.dale.config.rating_axes)]
        latent = _timed(context, lambda: pipe(ratings, output_type="latent"))
        whole = _timed(context, lambda: pipe(ratings))
        result["dale_seconds"], result["pipeline_seconds"] = leaf(latent), leaf(whole)
        result["real_time_factor"] = leaf(np.array(whole) * rate / config.segment_samples)
    return {"speed": result}


def decoding_seconds(context, pipe, steps, frames=None):
    """Seconds that decoding one texture of `frames` latent frames (one segment by default) takes: (repeats,)."""
    config = pipe.lctg.config
    frames = frames or config.segment_samples // config.latent_hop
    latents, level = torch.zeros(1, config.latent_channels, frames), torch.zeros(1)
    return _timed(context, lambda: pipe.decode(latents, level, num_inference_steps=steps))


def _timed(context, work):
    work()  # warm up
    seconds = []
    for _ in range(context.settings.repeats):
        start = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - start)
    return np.array(seconds)


def _real_time(context, frames, rate):
    """A number of steps that takes no longer than the texture lasts, about the largest, and its measured time."""
    duration = frames * context.pipe.lctg.config.latent_hop / rate
    few, many = (np.median(decoding_seconds(context, context.pipe, steps, frames)) for steps in (_FEW, _MANY))
    per_step = max((many - few) / (_MANY - _FEW), 1e-9)
    steps, measured = int((duration - few) / per_step) + _FEW, None
    while steps >= 1:  # costs are not quite linear: lowered until a measured number of steps holds
        measured = decoding_seconds(context, context.pipe, steps, frames)
        if np.median(measured) <= duration:
            break
        steps = min(steps - 1, int(steps * 0.98 * duration / np.median(measured)))
    return {
        "duration_s": number(duration, 1),
        "seconds_per_step": number(per_step, 2 * context.settings.repeats),
        "real_time_steps": number(max(steps, 0), context.settings.repeats),
        "seconds_at_real_time_steps": leaf(measured if steps >= 1 else None),
    }

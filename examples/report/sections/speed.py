"""Section "speed": the cost of a step, and the number of steps that are real time on this machine."""

import time

import numpy as np
import torch

from tactile_diffusers.evaluation.metrics.statistics import leaf, number

#: The paper's display works in blocks of about this length.
BLOCK_SECONDS = 0.1
#: Steps between which the cost of a step is measured.
TIMED_STEPS = (5, 25)


def run(context):
    """The section: `{"speed": ...}`."""
    pipe, config, repeats = context.pipe, context.pipe.lctg.config, context.settings.repeats
    rate = pipe.feature_extractor.sampling_rate
    frames = config.segment_samples // config.latent_hop
    block = max(1, round(BLOCK_SECONDS * rate / config.latent_hop))
    result = {
        "segment": _real_time(pipe, frames, repeats),
        "block_100ms": _real_time(pipe, block, repeats),
        "encode_seconds": leaf(_timed(lambda: pipe.encode(context.data.real[:1], context.data.rate), repeats)),
    }
    if pipe.dale is not None:
        ratings = [[None] * len(pipe.dale.config.rating_axes)]
        whole = _timed(lambda: pipe(ratings), repeats)
        result["dale_seconds"] = leaf(_timed(lambda: pipe(ratings, output_type="latent"), repeats))
        result["pipeline_seconds"] = leaf(whole)
        result["real_time_factor"] = leaf(whole * rate / config.segment_samples)
    return {"speed": result}


def decoding_seconds(pipe, steps, repeats, frames=None, channels=0):
    """Seconds that decoding one texture of `frames` latent frames (one segment by default) takes: (repeats,).

    The latents are zero beyond the first `channels`.
    """
    config = pipe.lctg.config
    frames = frames or config.segment_samples // config.latent_hop
    latents, level = torch.zeros(1, config.latent_channels, frames), torch.zeros(1)
    latents[:, :channels] = 0.1
    return _timed(lambda: pipe.decode(latents, level, num_inference_steps=steps), repeats)


def _timed(work, repeats):
    work()  # warm up
    seconds = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - start)
    return np.array(seconds)


def steps_in_time(seconds, duration):
    """Seconds of a step, and how many steps last as long as what they decode, `duration` s.

    `seconds` are those of two numbers of steps, in order. `None` for the number where they cannot tell: on a busy
    machine fewer steps may take longer.
    """
    (few, least), (many, most) = seconds.items()
    per_step = (most - least) / (many - few)
    return per_step, max(0, int((duration - least) / per_step + few)) if per_step > 0 else None


def _real_time(pipe, frames, repeats):
    """Steps of LCTG that last as long as what they decode."""
    duration = frames * pipe.lctg.config.latent_hop / pipe.feature_extractor.sampling_rate
    seconds = {steps: np.median(decoding_seconds(pipe, steps, repeats, frames)) for steps in TIMED_STEPS}
    per_step, steps = steps_in_time(seconds, duration)
    return {
        "duration_s": number(duration, 1),
        "seconds_per_step": number(per_step, 2 * repeats),
        "real_time_steps": number(steps, repeats),
    }

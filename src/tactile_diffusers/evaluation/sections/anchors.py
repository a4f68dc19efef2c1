"""Anchors: further checkpoints whose LCTG is measured on the very same segments, to be read beside ours.

An anchor may work at another rate and with other latents, such as the paper's configuration at 10 kHz.
"""

from dataclasses import dataclass
from pathlib import Path

from .reconstruction import bit_rate, step_leaves


@dataclass(frozen=True)
class Anchor:
    """A checkpoint to compare with.

    Attributes:
        pipe (`TactileTexturePipeline`): with or without DALE, which is not used.
        folder (`Path`): where it lies; says what is known of its training.
    """

    pipe: object
    folder: Path


def measure(context, pipe):
    """Leaves of one anchor: `{"steps": {steps: metrics}, "kilobits_per_second": leaf}`."""
    steps = {str(count): step_leaves(context, pipe, count)[0] for count in context.settings.anchor_steps}
    return {"steps": steps, "kilobits_per_second": bit_rate(context, pipe)}

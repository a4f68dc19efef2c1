"""What several processes agree on before they start."""

import torch
from accelerate.utils import parse_flag_from_env


def on_cpu():
    """Whether accelerate computes on the CPU: because `ACCELERATE_USE_CPU` says so, or there is nothing else.

    Without a GPU it has to be told, or each of several processes takes itself for the only one (accelerate 1.15).
    """
    return bool(parse_flag_from_env("ACCELERATE_USE_CPU")) or not torch.accelerator.is_available()

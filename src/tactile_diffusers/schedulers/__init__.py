"""The sampler."""

from .scheduling_v_ddim import VDDIMScheduler, VDDIMSchedulerOutput

__all__ = ["VDDIMScheduler", "VDDIMSchedulerOutput"]

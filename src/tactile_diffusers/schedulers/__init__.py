"""The sampler."""

from .scheduling_v_ddim import RECOMMENDED, VDDIMScheduler, VDDIMSchedulerOutput

__all__ = ["RECOMMENDED", "VDDIMScheduler", "VDDIMSchedulerOutput"]

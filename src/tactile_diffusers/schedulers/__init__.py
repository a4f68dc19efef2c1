"""The sampler."""

from .scheduling_v_ddim import RECOMMENDED, VDDIMScheduler, VDDIMSchedulerOutput, draw_noise

__all__ = ["RECOMMENDED", "VDDIMScheduler", "VDDIMSchedulerOutput", "draw_noise"]

"""Part of stability.py: a line of its table, and what all of its cases share."""

import copy
import math
from functools import cached_property
from typing import NamedTuple

import numpy as np
import torch

from tactile_diffusers.signal import nine_band_error_db, rms

#: What cases generate from; the last texture has no rating.
RATINGS = [[1.5, 0.0, -1.0], [-1.0, 1.0, 0.0], [0.3, -1.2, 1.0], [None, None, None]]
DECIBEL = 20 / math.log(10)
#: Bounds where only the order of float32 operations differs: a hundred roundings; and less than can be shown, dB.
SAME, SAME_DB = 100 * float(np.finfo(np.float32).eps), 1e-3


class Row(NamedTuple):
    """A line of the table: it passes if `value` is at most `bound`; NaN fails."""

    case: str
    measured: str
    value: float
    bound: float
    unit: str

    @property
    def passed(self):
        return bool(self.value <= self.bound)


class Bench:
    """What all cases share: a pipeline in float32, the noise of both stages, and what it makes of that.

    `quick`: fewer steps and textures; `minutes` of the stream; after `limit` seconds a worker is taken for stuck.
    """

    def __init__(self, pipe, seed=0, quick=False, minutes=10.0, limit=300.0):
        self.pipe, self.seed, self.quick, self.minutes, self.limit = pipe, seed, quick, minutes, limit
        config, hop = pipe.dale.config, pipe.lctg.config.latent_hop
        draw = torch.Generator().manual_seed(seed)
        self.noise = torch.randn(len(RATINGS), config.in_channels, config.latent_frames, generator=draw)
        self.decoder_noise = torch.randn(len(RATINGS), 1, config.latent_frames * hop, generator=draw)

    def generator(self):
        """A new generator of the seed."""
        return torch.Generator().manual_seed(self.seed)

    def copy(self):
        """Another pipeline of the same weights."""
        return copy.deepcopy(self.pipe)

    def make(self, pipe=None):
        """Textures of `RATINGS` by some pipeline, always from the same noise."""
        pipe = pipe or self.pipe
        made = pipe(RATINGS, latents=self.noise, output_type="latent")
        return pipe.decode(made.latents, made.level, made.friction_coefficient, noise=self.decoder_noise)

    @cached_property
    def reference(self):
        """What the float32 pipeline makes."""
        return self.make()

    def against(self, case, made, waveform, bands_db=SAME_DB, reference=None):
        """Rows: errors against the float32 reference, the worst of all textures."""
        reference = reference or self.reference
        bands = nine_band_error_db(made.textures, reference.textures, made.sampling_rate)
        level = DECIBEL * np.abs(made.level - reference.level)
        error = relative(made.textures, reference.textures)
        yield Row(case, "waveform, RMS of the error over RMS", error, waveform, "")
        yield Row(case, "nine-band error", float(np.max(bands)), bands_db, "dB")
        yield Row(case, "level", float(np.max(level)), bands_db, "dB")


def relative(made, reference):
    """RMS of the difference over RMS, the worst of all textures."""
    made, reference = np.asarray(made, dtype=np.float64), np.asarray(reference, dtype=np.float64)
    return float(np.max(rms(made - reference) / rms(reference)))


def level_error(out):
    """How far the RMS of textures is from their level, dB, the worst of all."""
    return float(np.max(np.abs(DECIBEL * (np.log(rms(out.textures)) - out.level))))


def not_finite(*arrays):
    """How many values are not finite."""
    return int(sum(np.sum(~np.isfinite(np.asarray(array))) for array in arrays))

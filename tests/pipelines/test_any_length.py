"""Any length: encoder and decoder are local in time, so long textures equal their pieces, and memory is bounded."""

import subprocess
import sys

import pytest
import torch

#: Latent frames of the tiny model (16 samples at 2.5 kHz) within reach of an end: the longest window of the features
#: reaches 128 samples, ten convolutions up to 10 frames.
ENCODER_EDGE = 20
#: Samples of 10 s at the working rate, a whole number of latent frames and of the decoder's coarsest stride (32).
TEN_SECONDS = 24_992
#: Memory in MB that decoding 60 s may take, one segment having been decoded: 7 to 39 were measured.
MEMORY_BOUND_MB = 100


@pytest.fixture
def waveform(pipe, pink_noise):
    """(1, TEN_SECONDS) whitened, at the working rate."""
    texture = pink_noise(4 * TEN_SECONDS, 10_000)
    return pipe.feature_extractor.normalize(texture, 10_000)[0]


def _encode(pipe, waveform):
    with torch.no_grad():
        return pipe.lctg.encode(torch.from_numpy(pipe.feature_extractor.features(waveform)))


def test_encoding_ten_seconds_equals_encoding_pieces(pipe, waveform):
    whole, hop, size = _encode(pipe, waveform), 16, 128
    for start in (0, 100, 700, TEN_SECONDS // hop - size):
        piece = _encode(pipe, waveform[:, start * hop : (start + size) * hop])
        inside = slice(ENCODER_EDGE, size - ENCODER_EDGE)
        # float32 sums of another length: rounding only
        torch.testing.assert_close(piece[..., inside], whole[..., start:][..., inside], rtol=0, atol=1e-5)
        if start == 100:  # at the ends a piece hears its own reflection: the margin is there for a reason
            assert (piece[..., :2] - whole[..., start : start + 2]).abs().max() > 1e-3


_PEAK = """
from pathlib import Path
import torch
from tactile_diffusers import TactileTexturePipeline, bundled_checkpoint

def megabytes(name):
    line = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith(name))
    return int(line.split()[1]) / 1024

torch.set_num_threads(1)
pipe = TactileTexturePipeline.from_pretrained(bundled_checkpoint())
config, rate = pipe.lctg.config, pipe.feature_extractor.sampling_rate
for frames in (config.segment_samples // config.latent_hop, 60 * rate // config.latent_hop):
    before = megabytes("VmRSS")
    Path("/proc/self/clear_refs").write_text("5")  # the peak starts anew
    pipe.decode(torch.zeros(1, config.latent_channels, frames), torch.tensor([-5.0]), num_inference_steps=1)
    print(megabytes("VmHWM") - before)
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="the peak is read from Linux's /proc")
def test_memory_of_a_minute_is_bounded():
    """Peak memory that decoding 60 s takes, once a segment has been decoded, in a process of its own."""
    done = subprocess.run([sys.executable, "-c", _PEAK], capture_output=True, text=True, check=True)
    _, minute = map(float, done.stdout.split())
    assert 0 < minute < MEMORY_BOUND_MB

"""PCM at a device's rate: in range, to scale, without gaps."""

import numpy as np
import pytest

from tactile_diffusers.export import PCM, PCMStream
from tactile_diffusers.playback import TextureProfile, TextureStream
from tactile_diffusers.signal import DEVICE_RATE, SEGMENT_SAMPLES, band_edges, band_levels_db


@pytest.fixture
def texture(pink_noise):
    return pink_noise(SEGMENT_SAMPLES, DEVICE_RATE)[0].astype(np.float32)


@pytest.fixture
def stream(texture):
    """A function: a stream over which a finger has been reported for a second at 80 mm/s."""

    def make(**options):
        made = TextureStream(TextureProfile(texture, DEVICE_RATE, 80.0), 0.6, 125, **options)
        times = np.arange(125) / 125
        places = 80 * times if made.dimensions == 1 else np.stack([80 * times, 0 * times], 1)
        for time, place in zip(times, places, strict=True):
            made.report(time, place)
        return made

    return make


@pytest.mark.parametrize("rate", [500, 2000, 8000.5, 44100])
def test_a_texture_at_any_rate(texture, rate):
    pcm = PCM.of_texture(texture, DEVICE_RATE, rate)
    assert pcm.samples.dtype == np.float32 and np.abs(pcm.samples).max() == 1 and pcm.sampling_rate == rate
    assert len(pcm.samples) == int(np.ceil(len(texture) / DEVICE_RATE * rate))
    edges = band_edges()
    edges = edges[edges < 0.45 * rate]
    levels = band_levels_db(pcm.samples * pcm.newtons_per_full_scale, rate, edges)
    np.testing.assert_allclose(levels, band_levels_db(texture, DEVICE_RATE, edges), atol=0.2)  # bins lie elsewhere


def test_blocks_are_the_whole_and_end_in_zeros(texture):
    pcm = PCM.of_texture(texture, DEVICE_RATE, 2000, full_scale=0.2)
    blocks = list(pcm.blocks(100))
    assert {len(block) for block in blocks} == {100}
    joined = np.concatenate(blocks)
    np.testing.assert_array_equal(joined[: len(pcm.samples)], pcm.samples)
    assert pcm.newtons_per_full_scale == 0.2 and not joined[len(pcm.samples) :].any()


def test_a_peak_above_full_scale_is_refused(texture):
    with pytest.raises(ValueError, match="above `full_scale` of 0.001 N, and would be clipped"):
        PCM.of_texture(texture, DEVICE_RATE, 2000, full_scale=0.001)
    with pytest.raises(ValueError, match="`device_rate` must be a finite number above 40"):
        PCM.of_texture(texture, DEVICE_RATE, 10)
    assert not PCM.of_texture(np.zeros(1000), DEVICE_RATE, 2000).samples.any()


@pytest.mark.parametrize("mean_friction", [False, True])
def test_a_stream_at_its_own_rate_comes_two_samples_later(stream, mean_friction):
    pcm = PCMStream(stream(), DEVICE_RATE, 1.0, mean_friction)
    found = np.concatenate([pcm.read(80) for _ in range(50)])
    other = stream()
    wanted = other.read(4000) if mean_friction else other.read_friction(4000)[0]
    np.testing.assert_allclose(found[2:], wanted[:-2], atol=1e-6)


@pytest.mark.parametrize("rate", [400, 2000, 3000.7, 48000])
def test_blocks_of_a_stream_do_not_depend_on_their_length(stream, rate):
    whole, parts = PCMStream(stream(), rate, 0.5), PCMStream(stream(), rate, 0.5)
    count = int(0.5 * rate)
    wanted = whole.read(count)
    found = [parts.read(part) for part in [1, 2, 3, *[17] * ((count - 6) // 17)]]
    np.testing.assert_allclose(np.concatenate(found), wanted[: sum(map(len, found))], atol=1e-6)
    assert parts.stream.time <= sum(map(len, found)) / rate + 3 / DEVICE_RATE  # it does not run ahead


def test_what_the_rate_holds_is_kept_and_the_rest_is_filtered(stream):
    rate, edges = 1000.0, np.array([40.0, 100.0, 200.0, 380.0])
    pcm = PCMStream(stream(), rate, 0.5)
    found = pcm.newtons_per_full_scale * np.concatenate([pcm.read(50) for _ in range(18)])
    wanted = stream().read_friction(9000)[0]
    levels = band_levels_db(found[200:], rate, edges) - band_levels_db(wanted[2000:], DEVICE_RATE, edges)
    assert np.abs(levels).max() < 0.5  # ripple, and windows that do not lie alike


def test_clipping_is_warned_of_once(stream, recorded_warnings):
    pcm = PCMStream(stream(), 2000, 1e-4)
    with recorded_warnings() as found:
        blocks = [pcm.read(400) for _ in range(3)]
    assert len(found) == 1 and "beyond the full scale of 0.0001 N" in found[0]
    assert np.abs(blocks).max() == 1 and pcm.clipped > 100


def test_bad_arguments_are_refused(stream):
    for arguments, message in (
        ((stream(), 0, 1.0), "`device_rate` must be"),
        ((stream(), 2000, 0), "`full_scale` must be"),
        (("stream", 2000, 1.0), "`stream` must be a TextureStream"),
        ((stream(dimensions=2), 2000, 1.0, True), "PCM has one channel"),
    ):
        with pytest.raises(ValueError, match=message):
            PCMStream(*arguments)
    assert len(PCMStream(stream(dimensions=2), 2000, 1.0).read(10)) == 10

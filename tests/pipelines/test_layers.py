"""The pipeline of a layered LCTG: generation from the base layer, reconstruction from both, band levels restored."""

import numpy as np
import pytest
import torch
from scipy import signal

from tactile_diffusers import TactileTexturePipeline, VDDIMScheduler

LAYERED = {"feature_channels": 28, "latent_channels": 6, "detail_channels": 2, "level_bands": 1}
EXTRACTOR = {"detail_samples": 2, "level_bands": 1}
RATINGS = [1.5, None, -1.0]


@pytest.fixture
def make_layered(make_lctg, make_dale, make_extractor):
    """`make_layered(dale=True)`: DALE makes the four channels of the base layer."""

    def make(dale=True):
        pipe = TactileTexturePipeline(
            lctg=make_lctg(0, **LAYERED),
            feature_extractor=make_extractor(**EXTRACTOR),
            scheduler=VDDIMScheduler(),
            dale=make_dale(1) if dale else None,
            dale_scheduler=VDDIMScheduler() if dale else None,
        )
        pipe.set_progress_bar_config(disable=True)
        return pipe

    return make


@pytest.fixture
def layered(make_layered):
    return make_layered()


def test_generated_latents_have_no_detail(layered, seeded):
    made = layered(RATINGS, num_inference_steps=3, generator=seeded(3), output_type="latent")
    assert made.latents.shape == (1, 6, 32)
    assert (made.latents[:, :4].std((0, 2)) > 0.05).all() and not made.latents[:, 4:].any()


@pytest.fixture
def untrained(make_lctg, make_extractor):
    """Four samples of the low end for each latent frame, up to 312 Hz, and a decoder that makes nothing of its own."""
    pipe = TactileTexturePipeline(
        lctg=make_lctg(feature_channels=28, latent_channels=8, detail_channels=4),
        feature_extractor=make_extractor(detail_samples=4),
        scheduler=VDDIMScheduler(),
    )
    for parameter in pipe.lctg.decoder.conv_out.parameters():
        torch.nn.init.zeros_(parameter)
    pipe.set_progress_bar_config(disable=True)
    return pipe


def _below(texture, cutoff_hz):
    sections = signal.butter(8, cutoff_hz, fs=10_000, output="sos")
    return signal.sosfiltfilt(sections, texture, axis=-1)


def _scaled_snr_db(made, real):
    """In dB, after the one gain that fits best: a level counts for all frequencies, whether they are kept or not."""
    gain = (made * real).sum(-1, keepdims=True) / np.square(made).sum(-1, keepdims=True)
    return 10 * np.log10(np.square(real).mean(-1) / np.square(gain * made - real).mean(-1))


@pytest.mark.parametrize("samples", [2048, 8192], ids=["one window", "fused windows"])
def test_the_low_end_of_a_recording_comes_back_by_itself(untrained, pink_noise, seeded, samples):
    texture = pink_noise(samples, 10_000, count=3)
    # one step goes from the noise to what the velocity points at: nothing of the noise is left
    made = untrained.reconstruct(texture, 10_000, num_inference_steps=1, generator=seeded(0)).textures
    inside = slice(400, -400)  # pulses of 64 ms at both ends, where mirroring makes up a part
    snr = _scaled_snr_db(*(_below(textures, 200)[:, inside] for textures in (made, texture)))
    assert (snr > 25).all()
    # what lies above is the decoder's to make, and this one makes nothing
    high = [np.square(textures - _below(textures, 450))[:, inside].mean() for textures in (made, texture)]
    assert high[0] < 0.01 * high[1]


def _four_levels(make_lctg, make_extractor):
    """Latents: 4 band levels, 2 learned channels of the base layer, 2 of the detail layer."""
    pipe = TactileTexturePipeline(
        lctg=make_lctg(**LAYERED | {"feature_channels": 30, "latent_channels": 8, "level_bands": 3}),
        feature_extractor=make_extractor(**EXTRACTOR | {"level_bands": 3}),
        scheduler=VDDIMScheduler(),
    )
    pipe.set_progress_bar_config(disable=True)
    return pipe


def test_band_levels_of_a_recording_are_restored(make_lctg, make_extractor, pink_noise, seeded):
    pipe = _four_levels(make_lctg, make_extractor)
    extractor, texture = pipe.feature_extractor, pink_noise(8192, 10_000, count=4, exponent=2.0)

    def measured(textures):
        levels = extractor.band_levels(extractor.normalize(textures, 10_000)[0])[:, :3]
        return levels - levels.mean(1, keepdims=True)

    made = pipe.encode(texture, 10_000)
    restored = pipe.decode(made.latents, made.level, None, 3, seeded(0)).textures
    pipe.lctg.band_levels = lambda latents: None  # not restored
    left = pipe.decode(made.latents, made.level, None, 3, seeded(0)).textures
    errors = [np.abs(measured(textures) - measured(texture)).mean() for textures in (left, restored)]
    assert errors[0] > 1 and errors[1] < 0.3 * errors[0]  # an untrained decoder, and gains that are slow


@pytest.mark.parametrize(
    ("lctg", "extractor", "message"),
    [
        ({"level_bands": 0, "feature_channels": 26}, {}, "`feature_channels` = 28"),
        ({}, {"level_bands": 0}, "`feature_channels` = 26"),
        ({"level_bands": 2, "latent_channels": 7}, {}, "`level_bands` = 1"),
        ({"detail_channels": 4, "latent_channels": 8}, {}, "`detail_channels` = 2"),
        ({}, {"frame_multiple": 4}, "`latent_hop` = 32"),
    ],
)
def test_layers_of_another_extractor_are_refused(make_lctg, make_extractor, lctg, extractor, message):
    models = {"lctg": make_lctg(**LAYERED | lctg), "feature_extractor": make_extractor(**EXTRACTOR | extractor)}
    with pytest.raises(ValueError, match=f"`feature_extractor` does not fit `lctg`: it asks for {message}, .* belong"):
        TactileTexturePipeline(**models, scheduler=VDDIMScheduler())


def test_modulation_gain_is_restored_in_what_is_generated_and_not_in_recordings(layered, pink_noise, seeded, tmp_path):
    texture = pink_noise(8192, 10_000)
    before = [
        layered(RATINGS, generator=seeded(0)).textures,
        layered.reconstruct(texture, 10_000, 2, seeded(0)).textures,
    ]
    layered.lctg.register_to_config(modulation_gains=[1.6, 1.0])
    layered.save_pretrained(tmp_path)
    kept = TactileTexturePipeline.from_pretrained(tmp_path)
    kept.set_progress_bar_config(disable=True)
    after = [kept(RATINGS, generator=seeded(0)).textures, kept.reconstruct(texture, 10_000, 2, seeded(0)).textures]
    np.testing.assert_array_equal(after[1], before[1])
    assert np.abs(after[0] - before[0]).max() > 0.01 * np.abs(before[0]).max()

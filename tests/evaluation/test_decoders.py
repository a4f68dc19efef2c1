"""What stands beside LCTG: itself without its network and without restored levels, and the rates of both."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from report.sections import QUICK, make_context
from report.sections.decoders import measure_decoders
from report.sections.reconstruction import pair_metrics
from report.stand_ins import NoNetwork, NothingImposed, used_channels, with_stand_in

from tactile_diffusers import TactileTexturePipeline, VDDIMScheduler
from tactile_diffusers.evaluation.metrics.distances import kernel_tactile_distance
from tactile_diffusers.features.low_band import sample_low_band, synthesize
from tactile_diffusers.signal import rms

SETTINGS = replace(QUICK, steps=(1,), per_surface=2, repeats=1)


@pytest.fixture
def layered(make_lctg, make_extractor):
    """A pipeline with random weights whose latents hold levels of four bands and above, four learned channels and the
    low end of the waveform."""
    pipe = TactileTexturePipeline(
        lctg=make_lctg(segment_samples=2048, feature_channels=31, latent_channels=11, level_bands=4, detail_channels=2),
        feature_extractor=make_extractor(level_bands=4, detail_samples=2),
        scheduler=VDDIMScheduler(),
    )
    pipe.set_progress_bar_config(disable=True)
    return pipe


@pytest.fixture
def texture(pink_noise):
    return pink_noise(8192, 10_000, count=2)


def test_no_network_is_the_stored_low_end_and_the_noise_above_it(layered, texture):
    encoded, noise = (
        layered.encode(texture, 10_000),
        torch.randn(2, 1, 2048, generator=torch.Generator().manual_seed(0)),
    )
    decoded = with_stand_in(layered, NoNetwork).decode(encoded.latents, encoded.level, None, 1, noise=noise)
    stored = encoded.latents[:, 9:].transpose(1, 2).flatten(1)
    waveform = synthesize(stored, 8) + noise - synthesize(torch.from_numpy(sample_low_band(noise[:, 0], 8)).float(), 8)
    levels = encoded.latents[:, :5]
    expected = layered.feature_extractor.denormalize(waveform[:, 0], encoded.level, None, levels)
    # float32
    np.testing.assert_allclose(decoded.textures, expected, atol=1e-4 * rms(expected).max())
    base = encoded.latents.clone()
    base[:, 9:] = 0
    decoded = with_stand_in(layered, NoNetwork).decode(base, encoded.level, None, 1, noise=noise)
    expected = layered.feature_extractor.denormalize(noise[:, 0], encoded.level, None, levels)
    np.testing.assert_allclose(decoded.textures, expected, atol=1e-4 * rms(expected).max())


def test_nothing_imposed_is_what_the_network_decodes(layered, texture):
    encoded, noise = (
        layered.encode(texture, 10_000),
        torch.randn(2, 1, 2048, generator=torch.Generator().manual_seed(0)),
    )
    bare = with_stand_in(layered, NothingImposed)
    layered.feature_extractor.denormalize = lambda waveform, *rest, **restored: (
        waveform.numpy()
    )  # before anything is restored
    ours, others = (pipe.decode(encoded.latents, encoded.level, None, 2, noise=noise) for pipe in (layered, bare))
    assert np.array_equal(ours.textures, others.textures)
    assert bare.lctg.band_levels(encoded.latents) is None is not layered.lctg.band_levels(encoded.latents)


def test_real_textures_in_another_order_are_no_other_set(layered, prepared, tmp_path):
    data = make_context(layered, prepared, "test", SETTINGS, 0, tmp_path).data
    order = np.roll(np.arange(len(data.surfaces)), 3)
    shuffled = pair_metrics(data, data.real[order], data.points[order], data.surfaces[order])
    own = data.distances["ktd"]["mean"]
    assert shuffled["ktd"]["mean"] == pytest.approx(own, abs=1e-9 * abs(own))  # sums in another order
    assert shuffled["nine_band_db"]["mean"] > 0.1


def test_rows_without_a_part_stand_beside_lctg(layered, prepared, tmp_path):
    context = make_context(layered, prepared, "test", SETTINGS, 0, tmp_path)
    found = measure_decoders(context, lambda *made: pair_metrics(context.data, *made))
    rows, noisy, network = found["decoders"], found["equal_rate"], found["network"]
    names = {"lctg", "no_network", "nothing_imposed"}
    assert set(rows) == names | {f"{name}_base" for name in names}
    assert set(noisy) == {"lctg", "no_network", "lctg_base", "no_network_base"}
    # random weights are far off, restored levels are not, whoever made the waveform
    assert rows["nothing_imposed"]["nine_band_db"]["mean"] > 2 * rows["no_network"]["nine_band_db"]["mean"]
    assert rows["no_network"]["snr_db"]["mean"] > 1 > -2 > rows["no_network_base"]["snr_db"]["mean"]
    for layers, suffix in (("all_layers", ""), ("base_layer", "_base")):
        ours, others = rows["lctg" + suffix], rows["no_network" + suffix]
        for key in ("nine_band_db", "snr_db", "ktd"):
            difference = ours[key]["mean"] - others[key]["mean"]
            assert network[layers][key]["mean"] == pytest.approx(difference, abs=1e-9), (layers, key)
        ours, others = noisy["lctg" + suffix], noisy["no_network" + suffix]
        assert ours["kilobits_per_second"] == others["kilobits_per_second"]
        # fewer channels, so less noise, for as many bits
        assert 0 < others["sigma"]["mean"] < ours["sigma"]["mean"] == pytest.approx(layered.lctg.config.latent_noise)
    assert noisy["lctg"]["snr_db"]["mean"] != rows["lctg"]["snr_db"]["mean"]
    again = measure_decoders(context, lambda *made: pair_metrics(context.data, *made))
    assert again["equal_rate"] == noisy  # noise comes from the evaluation's seed


def test_equal_rate_is_shannons_over_the_channels_that_are_read(layered, prepared, tmp_path):
    """The formula again: 1/2 log2(1 + variance / sigma^2) bits a number, one number a channel and frame."""
    context = make_context(layered, prepared, "test", SETTINGS, 0, tmp_path)
    noisy = measure_decoders(context, lambda *made: {})["equal_rate"]
    textures = context.data.training.textures
    variance = layered.encode(textures, context.data.rate).latents.double().numpy().var((0, 2))
    for name, channels in (("lctg", range(11)), ("no_network", [*range(5), 9, 10]), ("no_network_base", range(5))):
        bits = 2500 / 16 * 0.5 * np.log2(1 + variance[list(channels)] / noisy[name]["sigma"]["mean"] ** 2).sum()
        assert noisy[name]["kilobits_per_second"]["mean"] == pytest.approx(bits / 1000, rel=1e-4)  # float32 latents


def test_what_has_no_layers_has_no_rows_of_them(evaluable_pipe, prepared, tmp_path):
    pipe = evaluable_pipe(dale=False)
    context = make_context(pipe, prepared, "test", SETTINGS, 0, tmp_path)
    found = measure_decoders(context, lambda *made: {})
    assert list(found["decoders"]) == ["lctg", "no_network"] and list(found["network"]) == ["all_layers"]
    assert list(found["equal_rate"]) == ["lctg"]  # white noise at the right level carries nothing else
    assert used_channels(with_stand_in(pipe, NoNetwork).lctg, "all_layers") == []


def test_paired_distance_is_the_difference_of_two(layered, prepared, tmp_path):
    data = make_context(layered, prepared, "test", SETTINGS, 0, tmp_path).data
    louder = data.reference.embed(2 * data.real)
    paired = data.reference.paired_ktd(louder, data.points, data.surfaces)
    distances = [
        kernel_tactile_distance(
            points, data.reference.points, data.reference.embedding.width, data.surfaces, data.training.surface_ids
        )
        for points in (louder, data.points)
    ]
    assert paired["mean"] == pytest.approx(distances[0] - distances[1])
    assert data.reference.paired_ktd(data.points, data.points, data.surfaces)["mean"] == 0

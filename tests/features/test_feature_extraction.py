"""`TactileFeatureExtractor`: what the encoder hears, and the way back to newtons."""

import itertools

import numpy as np
import pytest
import torch

from tactile_diffusers import TactileFeatureExtractor
from tactile_diffusers.features.filterbank import FILTER_SCALES, filterbank
from tactile_diffusers.signal import BAND_HZ, DEVICE_RATE, level, power_spectral_density, resample, rms
from tactile_diffusers.training.fitting import fit_preemphasis


@pytest.fixture
def extractor():
    return TactileFeatureExtractor()


# --- features


@pytest.mark.parametrize("samples", [16384, 16383, 3, 500])
def test_shapes(extractor, pink_noise, samples):
    texture = np.random.default_rng(0).normal(size=(3, samples)) * 0.01
    made = extractor(texture, DEVICE_RATE)
    frames = made["input_features"].shape[-1]
    assert made["input_features"].shape == (3, extractor.feature_size, frames)
    assert frames % extractor.frame_multiple == 0
    working_samples = int(np.ceil(samples / 4))
    assert 0 <= frames * extractor.hop_length - working_samples < extractor.hop_length * extractor.frame_multiple
    assert made["input_features"].dtype == np.float32 and made["level"].dtype == np.float32
    assert np.isfinite(made["input_features"]).all()


def test_a_segment_gives_the_frames_of_the_default_models(extractor):
    features = extractor(np.ones(16384), DEVICE_RATE)["input_features"]
    assert features.shape == (1, 87, 128)


def test_silence_has_no_nan(extractor):
    made = extractor(np.zeros((2, 16384)), DEVICE_RATE)
    assert np.isfinite(made["input_features"]).all() and np.isfinite(made["level"]).all()
    waveform, levels = extractor.normalize(np.zeros((1, 16384)), DEVICE_RATE)
    assert not waveform.any()
    back = extractor.denormalize(waveform, levels)
    assert np.isfinite(back).all() and not back.any()


def test_rows_do_not_depend_on_the_rest_of_the_batch(make_extractor, pink_noise):
    extractor = make_extractor()
    textures = pink_noise(8192, DEVICE_RATE, count=4, seed=1) * np.array([[1e-4], [1.0], [0.0], [1e3]])
    together = extractor(textures, DEVICE_RATE)
    for row, texture in enumerate(textures):
        alone = extractor(texture, DEVICE_RATE)
        # computed in float64 and stored in float32: only matrix products of another size may round differently
        np.testing.assert_allclose(together["input_features"][row], alone["input_features"][0], rtol=0, atol=1e-6)
        assert together["level"][row] == alone["level"][0]


def test_numpy_and_torch_input_give_the_same_numbers(extractor, pink_noise):
    texture = pink_noise(16384, DEVICE_RATE, count=2).astype(np.float32)
    from_numpy = extractor(texture, DEVICE_RATE)
    from_torch = extractor(torch.from_numpy(texture), DEVICE_RATE, return_tensors="pt")
    from_graph = extractor(torch.from_numpy(texture).requires_grad_(), DEVICE_RATE)
    from_list = extractor(texture.astype(np.float64).tolist(), DEVICE_RATE)
    for name in ("input_features", "level"):
        assert isinstance(from_torch[name], torch.Tensor)
        assert np.array_equal(from_numpy[name], from_torch[name].numpy())
        assert np.array_equal(from_numpy[name], from_graph[name])
        assert np.array_equal(from_numpy[name], from_list[name])


def test_scaling_a_texture_changes_its_level_and_nothing_else(extractor, pink_noise):
    texture = pink_noise(16384, DEVICE_RATE)
    quiet, loud = extractor(texture, DEVICE_RATE), extractor(texture * 8, DEVICE_RATE)  # a power of two: exact
    np.testing.assert_allclose(loud["input_features"], quiet["input_features"], rtol=0, atol=1e-6)  # float32
    assert loud["level"] - quiet["level"] == pytest.approx(np.log(8), abs=1e-6)
    # the two filters of a change of rate pass the band but for 0.01 %, and the ends ring
    assert quiet["level"] == pytest.approx(np.log(0.01), abs=5e-4)


def test_a_tone_excites_the_filter_of_its_frequency():
    extractor = TactileFeatureExtractor(level_bands=0, envelope_samples=0)
    corners = np.geomspace(*BAND_HZ, extractor.num_filters + 2)
    time = np.arange(16384) / DEVICE_RATE
    for frequency in (40.0, 120.0, 330.0, 800.0):
        features = extractor(np.sin(2 * np.pi * frequency * time), DEVICE_RATE)["input_features"]
        loudest = features[0, : extractor.num_filters, 32:96].mean(-1).argmax()
        # a long window's bins are 4.9 Hz apart: the lowest filters overlap more than they ask for
        low, high = min(corners[loudest], frequency - 5), max(corners[loudest + 2], frequency + 5)
        assert low <= frequency <= high and corners[loudest] - 5 <= frequency <= corners[loudest + 2] + 5


# --- filters


@pytest.mark.parametrize(
    ("scale", "sampling_rate", "windows"),
    list(itertools.product(FILTER_SCALES, [2200, 2500, 10_000], [(128, 512), (64,), (256, 1024, 2048), (512, 128)])),
)
def test_no_filter_is_empty(scale, sampling_rate, windows):
    banks = filterbank(sampling_rate, BAND_HZ, 48, windows, scale)
    assert [bank.shape for bank in banks] == [(48, length // 2 + 1) for length in windows]
    stacked = np.concatenate(banks, axis=1)
    assert (stacked >= 0).all()
    np.testing.assert_allclose(stacked.sum(1), 1.0, rtol=1e-12)  # a sum of a few float64
    in_use = np.stack([bank.any(1) for bank in banks])
    assert (in_use.sum(0) == 1).all()  # each filter lives on one window


def test_scales_are_those_of_the_field():
    import librosa

    for scale, corners in (
        ("slaney", librosa.mel_frequencies(50, fmin=20, fmax=1000, htk=False)),
        ("log", np.geomspace(20, 1000, 50)),
    ):
        [bank] = filterbank(2500, BAND_HZ, 48, (4096,), scale)
        centroids = bank @ np.arange(bank.shape[1]) * 2500 / 4096
        # the centroid of a triangle is the mean of its corners; one bin is 0.6 Hz
        np.testing.assert_allclose(centroids, (corners[:-2] + corners[1:-1] + corners[2:]) / 3, atol=0.6)


# --- there and back


@pytest.mark.parametrize(
    ("sampling_rate", "samples"),
    [(10_000, 16384), (10_000, 16381), (10_000, 12345), (2500, 4096), (2500, 4095), (2200, 4401), (2200, 3604)],
)
def test_normalize_and_denormalize_are_inverse_in_the_interior(make_extractor, pink_noise, sampling_rate, samples):
    extractor = make_extractor()
    texture = pink_noise(samples, sampling_rate, count=3, seed=samples, band=(30.0, 900.0))
    waveform, levels = extractor.normalize(texture, sampling_rate)
    assert waveform.shape[-1] % (extractor.hop_length * extractor.frame_multiple) == 0
    wanted = resample(texture, sampling_rate, DEVICE_RATE)
    back = extractor.denormalize(waveform, levels, samples=round(samples * DEVICE_RATE / sampling_rate))
    # The whitening filter rings for two periods of the lowest edge, 0.1 s: the ends, which were made up, are left out.
    # Inside, the RMS of those ends moves the gain (checked on its own), and the low end of the ring and the 0.01 %
    # ripple of two anti-alias filters leave errors 50 dB down (measured: 51 to 72 dB).
    inside = slice(1000, back.shape[-1] - 1000)
    reference, back = wanted[:, inside], back[:, inside]
    gain = (back * reference).sum(-1, keepdims=True) / (back * back).sum(-1, keepdims=True)
    np.testing.assert_allclose(gain, 1.0, atol=0.02)
    error = np.square(back * gain - reference).mean(-1)
    assert (10 * np.log10(np.square(reference).mean(-1) / error) > 48).all()


def test_level_is_exact(make_extractor, pink_noise):
    extractor = make_extractor()
    texture = pink_noise(16384, DEVICE_RATE, count=3) * np.array([[0.1], [1.0], [7.0]])
    waveform, levels = extractor.normalize(texture, DEVICE_RATE)
    np.testing.assert_allclose(levels, level(resample(texture, DEVICE_RATE, 2500)), rtol=1e-6)  # float32
    np.testing.assert_allclose(levels, level(texture), rtol=0, atol=5e-4)  # nothing of it lies above 900 Hz
    for samples in (None, 16384, 5001):
        back = extractor.denormalize(waveform, levels, samples)
        np.testing.assert_allclose(rms(back), np.exp(levels), rtol=2e-6)  # float32 samples
        assert back.dtype == np.float32 and abs(back.mean(-1)).max() < 1e-6 * rms(back).max()
    wanted = np.array([-6.0, -5.0, -3.5], dtype=np.float32)
    np.testing.assert_allclose(level(extractor.denormalize(waveform, wanted)), wanted, rtol=1e-6)


# --- whitening


@pytest.mark.parametrize("exponent", [0.5, 1.0])
def test_fitted_preemphasis_flattens_the_spectrum(pink_noise, exponent):
    textures = pink_noise(16384, DEVICE_RATE, count=40, exponent=exponent, band=BAND_HZ)
    frequencies, gains = fit_preemphasis(textures, DEVICE_RATE)
    assert min(gains) == 0 and max(gains) <= 30 and len(gains) == len(frequencies) == 33
    extractor = TactileFeatureExtractor(preemphasis_frequencies=frequencies, preemphasis_db=gains)
    whitened, _ = extractor.normalize(textures, DEVICE_RATE)
    bins, density = power_spectral_density(whitened, 2500)
    flat = 10 * np.log10(density.mean(0))[(bins >= 40) & (bins <= 900)]
    # 40 textures x 15 windows leave 0.2 dB of noise on a bin, 33 points of interpolation another few tenths
    assert flat.std() < 0.6 and np.ptp(flat) < 4
    before = 10 * np.log10(power_spectral_density(textures, DEVICE_RATE)[1].mean(0))
    assert np.ptp(before[(bins_of(before) >= 40) & (bins_of(before) <= 900)]) > 10


def bins_of(density):
    return np.arange(len(density)) * 5.0  # windows of 0.2 s


def test_preemphasis_is_clipped_and_ignores_silence(pink_noise):
    textures = pink_noise(16384, DEVICE_RATE, count=10, exponent=2.0, band=BAND_HZ)
    frequencies, gains = fit_preemphasis(textures, DEVICE_RATE, clip_db=12.0)
    assert max(gains) == 12 and min(gains) == 0
    with_silence = np.concatenate([textures, np.zeros((3, 16384))])
    assert fit_preemphasis(with_silence, DEVICE_RATE, clip_db=12.0) == (frequencies, gains)


# --- save and load


@pytest.mark.parametrize("scale", FILTER_SCALES)
def test_save_and_load(make_extractor, pink_noise, tmp_path, scale, recorded_warnings):
    extractor = make_extractor(filter_scale=scale)
    with recorded_warnings() as found:
        extractor.save_pretrained(tmp_path)
        loaded = TactileFeatureExtractor.from_pretrained(tmp_path)
    assert not found
    texture = pink_noise(16384, DEVICE_RATE, count=2)
    before, after = extractor(texture, DEVICE_RATE), loaded(texture, DEVICE_RATE)
    for name in ("input_features", "level"):
        assert np.array_equal(before[name], after[name])
    waveform, levels = extractor.normalize(texture, DEVICE_RATE)
    assert np.array_equal(extractor.denormalize(waveform, levels), loaded.denormalize(waveform, levels))
    assert loaded.to_dict() == TactileFeatureExtractor.from_dict(loaded.to_dict()).to_dict()


# --- bad input


@pytest.mark.parametrize(
    ("texture", "sampling_rate", "message"),
    [
        (np.ones(100), None, "`sampling_rate` is missing"),
        (np.ones(100), 1000, "`sampling_rate` must be at least 2000"),
        (np.ones(100), 0, "`sampling_rate`"),
        (np.ones(100), -10_000, "`sampling_rate`"),
        (np.ones(100), float("nan"), "`sampling_rate`"),
        (np.ones(100), 2500.5, "`sampling_rate`"),
        (np.ones(0), DEVICE_RATE, "`texture` must be .* not empty"),
        (
            np.ones((100, 1)),
            DEVICE_RATE,
            r"got \(100, 1\): more textures than samples. Transpose it, or pass one column",
        ),
        (np.ones((100, 3)), DEVICE_RATE, "more textures than samples"),
        (np.ones((0, 100)), DEVICE_RATE, "`texture` must be"),
        (np.ones((1, 1, 100)), DEVICE_RATE, "`texture` must be"),
        (np.float64(1.0), DEVICE_RATE, "`texture` must be"),
        (
            np.array([[0.0, 1.0], [np.nan, 1.0]]),
            DEVICE_RATE,
            r"`texture` has NaN or infinite samples in row\(s\) \[1\]",
        ),
        (np.array([0.0, np.inf]), DEVICE_RATE, "`texture` has NaN or infinite"),
    ],
)
def test_bad_textures_are_refused(extractor, texture, sampling_rate, message):
    with pytest.raises(ValueError, match=message):
        extractor(texture, sampling_rate)


@pytest.mark.parametrize(
    ("config", "message"),
    [
        ({"feature_size": 81}, "`feature_size` must be 87, the sum of .*, got 81"),
        ({"filter_scale": "bark"}, "`filter_scale` must be one of"),
        ({"band": (0, 1000)}, "`band` must satisfy"),
        ({"band": (20, 1250)}, "`band` must satisfy"),
        ({"preemphasis_db": [0.0]}, "`preemphasis_frequencies` and `preemphasis_db`"),
        ({"preemphasis_db": [0.0], "preemphasis_frequencies": [20.0, 30.0]}, "`preemphasis_frequencies`"),
        ({"preemphasis_frequencies": [100.0, 20.0], "preemphasis_db": [0.0, 3.0]}, "`preemphasis_frequencies`"),
        ({"preemphasis_frequencies": [], "preemphasis_db": []}, "`preemphasis_frequencies`"),
        ({"preemphasis_frequencies": [0.0, 20.0], "preemphasis_db": [0.0, 3.0]}, "`preemphasis_frequencies`"),
        ({"window_lengths": ()}, "`window_lengths`"),
        ({"hop_length": 0}, "`hop_length`"),
        ({"window_lengths": (16,)}, "`window_lengths`"),
    ],
)
def test_bad_configs_are_refused(config, message):
    with pytest.raises(ValueError, match=message):
        TactileFeatureExtractor(**config)


def test_a_fixed_scale_keeps_the_level_in_waveform_and_features(make_extractor, pink_noise):
    extractor, textures = make_extractor(fixed_scale=0.02), pink_noise(16384, 10_000, count=2)
    textures[1] *= 10
    (quiet, loud), levels = extractor.normalize(textures, 10_000)
    plain, plain_levels = make_extractor().normalize(textures, 10_000)
    np.testing.assert_allclose(levels, plain_levels)
    assert np.std(loud) / np.std(plain[1]) > 2 * np.std(quiet) / np.std(plain[0]) and np.std(plain) == pytest.approx(1)
    features = extractor.features(np.stack([quiet, 10 * quiet]))
    assert np.diff(features, axis=0).mean() == pytest.approx(2, abs=0.1)  # 20 dB, but for the floor
    # whatever level is asked for, the textures come back as they were
    made = extractor.denormalize(np.stack([quiet, loud]), np.zeros(2), samples=16384)
    inside = slice(1000, -1000)  # the ends are mirrored
    assert (np.abs(made - textures)[:, inside] < 0.02 * np.abs(textures).max(-1, keepdims=True)).all()
    assert TactileFeatureExtractor.from_dict(extractor.to_dict()).fixed_scale == 0.02


@pytest.mark.parametrize("scale", [0, -1.0, np.nan, "loud", True])
def test_a_fixed_scale_is_a_positive_number(make_extractor, scale):
    with pytest.raises(ValueError, match="`fixed_scale` must be a finite number above 0 in N"):
        make_extractor(fixed_scale=scale)

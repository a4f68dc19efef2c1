"""Errors of single textures: known answers."""

import numpy as np
import pytest

from tactile_diffusers.evaluation import (
    goodness_of_fit,
    level_error_db,
    log_spectral_distance_db,
    rmse,
    signed_band_error_db,
    snr_db,
)
from tactile_diffusers.signal import DEVICE_RATE, rms

BANDS = ((20, 60), (60, 150), (400, 650), (650, 1000), (1000, 1200))


def test_silence_has_zero_snr_and_the_rms_of_the_reference_as_error(held_out):
    silence = np.zeros_like(held_out)
    np.testing.assert_allclose(snr_db(silence, held_out), 0)
    np.testing.assert_allclose(rmse(silence, held_out), rms(held_out))
    assert (goodness_of_fit(silence, held_out, DEVICE_RATE) == 0).all()
    assert (log_spectral_distance_db(silence, held_out, DEVICE_RATE) > 100).all()


def test_snr_and_rmse_of_noise_at_a_tenth(held_out):
    noise = np.random.default_rng(5).normal(size=held_out.shape)
    noise *= 0.1 * rms(held_out)[:, None] / rms(noise)[:, None]
    np.testing.assert_allclose(snr_db(held_out + noise, held_out), 20)
    np.testing.assert_allclose(rmse(held_out + noise, held_out), 0.1 * rms(held_out))


def test_goodness_of_fit_is_its_formula(held_out):
    from scipy.signal import welch

    first, second = (
        np.sqrt(welch(texture, fs=DEVICE_RATE, nperseg=2000)[1][4:201])
        for texture in held_out[:2]  # 20 to 1000 Hz
    )
    expected = abs(first @ second) / np.sqrt((first @ first) * (second @ second))
    assert goodness_of_fit(held_out[0], held_out[1], DEVICE_RATE) == pytest.approx(expected)


def test_batches_and_single_textures_agree(held_out):
    textures, references = held_out[:4].reshape(2, 2, -1), held_out[4:8].reshape(2, 2, -1)
    for metric in (
        rmse,
        snr_db,
        level_error_db,
        lambda a, b: log_spectral_distance_db(a, b, DEVICE_RATE),
        lambda a, b: goodness_of_fit(a, b, DEVICE_RATE),
        lambda a, b: signed_band_error_db(a, b, DEVICE_RATE, BANDS),
    ):
        batch = metric(textures, references)
        assert batch.shape[:2] == (2, 2)
        np.testing.assert_allclose(batch[1, 0], metric(textures[1, 0], references[1, 0]))
        np.testing.assert_allclose(metric(textures.astype(np.float32), references), batch, rtol=1e-4, atol=1e-4)


def test_bad_input_is_refused(held_out):
    texture = held_out[0]
    bad = np.where(np.arange(len(texture)) == 3, np.nan, texture)
    for refused, message in (
        (lambda: snr_db(texture, bad), r"`reference` must be finite, got nan at index \[3\]"),
        (lambda: rmse(texture, texture[::4]), "same shape.*Bring both to one sampling rate"),
        (lambda: signed_band_error_db(texture, texture, 2500, [(1000, 1300)]), "`bands` must lie inside"),
        (lambda: log_spectral_distance_db(texture[:4], texture[:4], DEVICE_RATE, band=(20, 30)), "no frequency bin"),
        (lambda: rmse(texture * 1j, texture), "must hold real numbers, got dtype complex128"),
        (lambda: rmse(texture[:0], texture[:0]), "not be empty"),
    ):
        with pytest.raises(ValueError, match=message):
            refused()

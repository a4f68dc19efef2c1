"""The studio: answers with the bundled checkpoint, their files, pictures and sounds."""

import base64
import io
import json
import re
import threading
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
import soundfile
import torch
from answers import comparison_answer, reconstruction_answer, texture_answer
from bands import nine_bands
from downloads import FORMATS, is_map, write_files
from settings import Settings
from sound import SOUND_RATE, SOUND_RMS, to_sound
from strip import strip_page

from tactile_diffusers import TactileTexturePipeline, bundled_checkpoint, export
from tactile_diffusers.playback import TextureProfile
from tactile_diffusers.signal import band_levels_db, rms

RATINGS = (1.0, 0.2, -0.8)


@pytest.fixture(scope="module")
def result(studio):
    return studio.generate([RATINGS], Settings(takes=2, seed=3))


def test_takes_are_those_of_the_pipeline(studio, result):
    assert [texture.seed for texture in result.textures] == [3, 4]
    alone = studio.generate([RATINGS], Settings(seed=4)).textures[0]
    np.testing.assert_allclose(alone.samples, result.textures[1].samples, atol=1e-5)
    assert alone.seconds == 1.6 and 0 < alone.friction_coefficient < 3 and np.isfinite(alone.estimated).all()


def test_more_steps_than_the_distilled_decoder_takes_are_the_teachers(studio):
    made = studio.generate([RATINGS], Settings(steps=5, order=2, seed=1)).textures[0]
    pipe = TactileTexturePipeline.from_pretrained(bundled_checkpoint())
    pipe.set_progress_bar_config(disable=True)
    out = pipe([list(RATINGS)], 5, duration_s=1.6, generator=torch.Generator().manual_seed(1))
    np.testing.assert_allclose(made.samples, out.textures[0], atol=1e-5)
    first_order = studio.generate([RATINGS], Settings(steps=5, order=1, seed=1)).textures[0]
    assert np.abs(first_order.samples - made.samples).max() > 1e-3


def test_visitors_at_once_get_what_each_would_get_alone(studio):
    wanted = {seed: studio.generate([RATINGS], Settings(seed=seed)).textures[0].samples for seed in (0, 1, 2)}
    found = {}

    def visit(seed):
        found[seed] = studio.generate([RATINGS], Settings(seed=seed, order=2)).textures[0].samples

    threads = [threading.Thread(target=visit, args=(seed,)) for seed in wanted]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for seed, samples in wanted.items():
        np.testing.assert_allclose(found[seed], samples, atol=1e-6)


def test_expected_bands_are_those_of_decoded_textures(studio):
    pipe = studio._pipeline(Settings())
    made = pipe([list(RATINGS)] * 4, generator=torch.Generator().manual_seed(0), output_type="latent")
    levels = pipe.lctg.band_levels(made.latents).double().numpy()
    expected = nine_bands(levels, made.level.double().numpy(), pipe.feature_extractor)
    out = pipe.decode(made.latents, made.level, generator=torch.Generator().manual_seed(0))
    found = band_levels_db(out.textures, out.sampling_rate)
    assert np.abs(expected - found).mean() < 1.0


def test_ranges_hold_the_textures_and_follow_the_ratings(studio, result):
    likely, training = result.likely, result.training
    assert (likely.low < likely.middle).all() and (likely.middle < likely.high).all()
    levels = band_levels_db(result.textures[0].samples, result.textures[0].sampling_rate)
    # a take may have a line of its own: one of the nine bands
    assert ((levels > likely.low - 6) & (levels < likely.high + 6)).sum() >= 8
    # ratings say something: their range is narrower than that of all surfaces
    assert (likely.high - likely.low).mean() < 0.8 * (training.high - training.low).mean()
    smooth = studio.generate([(-1.5, -0.5, 0.0)]).likely
    assert (smooth.middle < likely.middle - 3).all()


def test_answer_is_complete_html(studio, result):
    picture, sound, numbers, strip = texture_answer(result, 1, "percentile", studio.config)
    for text in (picture, sound, numbers, strip):
        HTMLParser().feed(text)
    png = base64.b64decode(re.search(r"base64,([^\"]+)", picture)[1])
    assert png[:4] == b"\x89PNG" and len(png) < 1_000_000
    # two dots of the picture for each of the page
    assert int.from_bytes(png[16:20]) == 2 * int(re.search(r'width="(\d+)"', picture)[1])
    assert "alt=" in picture and "listening only" in sound and "friction coefficient" in numbers
    assert texture_answer(result, 0, "percentile", studio.config)[0] != picture


def test_sound_has_one_loudness_whatever_the_texture(result):
    texture = result.textures[0]
    for gain in (1, 50):
        sound = to_sound(gain * texture.samples, texture.sampling_rate)
        assert rms(sound) == pytest.approx(SOUND_RMS, rel=1e-6) and np.abs(sound).max() <= 1
        assert len(sound) == pytest.approx(texture.seconds * SOUND_RATE, abs=1)
    assert np.isfinite(to_sound(np.zeros(1000), 10_000)).all()


def test_strip_holds_the_profile_and_nothing_from_elsewhere(result):
    texture = result.textures[0]
    page = strip_page(texture)
    assert "http" not in page and " src=" not in page
    data = json.loads(re.search(r"const DATA = (\{.*?\});", page)[1])
    found = np.frombuffer(base64.b64decode(data["profile"]), "<f4")
    profile = TextureProfile(texture.samples, texture.sampling_rate, texture.reference_speed)
    # what the stream reads at the reference speed is that profile through the band of what is felt
    place = np.arange(len(found)) * profile.pitch
    felt = profile.read(place, np.full(len(place), texture.reference_speed))
    spectrum = np.fft.rfft(found)
    frequencies = np.fft.rfftfreq(len(found), 1 / texture.sampling_rate)
    spectrum[(frequencies < 22) | (frequencies > 1100)] = 0
    # 20 % of the RMS: what lies between the edge here, a wall, and the slopes of the profile's filters
    assert rms(np.fft.irfft(spectrum) - felt) < 0.2 * rms(felt)
    assert data["friction"] == texture.friction_coefficient and data["pitch"] == profile.pitch


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_is_a_valid_file(result, tmp_path, name):
    texture = result.textures[0]
    paths, told = write_files(texture, name, tmp_path, 0.15)
    first = paths[0]
    assert first.name.startswith("texture_r1.00_b0.20_s-0.80_seed3.") and all(path.parent == tmp_path for path in paths)
    assert [text[:16] for text in told] == ["Pixels 0.15 mm a"] * is_map(name)  # what a friction map cannot hold
    for one in export.FORMATS.values():
        if first.name.endswith(f"seed3{one.suffix}"):
            assert one.read(first)[1]["checkpoint"] == Path(bundled_checkpoint()).name
    if first.suffix == ".npz":
        with np.load(first) as file:
            np.testing.assert_array_equal(file["texture"], texture.samples)
    elif first.suffix == ".wav":
        samples, rate = soundfile.read(io.BytesIO(first.read_bytes()))
        scale = json.loads(paths[1].read_text())["newtons_per_full_scale"]
        np.testing.assert_allclose(samples * scale, texture.samples, atol=scale / 2**15)
    else:
        assert first.stat().st_size > 500  # a friction map is a kilobyte


def test_pitch_of_a_map_is_the_display_s(result, tmp_path):
    name = next(filter(is_map, FORMATS))
    [path], told = write_files(result.textures[0], name, tmp_path, 0.03)
    assert export.FORMATS["png"].read(path)[1]["pixel_pitch"] == 0.03 and not told
    for bad in (None, 0, -1, float("nan"), "0.15", 1e-9, 50.0):
        with pytest.raises(ValueError, match="pitch"):
            write_files(result.textures[0], name, tmp_path, bad)


def test_usual_ratings_hold_most_takes(studio):
    """What the page calls usual is drawn, not decoded; takes that are decoded scatter a little more."""
    made = studio.generate([RATINGS], Settings(takes=8))
    estimated = np.array([texture.estimated for texture in made.textures])
    low, high = made.usual
    assert (low < high).all() and 0.4 < ((estimated > low) & (estimated < high)).mean() <= 1
    other = studio.generate([RATINGS], Settings(seed=5))
    np.testing.assert_allclose(other.usual, made.usual, atol=1e-4)  # it does not move while seeds are tried
    numbers = texture_answer(made, 0, "percentile", studio.config)[2]
    assert "usual</th>" in numbers and re.search(r"<td>\d+ to \d+</td>", numbers)


def test_side_by_side(studio):
    made = studio.generate([RATINGS, (0.0, 0.0, 0.0), (-1.0, 0.0, 0.5)])
    picture, sound, numbers = comparison_answer(made, ("A", "blend 50 %", "B"), "z", studio.config)
    assert sound.count("<audio") == 3 and numbers.count("estimated</th>") == 3 and "base64" in picture


def test_reconstruction_is_compared_with_what_was_recorded(studio, result):
    recorded = result.textures[0].samples.astype(float)
    made = studio.reconstruct(recorded, 10_000)
    np.testing.assert_allclose(made.recorded.samples, recorded, atol=1e-6)
    assert made.nine_band_db < 0.5
    assert np.corrcoef(made.decoded.samples, recorded)[0, 1] > 0.5
    picture, sound, numbers = reconstruction_answer(made, "raw", studio.config)
    assert (
        "asked" not in numbers and numbers.count(f">{Settings().seed}</td>") == 1 and "Newtons per unit" not in numbers
    )
    assert sound.count("<audio") == 2 and "Nine-band error" in numbers and "base64" in picture


def test_recordings_louder_than_textures_are_told(studio, pink_noise):
    made = studio.reconstruct(pink_noise(5000, 10_000)[0] * 50, 10_000)
    assert "Newtons per unit" in reconstruction_answer(made, "z", studio.config)[2]


def test_short_recordings_of_other_rates_are_reconstructed(studio, pink_noise):
    rate = 44_100
    made = studio.reconstruct(pink_noise(int(0.21 * rate), rate)[0], rate)
    assert made.decoded.sampling_rate == 10_000 and made.decoded.seconds == pytest.approx(0.21, abs=0.001)
    assert all(np.isfinite(texture.estimated).all() for texture in (made.recorded, made.decoded))

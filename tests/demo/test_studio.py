"""The studio: answers with the bundled checkpoint, their files, tables and the strip."""

import base64
import json
import re
import threading
import time
from unittest.mock import MagicMock

import numpy as np
import pytest
import studio as studio_module
from analysis import analysis, numbers, spectrum, waveform
from edit_tab import ACTIONS, options_of
from export_tab import FORMATS, MAP, file_stem, write_files
from settings import Settings
from strip import strip_value
from studio import Studio

from tactile_diffusers import bundled_checkpoint, export
from tactile_diffusers.playback import TextureProfile
from tactile_diffusers.signal import rms

RATINGS = (1.0, 0.2, -0.8)


@pytest.fixture(scope="module")
def texture(studio):
    return studio.generate(RATINGS, Settings(seed=3))


def test_visitors_at_once_share_a_call_and_get_what_each_would_get_alone(studio, monkeypatch):
    wanted = {seed: studio.generate(RATINGS, Settings(seed)).samples for seed in range(12)}
    calls, answer = [], studio._answer
    monkeypatch.setattr(studio, "_answer", lambda kind, asked: (calls.append(len(asked)), answer(kind, asked)))
    found = {}

    def visit(seed):
        found[seed] = studio.generate(RATINGS, Settings(seed)).samples

    threads = [threading.Thread(target=visit, args=(seed,)) for seed in wanted]
    with studio._lock:  # all wait
        for thread in threads:
            thread.start()
        while sum(map(len, studio._waiting.values())) < len(wanted):
            pass
    for thread in threads:
        thread.join()
    assert sorted(calls) == [4, 8] and not studio._waiting
    for seed, samples in wanted.items():
        np.testing.assert_allclose(found[seed], samples, atol=1e-5)


def test_one_visitor_s_mistake_is_told_and_leaves_the_studio_whole(studio):
    with pytest.raises(ValueError):
        studio.generate((99.0, 0.0, 0.0))
    with pytest.raises(ValueError, match="no checkpoint 'x'"):
        studio.generate(RATINGS, None, "x")
    assert studio.generate(RATINGS).seconds == 1.6


def test_analysis_holds_the_texture_and_what_is_usual(studio, texture):
    heard, samples, rate = studio.usual(RATINGS)
    found = spectrum([("this", texture)], (samples, rate))
    table = found.pivot_table(index="Hz", columns="of", values="dB re 1 N²")
    low, high = table["usual, 10 %"], table["usual, 90 %"]
    assert (low < high).all() and ((table["this"] > low - 6) & (table["this"] < high + 6)).mean() > 0.8
    assert 0.3 < ((heard > np.percentile(heard, 10, axis=0)) & (heard < np.percentile(heard, 90, axis=0))).mean()
    wave = waveform(texture)
    assert len(wave) < 1500 and wave["mN"].abs().max() == pytest.approx(1e3 * np.abs(texture.samples).max())
    told = numbers(studio.scale, [("this", texture)], heard)
    assert "this: asked" in told and "this: estimated" in told and re.search(r"<td>\d+ to \d+</td>", told)


def test_what_is_usual_has_the_guidance_of_the_texture(studio, texture):
    asked, desk = [], MagicMock()
    desk.studio.scale = studio.scale
    desk.studio.usual = lambda *given: asked.append(given) or ([RATINGS] * 2, np.ones((2, 9000)), 10_000)
    analysis(desk, None)
    look = desk.on.call_args_list[0].args[1]
    entry = (*[50.0] * 3, *[False] * 3, "denim", 1, 6, 1.5, 1.6, 2, studio.own)
    look((entry, texture, "told<br>"), None, True)
    assert asked == [(texture.ratings, 1.5, studio.own)]


def test_ratings_are_estimated_only_where_somebody_looks(studio, monkeypatch):
    calls, estimate = [], studio.estimate
    monkeypatch.setattr(studio, "estimate", lambda *given: (calls.append(1), estimate(*given))[1])
    texture = studio.generate(RATINGS)
    json.loads(strip_value([("a", texture)]))
    assert not calls
    assert texture.estimated is texture.estimated and len(calls) == 1 and np.isfinite(texture.estimated).all()


def test_strip_holds_the_profile(texture):
    [track] = json.loads(strip_value([("a", texture)]))["tracks"]
    found = np.frombuffer(base64.b64decode(track["profile"]), "<f4")
    profile = TextureProfile(texture.samples, texture.sampling_rate, texture.reference_speed)
    # what the stream reads at the reference speed is that profile through the band of what is felt
    place = np.arange(len(found)) * profile.pitch
    felt = profile.read(place, np.full(len(place), texture.reference_speed))
    spectrum = np.fft.rfft(found)
    frequencies = np.fft.rfftfreq(len(found), 1 / texture.sampling_rate)
    spectrum[(frequencies < 22) | (frequencies > 1100)] = 0
    # 20 % of the RMS: what lies between the edge here, a wall, and the slopes of the profile's filters
    assert rms(np.fft.irfft(spectrum) - felt) < 0.2 * rms(felt)
    assert track["friction"] == texture.friction_coefficient and track["pitch"] == profile.pitch


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_is_a_valid_file(texture, tmp_path, name):
    paths, told = write_files(texture, name, tmp_path, 0.15, "a")
    assert paths[0].name.startswith("a.") and paths[0].stat().st_size > 500
    assert [text[:16] for text in told] == ["Pixels 0.15 mm a"] * (name == MAP)  # what a friction map cannot hold
    for one in export.FORMATS.values():
        if paths[0].name.endswith(f"a{one.suffix}"):
            assert one.read(paths[0])[1]["checkpoint"] == texture.checkpoint


def test_pitch_of_a_map_is_the_display_s(texture, tmp_path):
    [path], told = write_files(texture, MAP, tmp_path, 0.03, "a")
    assert export.FORMATS["png"].read(path)[1]["pixel_pitch"] == 0.03 and not told
    for bad in (None, 0, float("nan"), "0.15"):
        with pytest.raises(ValueError, match="pitch"):
            write_files(texture, MAP, tmp_path, bad, "a")


def test_files_are_called_as_on_the_page(studio, texture):
    shown = "_".join(f"{value:g}" for value in studio.scale.from_z(RATINGS))
    assert file_stem("denim, edited", texture) == f"denim_edited_{shown}_seed3"
    recorded = studio.recorded(texture.samples.astype(float), texture.sampling_rate)
    assert file_stem("../ä", recorded) == "texture_any_any_any"


@pytest.mark.parametrize("name", FORMATS)
def test_a_recording_goes_into_every_file_over_time(studio, texture, name, tmp_path):
    recorded = studio.recorded(texture.samples.astype(float), texture.sampling_rate)
    if "over position" in name:  # nobody knows how fast the finger was
        with pytest.raises(ValueError, match="`reference_speed` is unknown"):
            write_files(recorded, name, tmp_path, 0.15, "a")
    else:
        paths, _ = write_files(recorded, name, tmp_path, 0.15, "a")
        assert all(path.stat().st_size for path in paths) and paths


@pytest.mark.parametrize("action", ACTIONS)
def test_every_edit_of_a_recording(studio, texture, action):
    recorded = studio.recorded(texture.samples.astype(float), texture.sampling_rate)
    deltas = dict.fromkeys(studio.scale.axes, 0.0)
    options = options_of(action, deltas | {"roughness": -1.0}, 0.8, 0.5, 0.6)
    after = studio.edit(recorded, Settings(), **options)
    assert after.seconds == pytest.approx(recorded.seconds + ("continue_s" in options))
    if options.get("ratings"):
        assert after.estimated[0] < recorded.estimated[0] - 0.3


@pytest.mark.parametrize(
    ("action", "stretch"), [(ACTIONS[0], (0, 1)), (ACTIONS[1], (0.9, 0.8)), (ACTIONS[1], (-1, 0.8))]
)
def test_an_edit_of_nothing_is_refused(action, stretch):
    with pytest.raises(ValueError, match="Say what to change|stretch"):
        options_of(action, {"roughness": 0.0}, 0.8, *stretch)


def test_a_search_goes_where_the_answers_point(studio):
    answers = []
    for _ in range(6):
        search = studio.search(["roughness", "bumpiness"], answers, seed=1)
        first, second = search.next_pair().tolist()
        answers.append((first, second, "first" if first[0] > second[0] else "second"))
    search = studio.search(["roughness", "bumpiness"], answers, seed=1)
    point = search.best_point()[0]
    assert point[0] > 0.3
    [texture] = studio.textures_of(search, [point])
    assert texture.ratings[:2] == pytest.approx(tuple(point)) and np.isnan(texture.ratings[2])


def test_adapted_checkpoints_are_checked_at_the_start_and_loaded_when_asked_for(tmp_path, make_pipeline):
    (tmp_path / "mine").symlink_to(bundled_checkpoint())
    studio = Studio(surfaces=[tmp_path / "mine"])
    assert list(studio.checkpoints)[1] == "mine" and list(studio._pipes) == [studio.own]
    assert studio.generate(RATINGS, checkpoint="mine").checkpoint == "mine" and "mine" in studio._pipes
    for name, options in (("axes", {"dale_config": {"rating_axes": ["a", "b", "c"]}}), ("none", {"dale": False})):
        make_pipeline(**options).save_pretrained(str(tmp_path / name))
        with pytest.raises(ValueError, match="has other axes|has no `dale`"):
            Studio(surfaces=[tmp_path / name])
    with pytest.raises(ValueError, match="`--surfaces` must be folders of adapted checkpoints, .*mien is no folder"):
        Studio(surfaces=[tmp_path / "mien"])


def test_an_adapted_checkpoint_is_loaded_once_for_all_who_wait(monkeypatch):
    loaded = []
    monkeypatch.setattr(studio_module, "_load", lambda folder: loaded.append(folder) or object())
    studio = Studio.__new__(Studio)
    studio.checkpoints, studio._pipes, studio._lock = {"own": "o", "mine": "m"}, {}, threading.RLock()
    threads = [threading.Thread(target=studio._pipe, args=("mine",)) for _ in range(3)]
    with studio._lock:
        for thread in threads:
            thread.start()
        time.sleep(0.05)  # all of them wait for the lock
    for thread in threads:
        thread.join()
    assert loaded == ["m"]

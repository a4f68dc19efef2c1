"""The studio: answers with the bundled checkpoint, their files, tables and the strip."""

import base64
import dataclasses
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
from strip import start_of, strip_value
from studio import Studio
from surfaces_tab import surfaces_tab

from tactile_diffusers import bundled_checkpoint, export
from tactile_diffusers.playback import TextureProfile
from tactile_diffusers.signal import SEGMENT_SAMPLES, rms

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
    made = (entry, texture, "told<br>")
    assert "estimated to feel" in look(made, (entry, False), False, "told<br>")[1]
    assert look(made, None, False, "**refused**")[1] is desk.gr.skip.return_value, "a refusal stays in the status"


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


def test_the_strip_begins_a_little_before_long_textures_differ(texture):
    long = np.tile(texture.samples, 5)
    other = long.copy()
    other[50_000:51_000] = 0
    before, after, longer = (dataclasses.replace(texture, samples=row) for row in (long, other, np.tile(long, 2)))
    lead = SEGMENT_SAMPLES // 4
    assert start_of([("before", before), ("after", after)]) == 50_000 - lead
    assert start_of([("before", before), ("longer", longer)]) == len(long) - lead
    assert start_of([("a", texture), ("b", texture)]) == start_of([("before", before)]) == 0
    first, second = json.loads(strip_value([("before", before), ("after", after)]))["tracks"]
    assert first["profile"] != second["profile"]


@pytest.fixture(scope="module")
def page(studio, tmp_path_factory):
    """The page's functions by the element and the event that call them; without a server."""
    pytest.importorskip("gradio")
    from page import build

    page = build(studio, tmp_path_factory.mktemp("page"))
    called = [(page.blocks[key].elem_id, event, one.fn) for one in page.fns.values() for key, event in one.targets
              if key in page.blocks]  # fmt: skip
    return {f"{name}.{event}": function for name, event, function in called if name}


LOG = {"entries": [], "at": -1, "time": 0.0, "moved": set()}


def snapshot(studio, **changed):
    """What Make's controls send."""
    entry = dict(roughness=50, bumpiness=60, slipperiness=40, open0=False, open1=False, open2=False, preset="denim")
    entry |= dict(take=2, seed=6, guidance=1.5, duration=0.8, steps=1, checkpoint=studio.own)
    return (LOG, "roughness", "bumpiness", *(entry | changed).values())


@pytest.mark.parametrize(
    ("control", "changed", "message"),
    [
        ("roughness.input", {"roughness": 150}, "roughness must be between 0 and 100, got 150"),
        ("seed.input", {"seed": None}, "`seed`"),
        ("seed.input", {"seed": 3.7}, "`seed`.*3.7"),
        ("takes.input", {"seed": -1}, "`seed`.*-1"),
        ("seed.input", {"guidance": 9}, "`guidance`"),
        ("roughness-open.input", {"duration": 99}, "`duration_s`"),
    ],
)
def test_live_controls_say_on_the_page_what_they_refuse(page, studio, control, changed, message):
    told = page[control](*snapshot(studio, **changed))[-2]
    assert re.fullmatch(rf"\*\*.*{message}.*\*\*", told)


def test_a_slider_that_is_dragged_is_no_longer_open_and_an_emptied_one_is(page, studio):
    for event, changed, is_open in (
        ("roughness.input", {"open0": True}, False),
        ("roughness.input", {"roughness": None}, True),
        ("roughness-open.input", {"open0": True}, True),
        ("roughness-open.input", {"roughness": None}, True),
    ):
        found, _, _, (entry, texture, _), *_ = page[event](*snapshot(studio, **changed))
        assert found is entry[3] is is_open and np.isnan(texture.ratings[0]) == is_open


def test_other_tabs_make_textures_as_make_does(page, studio, monkeypatch):
    made, asked, generate = page["seed.input"](*snapshot(studio))[2], [], studio.generate
    monkeypatch.setattr(studio, "generate", lambda *given: (asked.append(given[1:]), generate(*given))[1])
    page["share.input"](RATINGS, RATINGS, None, "glass", 50, made)
    assert asked == [(Settings(7, 1.5, 0.8, 1), studio.own)] * 3
    with pytest.raises(Exception, match="blend"):
        page["share.input"](RATINGS, RATINGS, None, "glass", None, made)


def test_an_adapted_checkpoint_is_compared_with_the_settings_of_make(studio, texture):
    desk, entry = MagicMock(), (*[50.0] * 3, *[False] * 3, "denim", 1, 3, 1.5, 0.8, 1, studio.own)
    desk.studio.scale, desk.studio.own, desk.studio.checkpoints = studio.scale, "own", {"own": 1, "mine": 2}
    desk.studio.generate.return_value = texture
    surfaces_tab(desk, MagicMock())
    desk.on.call_args.args[1]("mine", (entry, texture, ""))
    settings = Settings(3, 1.5, 0.8, 1)
    assert [call.args[1:] for call in desk.studio.generate.call_args_list] == [(settings, "own"), (settings, "mine")]


def test_every_edit_has_another_seed_and_the_steps_of_make(page, studio, monkeypatch):
    made, asked, edit = page["seed.input"](*snapshot(studio))[2], [], studio.edit
    monkeypatch.setattr(studio, "edit", lambda *given, **how: (asked.append(given[1]), edit(*given, **how))[1])
    anew = (made, ACTIONS[1], 0.3, 0.4, 0.6, 0, 0, 0)
    versions = page["edit.click"]([made[1]], *anew)[0]
    [*_, first, second] = page["edit.click"](versions, *anew)[0]
    assert [(one.seed, one.steps) for one in asked] == [(8, 1), (9, 1)]
    assert (first.samples[3000:4000] != second.samples[3000:4000]).all()
    recorded = dataclasses.replace(made[1], seed=None, checkpoint=None)
    page["edit.click"]([recorded], *anew)
    assert asked[-1] == Settings()


def test_a_refused_file_leaves_nothing_to_edit_and_a_new_one_begins_afresh(page, tmp_path):
    _, rate, newtons = (control.constructor_args for control in page["upload.upload"](None))
    assert rate["value"] is None and newtons["value"] == 1
    (tmp_path / "a.csv").write_text("1.0\n" * 9000)
    versions, told, *_ = page["csv-rate.submit"](str(tmp_path / "a.csv"), None, 5000, None)
    assert versions == [] and "constant" in told
    with pytest.raises(Exception, match="give a recording"):
        page["edit.click"](versions, None, ACTIONS[2], 0.3, 0.4, 0.6, 0, 0, 0)

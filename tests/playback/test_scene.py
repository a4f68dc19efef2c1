"""A scene makes what is touched and nothing else, and the same whatever was touched before."""

import threading

import numpy as np
import pytest
import torch

from tactile_diffusers import TactileTexturePipeline, bundled_checkpoint
from tactile_diffusers.playback import TextureProfile, TextureScene
from tactile_diffusers.playback.scene import _noise_seed
from tactile_diffusers.signal import nine_band_error_db

SURFACES = {
    "table": [0.5, -0.5, 0.0],
    "denim": {"roughness": 1.0},
    "button": None,
    "ridge": [None, 0.8, -0.4],
    "film": np.array([-1.0, 0.0, 1.0]),
}
#: A segment of the tiny pipeline is 14.7 mm long; the table's diagonal is 50 mm.
PATCHES = {"table": (0, 0, 40, 30), "denim": (5, 5, 6, 8), "button": (20, 10, 6, 8), "film": (100, 0, 6, 8)}


def _samples(profile, speed=80.0):
    return profile.read(np.linspace(0, 20, 3000), np.full(3000, speed))


@pytest.fixture
def counted(pipe, monkeypatch):
    """The tiny pipeline, which counts textures made by DALE (per call) and by LCTG."""
    calls = pipe.calls = {"dale": [], "lctg": []}
    generate, decode = TactileTexturePipeline.__call__, TactileTexturePipeline.decode

    def counting_call(self, ratings, **options):
        calls["dale"].append(len(ratings))
        return generate(self, ratings, **options)

    def counting_decode(self, latents, *rest, **options):
        calls["lctg"].append(latents.shape[-1])
        return decode(self, latents, *rest, **options)

    monkeypatch.setattr(TactileTexturePipeline, "__call__", counting_call)
    monkeypatch.setattr(TactileTexturePipeline, "decode", counting_decode)
    return pipe


@pytest.fixture
def scene(pipe):
    return TextureScene(SURFACES, pipe, PATCHES)


def test_only_what_is_touched_is_made(counted):
    scene = TextureScene(SURFACES, counted)
    assert counted.calls == {"dale": [], "lctg": []} and scene.decoded == ()
    profile = scene.profile("denim")
    assert isinstance(profile, TextureProfile) and counted.calls == {"dale": [5], "lctg": [32]}
    assert scene.profile("denim") is profile
    scene.profile("film")
    assert counted.calls == {"dale": [5], "lctg": [32, 32]} and scene.decoded == ("denim", "film")
    assert [scene.friction_coefficient(name) > 0 for name in scene.names] == [True] * 5
    assert counted.calls == {"dale": [5], "lctg": [32, 32]}


def test_a_long_patch_gets_a_long_texture_and_the_others_a_segment(counted):
    scene = TextureScene(SURFACES, counted, PATCHES)
    assert scene.profile("table").length >= 50 - 0.02  # two samples: the join is rounded
    assert scene.profile("table").length < 50 + 80 * 16 / 2500  # a latent frame
    assert sorted(counted.calls["dale"]) == [1, 4]  # one batch for each length
    lengths = {scene.profile(name).length for name in ("denim", "button", "ridge", "film")}
    assert len(lengths) == 1 and min(lengths) == pytest.approx(14.75, abs=0.1)


def test_a_scene_decodes_what_the_finger_nears(counted):
    scene = TextureScene(SURFACES, counted, PATCHES)
    assert scene.prepare((90, 4)) == ["film"] and scene.decoded == ("film",)
    assert scene.prepare((200, 200)) == []
    assert scene.prepare((60, 14), velocity=(-120, 0)) == ["table", "button"]
    assert scene.decoded == ("film", "table", "button") and len(counted.calls["lctg"]) == 3
    small = TextureScene(SURFACES, counted, PATCHES, cache_size=2)
    assert small.prepare((15, 10)) == ["table", "denim"] == list(small.decoded)  # no more than it keeps


def test_the_cache_is_bounded_and_what_was_dropped_comes_back_the_same(counted):
    scene = TextureScene(SURFACES, counted, cache_size=2)
    first = _samples(scene.profile("table"))
    scene.profile("denim")
    scene.profile("table")  # asked for again: denim is the oldest now
    scene.profile("film")
    assert scene.decoded == ("table", "film")
    scene.profile("ridge")
    assert scene.decoded == ("film", "ridge")
    np.testing.assert_array_equal(_samples(scene.profile("table")), first)
    assert counted.calls["dale"] == [5] and len(counted.calls["lctg"]) == 5


def test_a_surface_is_itself_among_others(pipe):
    alone, among = TextureScene({"film": SURFACES["film"]}, pipe), TextureScene(SURFACES, pipe)
    wanted = _samples(among.profile("film"))
    np.testing.assert_allclose(_samples(alone.profile("film")), wanted, atol=1e-3 * wanted.std())
    assert alone.friction_coefficient("film") == pytest.approx(among.friction_coefficient("film"), rel=1e-4)


def test_seeds_names_and_ratings_make_the_difference(pipe):
    scene = TextureScene({"a": [1, 0, 0], "b": [1, 0, 0], "c": [0, 0, 1]}, pipe)
    reseeded = TextureScene({"a": [1, 0, 0]}, pipe, seed=1)
    a, b, again = (_samples(s.profile(n)) for s, n in ((scene, "a"), (scene, "b"), (reseeded, "a")))
    assert abs(np.corrcoef(a, b)[0, 1]) < 0.5 and abs(np.corrcoef(a, again)[0, 1]) < 0.5
    for ratings, options in (
        ([0, 0, 1], {}),  # the same noise, other ratings
        ([1, 0, 0], {"num_inference_steps": 3}),
        ([1, 0, 0], {"guidance_scale": {"roughness": np.float32(2.5)}}),
    ):
        other = TextureScene({"a": ratings}, pipe, **options)
        assert np.abs(_samples(other.profile("a")) - a).max() > 0


def test_threads_share_one_pipeline(counted):
    scene = TextureScene(SURFACES, counted, PATCHES, cache_size=2)
    wanted = {name: _samples(TextureScene(SURFACES, counted, PATCHES).profile(name)) for name in scene.names}
    counted.calls["dale"].clear()
    failures = []

    def touch(seed):
        try:
            for name in np.random.default_rng(seed).permutation(scene.names):
                np.testing.assert_array_equal(_samples(scene.profile(str(name))), wanted[name])
                assert len(scene.decoded) <= 2 and scene.friction_coefficient(name) > 0
        except BaseException as error:  # a thread's own would go unseen
            failures.append(error)

    threads = [threading.Thread(target=touch, args=(seed,)) for seed in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not failures and sorted(counted.calls["dale"]) == [1, 4]


def test_what_is_decoded_does_not_wait_for_what_is_not(scene, monkeypatch):
    known, begun, go_on = scene.profile("denim"), threading.Event(), threading.Event()
    decode = TactileTexturePipeline.decode

    def slow_decode(self, *rest, **options):
        begun.set()
        assert go_on.wait(10)
        return decode(self, *rest, **options)

    monkeypatch.setattr(TactileTexturePipeline, "decode", slow_decode)
    thread = threading.Thread(target=scene.profile, args=("film",))
    thread.start()
    assert begun.wait(10)
    assert scene.profile("denim") is known and scene.friction_coefficient("film") > 0 and scene.at((101, 1)) == "film"
    assert thread.is_alive()
    go_on.set()
    thread.join()
    assert set(scene.decoded) == {"film", "denim"}


def test_ratings_of_any_scale_are_the_same_scene(make_pipeline, tmp_path):
    statistics = {"mean": [3.0, 4.0, 5.0], "std": [1.5, 2.0, 1.0]}
    pipe = make_pipeline(dale_config={"rating_statistics": statistics})
    given = {"denim": [6.0, 4.0, None], "film": {"slipperiness": 4.0}}
    raw = TextureScene(given, pipe, rating_scale="raw")
    np.testing.assert_allclose(raw.ratings, [[2, 0, np.nan], [np.nan, np.nan, -1]], rtol=1e-6)
    z = TextureScene({"denim": [2.0, 0.0, None], "film": {"slipperiness": -1.0}}, pipe)
    raw.save(tmp_path / "s.safetensors")
    loaded = TextureScene.load(tmp_path / "s.safetensors", pipe)
    np.testing.assert_array_equal(loaded.ratings, z.ratings)
    np.testing.assert_array_equal(_samples(loaded.profile("denim")), _samples(z.profile("denim")))


def test_the_later_surface_lies_above(scene):
    assert scene.at((1, 1)) == "table" and scene.at((6, 6)) == "denim" and scene.at((22, 12)) == "button"
    assert scene.at((60, 1)) is None and scene.at((-0.1, 1)) is None
    assert scene.at((0, 0)) == "table" and scene.at((40, 0)) is None  # an edge belongs to one side
    line = TextureScene({"a": None, "b": None}, scene._pipe, {"a": (0, 30), "b": (50, 20)})
    assert line.dimensions == 1 and line.at(10) == "a" and line.at([55.0]) == "b" and line.at(40) is None
    assert line.near(35.0) == ["a"] and line.near(35.0, velocity=100.0) == ["a", "b"]
    upside_down = {name: PATCHES[name] for name in reversed(PATCHES)}
    assert TextureScene(SURFACES, scene._pipe, upside_down).at((6, 6)) == "denim"  # the order is that of `surfaces`


def test_near_equals_a_search_along_the_way():
    """The formula again, as many small steps."""
    from tactile_diffusers.playback.scene_files import Patches

    rng = np.random.default_rng(0)
    corners, sizes = rng.uniform(0, 200, (30, 2)), rng.uniform(2, 40, (30, 2))
    names = [f"{number}" for number in range(30)]
    patches = Patches({n: (*c, *s) for n, c, s in zip(names, corners, sizes, strict=True)}, names)
    for _ in range(50):
        place, velocity = rng.uniform(-20, 240, 2), rng.normal(0, 200, 2) * rng.integers(0, 2, 2)
        way = place + np.linspace(0, 0.4, 4001)[:, None] * velocity
        inside = ((way[:, None] >= corners - 3) & (way[:, None] <= corners + sizes + 3)).all(-1)
        found = patches.near(place, velocity, 3.0, 0.4)
        assert set(found) == {names[index] for index in np.flatnonzero(inside.any(0))}
        first = [int(inside[:, int(name)].argmax()) for name in found]
        assert (np.diff(first) >= -1).all()


def test_a_scene_from_a_file_is_the_same_and_needs_no_dale(counted, make_pipeline, tmp_path):
    settings = {"seed": np.int32(3), "num_inference_steps": np.int64(4), "guidance_scale": {"bumpiness": np.float32(2)}}
    scene = TextureScene(SURFACES, counted, PATCHES, **settings)
    scene.save(tmp_path / "s.safetensors")
    assert sorted(counted.calls["dale"]) == [1, 4] and not counted.calls["lctg"]
    counted.calls["dale"].clear()
    for pipe in (counted, make_pipeline(dale=False)):
        loaded = TextureScene.load(tmp_path / "s.safetensors", pipe)
        assert loaded.names == scene.names and loaded.patches == scene.patches and loaded.at((6, 6)) == "denim"
        assert loaded.reference_speed == scene.reference_speed == 80.0
        np.testing.assert_array_equal(loaded.ratings, scene.ratings)
        for name in scene.names:
            np.testing.assert_array_equal(_samples(loaded.profile(name)), _samples(scene.profile(name)))
            assert loaded.friction_coefficient(name) == scene.friction_coefficient(name)
    assert not counted.calls["dale"]
    loaded.save(tmp_path / "again.safetensors")
    again = TextureScene.load(tmp_path / "again.safetensors", counted)
    np.testing.assert_array_equal(_samples(again.profile("table")), _samples(scene.profile("table")))


def test_a_scene_costs_kilobytes(tmp_path):
    pipe = TactileTexturePipeline.from_pretrained(bundled_checkpoint())
    pipe.set_progress_bar_config(disable=True)
    ratings = np.random.default_rng(0).uniform(-1, 1, (20, 3))
    scene = TextureScene({f"surface {number}": row for number, row in enumerate(ratings)}, pipe)
    scene.save(tmp_path / "s.safetensors")
    assert (tmp_path / "s.safetensors").stat().st_size < 20 * 3600 + 8000
    assert [path.name for path in tmp_path.iterdir()] == ["s.safetensors"]
    # latents in half precision: the texture that the pipeline makes of the unrounded ones
    generators = [scene._generator(name, "dale") for name in scene.names]
    made = pipe(ratings, generator=generators, output_type="latent")
    plain = pipe.decode(
        made.latents[:3], made.level[:3], generator=[scene._generator(n, "lctg") for n in scene.names[:3]]
    )
    for name, texture in zip(scene.names, plain.textures, strict=False):
        filling = {"seed": _noise_seed(0, name, "filling")}
        wanted = TextureProfile(texture, plain.sampling_rate, plain.reference_speed, **filling)
        position = np.linspace(0, 100, 12_500)
        a, b = (profile.read(position, np.full(12_500, 80.0)) for profile in (scene.profile(name), wanted))
        assert np.std(a - b) < 3e-3 * np.std(b)  # -50 dB; measured: -55 at worst of 3
        assert nine_band_error_db(a[None], b[None], 10_000)[0] < 0.01


def test_another_checkpoint_is_refused_and_another_precision_is_not(scene, make_pipeline, tmp_path):
    scene.save(tmp_path / "s.safetensors")
    with pytest.raises(ValueError, match="s.safetensors was made with another checkpoint: .*weights"):
        TextureScene.load(tmp_path / "s.safetensors", make_pipeline(seed=5))
    coarse = make_pipeline()
    coarse.to(torch.bfloat16)
    assert TextureScene.load(tmp_path / "s.safetensors", coarse).names == scene.names

"""What a scene refuses: impossible requests, before any work."""

import numpy as np
import pytest

from tactile_diffusers.playback import TextureScene

GOOD = {"table": [0.5, -0.5, 0.0], "denim": None}


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"surfaces": {}}, "`surfaces` must map names to ratings"),
        ({"surfaces": {"": [1, 0, 0]}}, "`surfaces` must have names"),
        ({"surfaces": {"denim": [1, 0]}}, "denim.*must have 3 values"),
        ({"surfaces": {"denim": [[1, 0, 0], [1, 0, 0]]}}, "denim.*one texture, got 2 rows"),
        ({"rating_scale": "stars"}, "`rating_scale` must be one of"),
        ({"rating_scale": "percentile"}, "needs .'quantiles'. in the `rating_statistics`"),
        ({"patches": [(0, 0, 1, 1)]}, "`patches` must map names"),
        ({"patches": {"silk": (0, 0, 1, 1)}}, r"`patches` names \['silk'\]"),
        ({"patches": {"denim": (0, 0, 1)}}, r"`patches\['denim'\]`"),
        ({"patches": {"denim": (0, 0, 0, 5)}}, "positive size"),
        ({"patches": {"denim": (0, 0, 9e6, 5)}}, "give mm"),
        ({"patches": {"denim": (0, 5), "table": (0, 0, 5, 5)}}, "got both"),
        ({"seed": 0.5}, "`seed`"),
        ({"guidance_scale": {"rough": 2.0}}, "`guidance_scale`"),
        ({"cache_size": 0}, "`cache_size`"),
        ({"pipe": "a checkpoint"}, "`pipe` must be a TactileTexturePipeline, got str"),
    ],
)
def test_impossible_scenes_are_refused(pipe, given, message):
    with pytest.raises(ValueError, match=message):
        TextureScene(**({"surfaces": GOOD, "pipe": pipe} | given))


def test_a_pipeline_must_know_its_ratings_and_its_speed(make_pipeline):
    with pytest.raises(ValueError, match="no `dale`"):
        TextureScene(GOOD, make_pipeline(dale=False))
    with pytest.raises(ValueError, match="reference_speed"):
        TextureScene(GOOD, make_pipeline(dale_config={"reference_speed": None}))


def test_impossible_questions_are_refused(pipe):
    scene, bare = TextureScene(GOOD, pipe, {"denim": (0, 0, 5, 5)}), TextureScene(GOOD, pipe)
    for ask in (scene.profile, scene.friction_coefficient):
        with pytest.raises(ValueError, match=r"`name` must be one of .*denim.*got 'silk'"):
            ask("silk")
    for position in (3.0, (1, 2, 3), (np.nan, 0)):
        with pytest.raises(ValueError, match="`position` must be 2 finite"):
            scene.at(position)
    with pytest.raises(ValueError, match="`velocity` must be 2 finite"):
        scene.near((0, 0), velocity=3.0)
    with pytest.raises(ValueError, match="has no `patches`"):
        bare.at((0, 0))

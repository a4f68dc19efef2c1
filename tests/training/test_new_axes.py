"""An axis that only a lab's data name: what it adds when it is asked, and that nothing changes when it is not."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from tactile_diffusers import TactileTexturePipeline
from tactile_diffusers.data import PreparedDataset, SegmentLimits, prepare_recordings
from tactile_diffusers.data.ratings import SurfaceRatings, check_axes
from tactile_diffusers.models.calibration import calibration_inputs, scalar_shift
from tactile_diffusers.signal import RATING_AXES
from tactile_diffusers.training.adapting import adapt
from tactile_diffusers.training.new_axes import add_axes, carried_words
from tactile_diffusers.training.recalibration import Surfaces, recalibrate
from tactile_diffusers.virtual import generate_recordings

SURFACES = 60
#: Of a segment, as tiny pipelines have it.
SECONDS = 0.2048


def _ratings(values, axes=("roughness", "bumpiness", "slipperiness", "fineness")):
    unit = np.ones(len(axes), np.float32)
    return SurfaceRatings(values, np.zeros_like(values), np.ones_like(values), 4 * unit, unit, axes=axes)


@pytest.fixture
def rated():
    """Four axes of which the last goes along with the first."""
    rng = np.random.default_rng(0)
    values = rng.normal(size=(SURFACES, 4))
    values[:, 3] = 0.6 * values[:, 0] + 0.8 * values[:, 3]
    return _ratings(values.astype(np.float32))


@pytest.fixture
def plain(make_dale, rating_statistics):
    statistics = rating_statistics | {"mean": [4.0] * 3, "std": [1.0] * 3}
    return make_dale(scalar_width=16, distilled_steps=1, rating_statistics=statistics)


@pytest.fixture
def grown(plain, rated):
    dale = type(plain).from_config(dict(plain.config))
    dale.load_state_dict(plain.state_dict())
    assert add_axes(dale, rated, np.arange(SURFACES)) == ["fineness"]
    return dale.eval()


def _world(dale, ratings, slope, seed):
    """Surfaces whose first scalar follows what the three axes leave of the fourth."""
    rng, owners = np.random.default_rng(seed), np.repeat(np.arange(SURFACES), 8)
    scalars = rng.normal(size=(len(owners), dale.num_scalars))
    left = ratings[:, 3] - 0.6 * ratings[:, 0]
    scalars[:, 0] += slope * left[owners]
    field = torch.zeros(len(owners), dale.config.in_channels - dale.num_scalars, 16)
    states = dale.append_scalars(field, torch.from_numpy(scalars)).float()
    return Surfaces(states, owners, ratings.astype(np.float64), np.ones(len(owners), bool))


@torch.no_grad()
def test_a_new_axis_is_known_but_does_nothing_yet(grown, tmp_path):
    assert tuple(grown.config.rating_axes)[3] == "fineness" and grown.config.network_axes == 3
    statistics = grown.config.rating_statistics
    assert all(len(statistics[name]) == 4 for name in ("mean", "std", "range", "quantiles", "centre"))
    assert np.linalg.eigvalsh(statistics["covariance"]).min() > 0
    assert not np.array(grown.config.calibration["slopes"])[3].any()
    grown.save_pretrained(tmp_path)
    again = type(grown).from_pretrained(tmp_path)  # networks have the sizes of three axes
    assert again.config.network_axes == 3 and again.scalar_network.first.in_features == grown.num_scalars + 2 * 3


@torch.no_grad()
def test_its_slope_is_found_and_an_open_axis_changes_nothing(plain, grown, rated):
    real, made = _world(grown, rated.mean, 1.5, 1), _world(grown, rated.mean, 0.0, 2)
    change = recalibrate(grown, real, {1.0: made})
    # 60 surfaces of 8 takes: four standard errors are 0.2, and shrinkage takes a part
    assert change.slopes[3, 0] == pytest.approx(1.5, abs=0.3) and np.abs(change.slopes[3, 1:]).max() < 0.3
    real, made = (replace(one, ratings=one.ratings[:, :3]) for one in (real, made))
    three = recalibrate(plain, real, {1.0: made})
    change.apply(grown)
    three.apply(plain)
    asked = torch.tensor([[0.5, torch.nan, -1.0, torch.nan], [0.5, torch.nan, -1.0, 2.0]])
    shift = scalar_shift(grown.config, asked)
    assert shift[1, 0] - shift[0, 0] > 1.0
    sample = torch.randn(2, grown.config.in_channels, 16)
    found, expected = grown(sample, 999.0, asked).sample, plain(sample, 999.0, asked[:, :3]).sample
    torch.testing.assert_close(found[0], expected[0], rtol=0, atol=1e-5)  # float32
    assert not torch.allclose(found[1], expected[1], atol=1e-2)


def test_inputs_of_further_axes_are_what_is_left():
    covariance = torch.tensor([[1.0, 0.5], [0.5, 1.0]])
    ratings = torch.tensor([[1.0, 0.5], [1.0, torch.nan], [torch.nan, 1.0]])
    found = calibration_inputs(ratings, torch.zeros(2), covariance, 1)
    # expected: nothing is left; open: exactly 0; alone: the first counts as 0.5, which lets 0.25 expect
    assert torch.allclose(found, torch.tensor([[1.0, 0.0], [1.0, 0.0], [0.5, 0.75]])) and found[1, 1] == 0


@pytest.mark.parametrize("name, words", [("smoothness", "'roughness' by another"), ("Fineness", "the same name")])
def test_clashing_names_are_refused(name, words):
    with pytest.raises(ValueError, match=words):
        check_axes(("roughness", "bumpiness", "slipperiness", "fineness", name))


def test_what_friction_does_not_carry_is_said():
    rng = np.random.default_rng(0)
    scalars, noise = rng.normal(size=(50, 8)), rng.normal(size=50)
    assert "so friction carries it" in carried_words("fineness", scalars[:, 0] + 0.3 * noise, scalars)
    assert "hardly carries it" in carried_words("warmth", noise, scalars)
    assert "too few" in carried_words("warmth", noise[:5], scalars[:5])


def test_from_recordings_to_a_texture_asked_by_the_new_axis(make_pipeline, tmp_path):
    recordings = tmp_path / "r.h5"
    generate_recordings(recordings, surfaces=6, seconds=5, explorers=1, seed=3, quiet=True, further_axes=["fineness"])
    limits = SegmentLimits(seconds=SECONDS)
    prepare_recordings(recordings, tmp_path / "p.h5", limits, validation=1, test=1, quiet=True)
    dataset = PreparedDataset(tmp_path / "p.h5", "train", "filtered", 2500)
    assert dataset.rating_axes == (*RATING_AXES, "fineness") and dataset.ratings.mean.shape[1] == 3
    before = make_pipeline()
    adapt(make_pipeline(), dataset, tmp_path / "out")
    card = (tmp_path / "out" / "README.md").read_text()
    assert "fineness is new: 4 rated surfaces are too few" in card
    assert "pipe(ratings=[[1.5, 0.0, -1.0, 0.0]])  # roughness, bumpiness, slipperiness, fineness" in card
    tables = [line for line in card.splitlines() if line.startswith("| ")]
    assert all(line.endswith(" |") for line in tables), "a cell holds a line break"
    pipe = TactileTexturePipeline.from_pretrained(tmp_path / "out")
    pipe.set_progress_bar_config(disable=True)
    assert tuple(pipe.dale.config.rating_axes) == dataset.rating_axes == dataset.ratings.axes
    out = pipe({"fineness": 1.0}, generator=torch.Generator().manual_seed(0))
    np.testing.assert_array_equal(
        pipe([[None, None, None, 1.0]], generator=torch.Generator().manual_seed(0)).textures, out.textures
    )
    with pytest.raises(ValueError, match="roughness"):
        before({"fineness": 1.0})

"""Loading by name: decoders beside a checkpoint's own, pipelines that share models, names that do not exist."""

import copy

import pytest
import torch
from diffusers import ModelMixin  # noqa: F401 (diffusers looks for it in the module of a subclass)

from tactile_diffusers import LCTGModel, TactileTexturePipeline, VDDIMScheduler
from tactile_diffusers.pipelines import PRESETS, find_decoders
from tactile_diffusers.pipelines.inputs import parse_ratings


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("saved")


@pytest.fixture
def saved(pipe, make_lctg, folder):
    if not any(folder.iterdir()):
        pipe.save_pretrained(str(folder))
        make_lctg(seed=9, distilled_steps=2).save_pretrained(str(folder / "lctg_distilled"))
    return folder


def test_another_decoder_is_loaded_by_name(saved, recorded_warnings):
    with recorded_warnings() as found:
        pipe = TactileTexturePipeline.from_pretrained(saved, decoder="distilled", dtype=torch.bfloat16)
    assert found == [] and pipe.resolve_steps() == (2, 5)
    expected = LCTGModel.from_pretrained(saved, subfolder="lctg_distilled").state_dict()
    assert all(torch.equal(value, expected[name].bfloat16()) for name, value in pipe.lctg.state_dict().items())


def test_a_pipeline_with_another_decoder_saves_it_as_its_own(saved, tmp_path):
    TactileTexturePipeline.from_pretrained(saved, decoder="distilled").save_pretrained(tmp_path)
    assert TactileTexturePipeline.from_pretrained(tmp_path).resolve_steps() == (2, 5)
    assert find_decoders(tmp_path) == {}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"decoder": "fast"}, r"no `decoder` 'fast': it has \['distilled'\]"),
        ({"decoder": "distilled", "lctg": None}, "`decoder` .* and `lctg` exclude each other"),
        ({"subfolder": "lctg"}, "`subfolder` must be left out, got 'lctg'"),
    ],
)
def test_impossible_choices_are_refused(saved, options, message):
    with pytest.raises(ValueError, match=message):
        TactileTexturePipeline.from_pretrained(saved, **options)


@pytest.mark.parametrize("name", ["./typo", "/no/such/folder", "a/b/c"])
def test_a_name_that_the_hub_cannot_have_is_an_os_error(name):
    with pytest.raises(OSError, match="is neither a folder here nor a name on the Hub"):
        TactileTexturePipeline.from_pretrained(name)


class OwnLCTG(LCTGModel):
    pass


def test_a_passed_component_is_not_checked_in_the_folder(pipe, saved, tmp_path):
    own = copy.deepcopy(pipe.lctg)
    own.__class__ = OwnLCTG
    mixed = TactileTexturePipeline.from_pipe(pipe, lctg=own)
    mixed.save_pretrained(tmp_path)
    with pytest.raises(ValueError, match="component 'lctg' is .*OwnLCTG, which is none of this package"):
        TactileTexturePipeline.from_pretrained(tmp_path)
    assert TactileTexturePipeline.from_pretrained(tmp_path, lctg=own).lctg is own
    assert TactileTexturePipeline.from_pretrained(saved, lctg=own).lctg is own


def test_from_pipe_shares_models_and_copies_schedulers(pipe, make_lctg):
    other, scheduler = make_lctg(seed=5).bfloat16(), VDDIMScheduler(multistep_order=1)
    new, replaced = (TactileTexturePipeline.from_pipe(pipe, lctg=other, **k) for k in ({}, {"scheduler": scheduler}))
    assert new.lctg is other and new.dale is pipe.dale and new.feature_extractor is pipe.feature_extractor
    assert new.lctg.dtype == torch.bfloat16 and new.dale.dtype == torch.float32
    assert new.scheduler is not pipe.scheduler and new.scheduler.config == pipe.scheduler.config
    assert new.dale_scheduler is not pipe.dale_scheduler
    assert replaced.scheduler is scheduler


def test_presets_are_ratings(pipe):
    ratings = parse_ratings(list(PRESETS.values()), pipe.dale.config)
    assert ratings.shape == (len(PRESETS), 3) and ratings[~ratings.isnan()].abs().max() <= 2
    assert PRESETS["denim"][2] > 0 > PRESETS["rubber"][2]  # slippery, sticky

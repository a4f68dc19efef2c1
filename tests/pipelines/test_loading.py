"""Loading by name: decoders beside a checkpoint's own, pipelines that share models, names that do not exist."""

import copy

import numpy as np
import pytest
import torch
from diffusers import ModelMixin  # noqa: F401 (diffusers looks for it in the module of a subclass)

from tactile_diffusers import LCTGModel, TactileTexturePipeline, VDDIMScheduler
from tactile_diffusers.pipelines import PRESETS
from tactile_diffusers.pipelines.inputs import parse_ratings


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("saved")


@pytest.fixture
def saved(pipe, make_lctg, folder):
    """A pipeline with a distilled decoder of other weights."""
    if not any(folder.iterdir()):
        pipe.register_modules(lctg_distilled=make_lctg(seed=9, distilled_steps=2))
        pipe.save_pretrained(str(folder))
    return folder


class TestDistilledDecoder:
    def test_it_is_a_component(self, saved, recorded_warnings):
        with recorded_warnings() as found:
            pipe = TactileTexturePipeline.from_pretrained(saved, dtype=torch.bfloat16)
        assert found == [] and pipe.resolve_steps() == (2, 5)
        expected = LCTGModel.from_pretrained(saved, subfolder="lctg_distilled").state_dict()
        weights = pipe.lctg_distilled.state_dict().items()
        assert all(torch.equal(value, expected[name].bfloat16()) for name, value in weights)

    def test_it_decodes_in_few_steps_and_its_teacher_in_more(self, saved):
        both, alone = TactileTexturePipeline.from_pretrained(saved), {"lctg_distilled": None}
        teacher = TactileTexturePipeline.from_pretrained(saved, **alone)
        student = TactileTexturePipeline.from_pretrained(saved, lctg=both.lctg_distilled, **alone)

        def textures(pipe, steps):
            return pipe([[0.5, 0.0, 0.0]], steps, 1, generator=torch.Generator().manual_seed(0)).textures

        for steps, one in ((None, student), (1, student), (2, student), (3, teacher)):
            np.testing.assert_array_equal(textures(both, steps), textures(one, steps))
        assert not np.array_equal(textures(student, 2), textures(teacher, 2))

    def test_latent_steps_follow_the_teachers_alone(self, saved):
        pipe = TactileTexturePipeline.from_pretrained(saved)
        assert [pipe.resolve_steps(steps) for steps in (1, 3)] == [(1, 5), (3, 3)]

    def test_one_that_does_not_fit_is_refused(self, pipe, make_lctg):
        for model, message in ((make_lctg(), "must be a distilled decoder"), (pipe.dale, "must be a LCTGModel")):
            with pytest.raises(ValueError, match=f"`lctg_distilled` {message}"):
                TactileTexturePipeline.from_pipe(pipe, lctg_distilled=model)
        other = make_lctg(latent_hop=2 * pipe.lctg.config.latent_hop, distilled_steps=1)
        with pytest.raises(ValueError, match="does not fit `lctg_distilled`: it asks for `latent_hop`"):
            TactileTexturePipeline.from_pipe(pipe, lctg_distilled=other)


def test_a_subfolder_is_refused(saved):
    with pytest.raises(ValueError, match="`subfolder` must be left out, got 'lctg'"):
        TactileTexturePipeline.from_pretrained(saved, subfolder="lctg")


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


@pytest.mark.parametrize("name", ["dtype", "torch_dtype"])
def test_from_pipe_casts_the_models(make_pipeline, name):
    new = TactileTexturePipeline.from_pipe(make_pipeline(), **{name: torch.bfloat16})
    assert new.lctg.dtype == new.dale.dtype == torch.bfloat16
    assert np.isfinite(new([1.0, 0.0, 0.0]).textures).all()


def test_a_wrong_folder_or_class_is_answered_by_the_right_one(saved):
    with pytest.raises(OSError, match="`subfolder` must be one of .*dale.*lctg"):
        LCTGModel.from_pretrained(saved, subfolder="unet")
    with pytest.raises(OSError, match="`subfolder` must be one of .*dale.*lctg"):
        LCTGModel.from_pretrained(saved)
    with pytest.raises(ValueError, match="holds a DALEModel, no LCTGModel: load it by its own class"):
        LCTGModel.from_pretrained(saved, subfolder="dale")


def test_presets_are_ratings(pipe):
    ratings = parse_ratings(list(PRESETS.values()), pipe.dale.config)
    assert ratings.shape == (len(PRESETS), 3) and ratings[~ratings.isnan()].abs().max() <= 2
    assert PRESETS["denim"][2] > 0 > PRESETS["rubber"][2]  # slippery, sticky

"""Pipelines with another LCTG."""

from tactile_diffusers import VDDIMScheduler
from tactile_diffusers.cli.distilled import distilled_folder, with_lctg


def test_another_lctg_shares_all_but_schedulers(pipe, make_lctg):
    other, scheduler = make_lctg(seed=5), VDDIMScheduler(multistep_order=1)
    made, replaced = with_lctg(pipe, other), with_lctg(pipe, other, scheduler=scheduler)
    assert made.lctg is other and made.dale is pipe.dale and made.feature_extractor is pipe.feature_extractor
    assert made.scheduler is not pipe.scheduler and made.scheduler.config == pipe.scheduler.config
    assert made.dale_scheduler is not pipe.dale_scheduler
    assert replaced.scheduler is scheduler and replaced.lctg is other


def test_a_checkpoint_may_bring_a_distilled_one(make_lctg, tmp_path):
    assert distilled_folder(tmp_path) is None
    make_lctg().save_pretrained(tmp_path / "lctg_distilled")
    assert distilled_folder(str(tmp_path)) == tmp_path / "lctg_distilled"

"""Arguments of the training scripts that come from diffusers' examples: all are there, and do what they say."""

import argparse
import json
import re
import sys

import huggingface_hub
import pytest
import torch

from tactile_diffusers import bundled_checkpoint
from tactile_diffusers.training.launch import training_parser

#: Of diffusers' examples/unconditional_image_generation and examples/text_to_image; those that have no meaning here
#: are listed, with reasons, in `tactile_diffusers/training/launch.py`.
UPSTREAM = """
    pretrained_model_name_or_path model_config_name_or_path train_data_dir max_train_samples output_dir
    overwrite_output_dir seed train_batch_size eval_batch_size num_train_epochs max_train_steps
    gradient_accumulation_steps learning_rate lr_scheduler lr_warmup_steps adam_beta1 adam_beta2 adam_weight_decay
    max_grad_norm use_ema ema_decay mixed_precision dataloader_num_workers checkpointing_steps checkpoints_total_limit
    resume_from_checkpoint validation_steps report_to push_to_hub hub_model_id
""".split()


@pytest.mark.parametrize("name", ["train_lctg", "train_dale"])
def test_names_are_those_of_diffusers(script, name, capsys):
    with pytest.raises(SystemExit):
        script(name).parse_args(["--help"])
    words = capsys.readouterr().out.replace(",", " ").split()
    assert [argument for argument in UPSTREAM if f"--{argument}" not in words and f"[--{argument}" not in words] == []


def test_defaults_that_users_rely_on():
    parser = training_parser("a test")
    same = {"train_batch_size": 16, "num_train_epochs": 100, "gradient_accumulation_steps": 1, "max_grad_norm": 1.0}
    same |= {"checkpointing_steps": 500, "dataloader_num_workers": 0, "mixed_precision": "no"}
    same |= {"report_to": "tensorboard", "push_to_hub": False}
    assert {name: parser.get_default(name) for name in same} == same


COMMON = ["train_lctg", "train_dale", "distill"]
REFUSED = [
    *((name, value, COMMON) for name in ("train_batch_size", "max_train_steps") for value in ("0", "-3", "many")),
    *((name, "0", COMMON) for name in ("eval_batch_size", "num_train_epochs", "gradient_accumulation_steps")),
    *((name, "0", COMMON) for name in ("checkpointing_steps", "validation_steps", "max_train_samples")),
    ("checkpoints_total_limit", "0", COMMON),
    ("validation_samples", "-1", COMMON),
    *(("learning_rate", value, COMMON) for value in ("0", "-1e-3", "nan")),
    *(("ema_decay", value, COMMON) for value in ("1", "-0.1", "nan")),
    ("mixed_precision", "int8", COMMON),
    ("report_to", "fax", COMMON),
    *(("seed", value, COMMON) for value in ("x", "-1", str(2**32))),
    *(("lr_scheduler", value, COMMON) for value in ("cosin", "piecewise_constant")),
    *((name, "1.5", COMMON) for name in ("adam_beta1", "adam_beta2")),
    *((name, "-4", COMMON) for name in ("lr_warmup_steps", "max_grad_norm", "dataloader_num_workers")),
    ("adam_weight_decay", "-1", COMMON),
    *(("detail_dropout", value, ["train_lctg", "distill"]) for value in ("-0.1", "1.5", "nan")),
    *((name, "-1", ["train_lctg"]) for name in ("octave_exponent", "spectral_loss_weight")),
    *((name, "-1", ["train_lctg"]) for name in ("latent_penalty", "preemphasis_clip_db")),
    *((name, value, ["train_dale"]) for name in ("condition_dropout", "unconditional") for value in ("-0.1", "1.5")),
    *((name, "-1", ["train_dale"]) for name in ("rating_jitter", "scalar_weight", "conditioning_weight")),
    *((name, "0", ["train_dale"]) for name in ("max_train_surfaces", "rating_head_steps")),
    ("ratings", "mixed", ["train_dale"]),
    ("scalar_steps", "0", ["distill"]),
]


@pytest.mark.parametrize(("name", "value", "scripts"), REFUSED)
def test_impossible_values_are_refused_by_name(script, name, value, scripts, capsys):
    words = ["--train_data_dir=d.h5", "--output_dir=out"]
    for each in scripts:
        model = [] if each == "train_lctg" else ["--pretrained_model_name_or_path=lctg"]
        parse = script(each).parse_args
        parse([*words, *model])
        with pytest.raises(SystemExit) as stopped:
            parse([*words, *model, f"--{name}={value}"])
        assert stopped.value.code == 2
        assert re.search(rf"argument --{name}.*{re.escape(value)}", capsys.readouterr().err)


@pytest.mark.parametrize("name", ["train_lctg", "train_dale", "distill"])
def test_a_training_can_start_from_the_bundled_checkpoint(script, name):
    words = ["--train_data_dir=d.h5", "--output_dir=out", "--pretrained_model_name_or_path=bundled"]
    assert script(name).parse_args(words).pretrained_model_name_or_path == bundled_checkpoint()


def test_mixed_precision_keeps_trained_weights_wide(make_trainer, tmp_path):
    trainer = make_trainer(tmp_path, mixed_precision="bf16")
    seen, layer = [], trainer.module.model.time_embedder.linear_1
    layer.register_forward_hook(lambda module, args, out: seen.append(out.dtype))
    model = trainer.run()
    assert set(seen) == {torch.bfloat16}
    assert {parameter.dtype for parameter in model.parameters()} == {torch.float32}
    assert all(parameter.isfinite().all() for parameter in model.parameters())
    moments = [state["exp_avg"].dtype for state in trainer.optimizer.state.values()]
    assert moments and set(moments) == {torch.float32}


def test_a_missing_tracker_names_the_extra(make_trainer, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "tensorboard", None)
    with pytest.raises(ValueError, match=r"--report_to tensorboard needs: pip install .tactile-diffusers\[training\]"):
        make_trainer(tmp_path, report_to="tensorboard")


class TestHub:
    @pytest.fixture
    def sent(self, monkeypatch):
        """What is asked of the Hub, and the files of the folder at that moment."""
        asked = []

        def create_repo(repo_id, **options):
            asked.append((repo_id, options))
            return argparse.Namespace(repo_id=repo_id)

        monkeypatch.setattr(huggingface_hub, "create_repo", create_repo)
        monkeypatch.setattr(huggingface_hub, "upload_folder", lambda **options: asked.append(options))
        return asked

    def test_the_finished_pipeline_is_sent(self, script, run_script, sent, tmp_path):
        options = {"max_train_steps": 1, "report_to": "tensorboard", "hub_model_id": "someone/textures"}
        folder = run_script(script("train_lctg"), "lctg", tmp_path / "lctg", push_to_hub=True, **options)
        (repo, _), upload = sent
        assert repo == upload["repo_id"] == "someone/textures" and upload["folder_path"] == str(folder)
        assert "# someone/textures" in (folder / "README.md").read_text()
        assert "hub" not in (folder / "README.md").read_text().split("accelerate launch")[1].split("```")[0]
        assert json.loads((folder / "training.json").read_text())["arguments"]["push_to_hub"] is True

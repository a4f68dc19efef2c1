"""`examples/distill.py` on a tiny data set: both models learn, what is saved, and refusals."""

import copy

import pytest
import torch
from safetensors.torch import load_file

from tactile_diffusers import TactileTexturePipeline, VDDIMScheduler
from tactile_diffusers.training.steps import BatchNoise

WEIGHTS = "diffusion_pytorch_model.safetensors"


@pytest.fixture(scope="module")
def distill(script, run_script, teacher):
    """`distill(model, output, **options)` runs the script on the tiny data set and returns the output folder."""
    module, fixed = script("distill"), {"model_config_name_or_path": None, "scalar_steps": 4}
    fixed["pretrained_model_name_or_path"] = teacher
    return lambda model, output, **options: run_script(module, model, output, **(fixed | {"model": model} | options))


@pytest.fixture(scope="module")
def teacher(make_pipeline, tmp_path_factory):
    """A pipeline folder with random weights."""
    folder = tmp_path_factory.mktemp("teacher") / "teacher"
    make_pipeline().save_pretrained(folder)
    return folder


@pytest.fixture(scope="module")
def decoder(distill, tmp_path_factory):
    """The output folder of four steps of LCTG. Copy it before changing anything in it."""
    return distill("lctg", tmp_path_factory.mktemp("distilled") / "lctg", validation_steps=4)


@pytest.fixture(scope="module")
def pipeline(distill, tmp_path_factory):
    """The output folder of four steps of DALE."""
    return distill("dale", tmp_path_factory.mktemp("distilled") / "dale", validation_steps=4)


def _moved(first, second):
    first, second = load_file(str(first / WEIGHTS)), load_file(str(second / WEIGHTS))
    return {name.split(".")[0] for name in first if not torch.equal(first[name], second[name])}


class TestResult:
    def test_a_decoder_stands_beside_its_teacher(self, decoder, teacher):
        pipe = TactileTexturePipeline.from_pretrained(str(decoder))
        pipe.set_progress_bar_config(disable=True)
        assert pipe.resolve_steps() == (1, 5)
        out = pipe([[0.5, 0.0, 0.0]], generator=torch.Generator().manual_seed(0))
        assert torch.isfinite(torch.from_numpy(out.textures)).all() and pipe.num_timesteps == 6

    def test_only_the_decoder_has_moved(self, decoder, teacher):
        assert _moved(teacher / "lctg", decoder / "lctg_distilled") == {"decoder", "time_embedder"}
        assert not _moved(teacher / "lctg", decoder / "lctg")

    def test_dale_stands_in_a_whole_pipeline(self, pipeline, teacher):
        pipe = TactileTexturePipeline.from_pretrained(str(pipeline))
        assert pipe.resolve_steps() == (5, 1) and pipe.resolve_steps(10) == (10, 1)
        assert _moved(teacher / "dale", pipeline / "dale") and not _moved(teacher / "lctg", pipeline / "lctg")


def _losses(step, model, batch):
    """Losses of 40 updates on one batch with the same noise."""
    optimizer = torch.optim.Adam([p for p in model.parameters() if p.requires_grad], lr=2e-3)
    losses = []
    for _ in range(40):
        loss, _ = step(batch, BatchNoise(torch.Generator().manual_seed(1), torch.device("cpu")))
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        losses.append(loss.item())
    return losses


class TestLearning:
    """One batch can be learned by heart: the bounds leave room for slow starts."""

    def test_of_a_decoder(self, script, make_pipeline):
        module, pipe = script("distill"), make_pipeline(lctg_config={"latent_noise": 0.0})
        args = module.parse_args([*_WORDS, "--model", "lctg"])
        step = module.DecoderStep(
            copy.deepcopy(pipe.lctg), VDDIMScheduler(), pipe.feature_extractor, args.detail_dropout
        )
        generator = torch.Generator().manual_seed(0)
        batch = {
            "waveform": torch.randn((8, 512), generator=generator),
            "input_features": torch.randn((8, 24, 64), generator=generator),
        }
        losses = _losses(step, step.model.decoder, batch)
        assert losses[-1] < 0.9 * losses[0]

    def test_of_dale(self, script, make_pipeline):
        module, pipe = script("distill"), make_pipeline()
        states = torch.randn((32, pipe.dale.config.in_channels, 32), generator=torch.Generator().manual_seed(0))
        step = module.LatentStep(pipe.dale.train(), VDDIMScheduler(), states)
        batch = {"state": states[:16], "ratings": torch.zeros(16, 3), "ratings_error": torch.zeros(16, 3)}
        losses = _losses(step, pipe.dale, batch | {"weight": torch.ones(16)})
        assert losses[-1] < 0.9 * losses[0]


class TestRefusals:
    def test_a_distilled_teacher(self, distill, make_pipeline, tmp_path):
        make_pipeline(lctg_config={"distilled_steps": 2}).save_pretrained(tmp_path / "t")
        with pytest.raises(ValueError, match="is distilled already"):
            distill("lctg", tmp_path / "out", pretrained_model_name_or_path=tmp_path / "t")

    def test_a_missing_teacher(self, distill, make_pipeline, tmp_path):
        pipe = TactileTexturePipeline.from_pipe(make_pipeline(), dale=None, dale_scheduler=None, rating_estimator=None)
        pipe.save_pretrained(tmp_path / "t")
        with pytest.raises(ValueError, match="must hold the teacher of --model dale"):
            distill("dale", tmp_path / "out", pretrained_model_name_or_path=tmp_path / "t")

    def test_no_more_steps_are_taken_than_it_was_distilled_to(self, make_pipeline, recorded_warnings):
        pipe = make_pipeline(lctg_config={"distilled_steps": 2}, dale_config={"distilled_steps": 1})
        with recorded_warnings() as found:
            assert pipe.resolve_steps(5, 2) == pipe.resolve_steps(5, 2) == (2, 1)
        told = ("num_inference_steps` 5 is more than this LCTGModel", "num_latent_inference_steps` 2 is more")
        assert len(found) == 2 and all(words in text for words, text in zip(told, found, strict=True))


_WORDS = ["--train_data_dir", "data.h5", "--output_dir", "out", "--pretrained_model_name_or_path", "teacher"]

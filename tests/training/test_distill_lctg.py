"""`examples/distill_lctg.py` on a tiny data set: it comes nearer to its teacher, what it saves, and refusals."""

import copy

import pytest
import torch
from safetensors.torch import load_file

from tactile_diffusers import LCTGModel, TactileTexturePipeline, VDDIMScheduler
from tactile_diffusers.training.steps import BatchNoise

WEIGHTS = "diffusion_pytorch_model.safetensors"


@pytest.fixture(scope="module")
def distill(script, run_script, teacher):
    """`distill(output, **options)` runs the script on the tiny data set and returns the output folder."""
    module, fixed = script("distill_lctg"), {"model_config_name_or_path": None, "teacher_steps": 4}
    fixed["pretrained_model_name_or_path"] = teacher
    return lambda output, **options: run_script(module, "lctg", output, **(fixed | options))


@pytest.fixture(scope="module")
def teacher(make_pipeline, tmp_path_factory):
    """A pipeline folder with random weights."""
    folder = tmp_path_factory.mktemp("teacher") / "teacher"
    make_pipeline().save_pretrained(folder)
    return folder


@pytest.fixture(scope="module")
def distilled(distill, tmp_path_factory):
    """The output folder of four steps. Copy it before changing anything in it."""
    return distill(tmp_path_factory.mktemp("distilled") / "lctg", validation_steps=4)


def _arguments(script, teacher, prepared, output, **options):
    words = ["--train_data_dir", str(prepared), "--output_dir", str(output)]
    words += ["--pretrained_model_name_or_path", str(teacher)]
    for name, value in options.items():
        words += [f"--{name}", *map(str, value if isinstance(value, list) else [value])]
    return script("distill_lctg").parse_args(words)


class TestResult:
    def test_takes_the_teachers_place(self, distilled, teacher):
        lctg = LCTGModel.from_pretrained(str(distilled), subfolder="lctg_distilled")
        pipe = TactileTexturePipeline.from_pretrained(str(teacher), lctg=lctg)
        pipe.set_progress_bar_config(disable=True)
        assert pipe.resolve_steps() == (2, 5)
        out = pipe([[0.5, 0.0, 0.0]], generator=torch.Generator().manual_seed(0))
        assert torch.isfinite(torch.from_numpy(out.textures)).all() and pipe.num_timesteps == 7

    def test_only_the_decoder_has_moved(self, distilled, teacher):
        first = load_file(str(teacher / "lctg" / WEIGHTS))
        second = load_file(str(distilled / "lctg_distilled" / WEIGHTS))
        moved = {name.split(".")[0] for name in first if not torch.equal(first[name], second[name])}
        assert moved == {"decoder", "time_embedder"}


class TestLearning:
    def test_loss_falls_on_a_batch(self, script, make_pipeline, prepared, tmp_path):
        module, pipe = script("distill_lctg"), make_pipeline(lctg_config={"latent_noise": 0.0})
        args = _arguments(script, tmp_path, prepared, tmp_path, teacher_steps=4)
        student = copy.deepcopy(pipe.lctg)
        step = module.DistillationStep(student, pipe.lctg, VDDIMScheduler(), pipe.feature_extractor, args)
        generator = torch.Generator().manual_seed(0)
        batch = {
            "waveform": torch.randn((8, 512), generator=generator),
            "input_features": torch.randn((8, 24, 64), generator=generator),
        }
        optimizer = torch.optim.Adam(student.decoder.parameters(), lr=2e-3)
        losses = []
        for _ in range(30):
            loss, _ = step(batch, BatchNoise(torch.Generator().manual_seed(1), torch.device("cpu")))
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            losses.append(loss.item())
        assert losses[-1] < 0.7 * losses[0]  # one batch can be learned by heart: 0.7 leaves room for slow starts


class TestRefusals:
    def test_a_distilled_teacher(self, distill, make_pipeline, tmp_path):
        make_pipeline(lctg_config={"distilled_steps": 2}).save_pretrained(tmp_path / "t")
        with pytest.raises(ValueError, match="is distilled already"):
            distill(tmp_path / "out", pretrained_model_name_or_path=tmp_path / "t")

    def test_more_steps_than_it_was_distilled_to(self, make_pipeline):
        pipe = make_pipeline(lctg_config={"distilled_steps": 2})
        with pytest.raises(ValueError, match="must be at most 2, got 5: this LCTG was distilled"):
            pipe([[0, 0, 0]], num_inference_steps=5)
        with pytest.raises(ValueError, match="must be at most 2, got 3"):
            pipe.reconstruct(torch.zeros(4096).numpy(), 10_000, 3)

"""`examples/publish.py` on a tiny pipeline: weights, card, report, and sending it to a Hub whose calls are patched."""

import copy
import json
import re
from types import SimpleNamespace

import evaluate
import huggingface_hub
import publish
import pytest
import torch
from data_card import write_card
from huggingface_hub import ModelCard
from safetensors.torch import load_file

from tactile_diffusers import TactileTexturePipeline
from tactile_diffusers.data import PreparedDataset
from tactile_diffusers.pipelines.folders import folder_digest
from tactile_diffusers.training.record import surfaces_of, trained_on

RECORD = {
    "script": "examples/train_dale.py",
    "arguments": {"seed": 3, "train_data_dir": "/somewhere/prepared.h5", "quiet": True, "overwrite_output_dir": False},
    "segments": 7,
    "steps": 9,
    "changed": {"seed": 3, "train_data_dir": "/somewhere/prepared.h5"},
    "processes": 1,
    "machine": "a test",
    "versions": {"torch": "2", "diffusers": "0"},
}
LOG = [{"step": 9, "train/loss": 0.5, "seconds": 180.0}, {"step": 9, "validation/velocity": 0.25}]


@pytest.fixture
def run(tmp_path):
    """The output folder of a training, as far as a card tells of it."""
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / "training.json").write_text(json.dumps(RECORD))
    (folder / "log.jsonl").write_text("".join(json.dumps(entry) + "\n" for entry in LOG))
    (folder / "loss.png").write_bytes(b"png")
    return folder


@pytest.fixture
def words(checkpoint, run, prepared, tmp_path):
    """The command's words; the output is `tmp_path / "small"`."""
    return f"--checkpoint {checkpoint} --runs {run} --data {prepared} --output {tmp_path / 'small'}".split()


def refused(words, capsys):
    """What is said on stderr, in one line, while the command ends with 2."""
    capsys.readouterr()
    assert publish.main(words) == 2
    told = capsys.readouterr().err.splitlines()
    assert told[-1].startswith("publish.py: error: ") and not any("Traceback" in line for line in told)
    return told[-1]


def card_of(folder):
    return (folder / "README.md").read_text(encoding="utf-8")


class TestFolder:
    def test_weights_are_halved_and_the_texture_is_kept(self, words, checkpoint, tmp_path, capsys):
        out = tmp_path / "small"
        assert publish.main(words) == 0
        (out / "loss_7.png").write_text("replaced as a whole")
        assert publish.main(words) == 0
        assert "MB, in place of what the folder held" in capsys.readouterr().out
        assert not (out / "loss_7.png").exists() and (out / "loss_1.png").read_bytes() == b"png"
        assert not list(tmp_path.glob(".*"))
        full, small = (TactileTexturePipeline.from_pretrained(str(folder)) for folder in (checkpoint, out))
        for pipe in (full, small):
            pipe.set_progress_bar_config(disable=True)
        assert small.lctg.dtype == small.dale.dtype == torch.float32
        make = dict(ratings=[[1.0, 0.0, -1.0]], num_inference_steps=2)
        first, second = (p(generator=torch.Generator().manual_seed(0), **make).textures for p in (full, small))
        # half precision keeps 11 bits: weights move by 5e-4 at most, textures by a few times that
        assert abs(first - second).max() < 0.02 * abs(first).max()

    def test_card_tells_of_data_and_training_and_its_code_runs(self, words, tmp_path, monkeypatch):
        publish.main([*words, "--note", "Ran at night.", "--licence", "apache-2.0"])
        card = card_of(tmp_path / "small")
        assert "# small\n" in card and "--seed 3" in card and "Ran at night." in card
        assert "3 minutes" in card and "velocity 0.250" in card and "/somewhere" not in card
        assert "stored in half precision" in card and ModelCard(card).data.license == "apache-2.0"
        assert "evaluate.py --checkpoint small --data p.h5" in card and "unfinished" not in card
        monkeypatch.chdir(tmp_path)
        [code] = re.findall(r"```python\n(.*?)```", card, re.S)
        made = {}
        exec(code, made)
        assert made["out"].textures.shape == (1, 8192)

    def test_a_pipeline_that_only_reconstructs(self, words, evaluable_pipe, tmp_path):
        evaluable_pipe(dale=False).save_pretrained(str(tmp_path / "decoder"))
        assert publish.main([*words, "--checkpoint", str(tmp_path / "decoder")]) == 0
        assert "pipe.reconstruct" in card_of(tmp_path / "small")

    def test_a_distilled_decoder_goes_along(self, words, evaluable_pipe, tmp_path):
        pipe = evaluable_pipe()
        distilled = copy.deepcopy(pipe.lctg)
        distilled.register_to_config(distilled_steps=2)
        pipe.register_modules(lctg_distilled=distilled)
        pipe.save_pretrained(str(tmp_path / "both"))
        assert publish.main([*words, "--checkpoint", str(tmp_path / "both")]) == 0
        out = tmp_path / "small"
        assert TactileTexturePipeline.from_pretrained(out).resolve_steps() == (2, 5)
        weights = load_file(out / "lctg_distilled" / "diffusion_pytorch_model.safetensors")
        assert weights.popitem()[1].dtype == torch.float16
        assert "More than 2 steps of LCTG are" in card_of(out)


class TestReport:
    @pytest.fixture
    def report(self, checkpoint, prepared, tmp_path):
        """What evaluate.py writes for the checkpoint, of one section."""
        arguments = f"--checkpoint {checkpoint} --data {prepared} --output {tmp_path / 'evaluated'} --steps 2"
        evaluate.main([*arguments.split(), "--quick", "--quiet", "--sections", "reconstruction"])
        return tmp_path / "evaluated"

    def test_its_tables_and_pictures_are_in_the_card(self, words, report, make_pipeline, tmp_path, capsys):
        publish.main([*words, "--report", str(report)])
        out = tmp_path / "small"
        card = card_of(out)
        assert "#### Overview" in card and "### Report" in card and "another take" in card
        assert "None yet" not in card
        pictures = re.findall(r"!\[.*?\]\((report/.*?)\)", card)
        assert pictures and {path.name for path in (out / "report").iterdir()} == {p.split("/")[1] for p in pictures}
        # a picture that is gone, and a checkpoint that was not measured
        (report / "overlays.png").unlink()
        assert "lacks ['overlays.png']" in refused([*words, "--report", str(report)], capsys)
        make_pipeline(seed=5).save_pretrained(str(tmp_path / "other"))
        told = refused([*words, "--report", str(report), "--checkpoint", str(tmp_path / "other")], capsys)
        assert "is of another checkpoint (pipeline)" in told
        assert card_of(out) == card

    def test_surfaces_that_training_had_are_told_of(self, words, run, checkpoint, prepared, tmp_path, capsys):
        """The data were split anew after the training: what judges it now is what it learned from."""
        judged = surfaces_of(PreparedDataset(prepared, "test"))
        (run / "training.json").write_text(json.dumps(RECORD | {"trained_on": judged}))
        (checkpoint / "training.json").write_text((run / "training.json").read_text())
        arguments = f"--checkpoint {checkpoint} --data {prepared} --output {tmp_path / 'evaluated'} --steps 2"
        evaluate.main([*arguments.split(), "--quick", "--quiet", "--sections", "reconstruction"])
        told = "the checkpoint was trained on 2 of the 2 surfaces that judge it"
        assert f"warning: {told}" in capsys.readouterr().err
        first = (tmp_path / "evaluated" / "report.md").read_text().splitlines()[2]
        assert first.startswith(f"**Warning: {told}")
        publish.main([*words, "--report", str(tmp_path / "evaluated")])
        assert told in capsys.readouterr().err
        card, published = card_of(tmp_path / "small"), tmp_path / "small"
        assert told in card and not any(name in card for name in judged["surfaces"])
        # what is published says it again, and is no other checkpoint for it
        assert trained_on([published]) == ([judged], True)
        before = folder_digest(published)
        (published / "trained_on.json").unlink()
        assert folder_digest(published) == before

    def test_surfaces_that_the_data_train_on_are_told_of(self, words, report, capsys):
        """Nothing is recorded of the training, but --data is what it was trained on."""
        written = json.loads((report / "report.json").read_text())
        data = PreparedDataset(words[words.index("--data") + 1])
        assert written["seen_in_training"] is None and "trained on" not in (report / "report.md").read_text()
        written["judged"] = surfaces_of(data)
        (report / "report.json").write_text(json.dumps(written))
        publish.main([*words, "--report", str(report)])
        assert f"on {len(written['judged']['surfaces'])} of the " in capsys.readouterr().err

    def test_warnings_of_the_data_card_are_in_the_card(self, words, prepared, tmp_path, capsys):
        recordings = prepared.parent / "r.h5"
        card = write_card(recordings, tmp_path / "data", prepared, quiet=True)
        publish.main([*words, "--data_card", str(tmp_path / "data")])
        published = card_of(tmp_path / "small")
        assert card["warnings"] and all(warning["text"] in published for warning in card["warnings"])
        assert "inspect_data.py" not in published
        card["recordings"]["surfaces"] = 99
        (tmp_path / "data" / "card.json").write_text(json.dumps(card))
        told = refused([*words, "--data_card", str(tmp_path / "data")], capsys)
        assert "describes 99 surfaces of 'virtual surfaces', --data holds 8" in told


class TestHub:
    def test_the_finished_folder_is_sent(self, words, tmp_path, monkeypatch, capsys):
        asked = []
        repository = SimpleNamespace(repo_id="someone/textures")
        monkeypatch.setattr(huggingface_hub, "create_repo", lambda *a, **k: asked.append((a, k)) or repository)
        monkeypatch.setattr(huggingface_hub, "upload_folder", lambda **options: asked.append(options))
        assert publish.main([*words, "--push_to_hub", "someone/textures"]) == 0
        (repo, _), sent = asked
        assert repo == ("someone/textures",) and sent["repo_id"] == "someone/textures"
        assert sent["folder_path"] == str(tmp_path / "small")
        card = card_of(tmp_path / "small")
        assert "# someone/textures" in card and 'from_pretrained("someone/textures")' in card
        assert "https://huggingface.co/someone/textures" in capsys.readouterr().out

    def test_a_refusal_leaves_the_folder_and_is_told(self, words, tmp_path, monkeypatch, capsys):
        def refuse(*_, **__):
            raise OSError("403 Forbidden")

        monkeypatch.setattr(huggingface_hub, "create_repo", refuse)
        assert publish.main([*words, "--push_to_hub", "someone/textures"]) == 1
        assert "is written, but the Hub refused it: 403 Forbidden" in capsys.readouterr().err
        assert (tmp_path / "small" / "README.md").is_file()


@pytest.mark.parametrize(
    ("extra", "message"),
    [
        (["--push_to_hub", "textures"], "must be USER/NAME, got 'textures'"),
        (["--push_to_hub", "a/b/c"], "must be USER/NAME"),
        (["--report", "nowhere"], "nowhere has no report.json; it is written by examples/evaluate.py"),
        (["--data_card", "nowhere"], "nowhere has no card.json; it is written by examples/inspect_data.py"),
        (["--runs", "nowhere"], "nowhere has no training.json"),
    ],
)
def test_bad_arguments_are_refused_before_any_work(words, tmp_path, capsys, extra, message):
    with pytest.raises(SystemExit) as stop:
        publish.main([*words, *extra])
    assert stop.value.code == 2 and message in capsys.readouterr().err
    assert not (tmp_path / "small").exists()

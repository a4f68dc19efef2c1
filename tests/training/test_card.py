"""The model card: its code runs as printed, its commands make the same training, it names nothing of this machine."""

import json
import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest
from huggingface_hub import ModelCard

from tactile_diffusers import bundled_checkpoint
from tactile_diffusers.data import PreparedDataset
from tactile_diffusers.training.card import write_card

#: Options of those of `runs`.
TINY = {"max_train_steps": 2, "validation_steps": 2, "no-use_ema": True}


@pytest.fixture
def dataset(prepared):
    return PreparedDataset(prepared, "train")


def card_of(folder):
    return (folder / "README.md").read_text(encoding="utf-8")


def blocks(card, language):
    return re.findall(rf"```{language}\n(.*?)```", card, re.S)


def words_of(command):
    return shlex.split(command.replace("\\\n", ""))  # as a shell continues lines


def run(code):
    made = {}
    exec(compile(code, "card", "exec"), made)
    return made["out"]


class TestAfterTraining:
    @pytest.mark.parametrize("name", ["lctg", "dale", "distilled"])
    def test_usage_runs_as_printed(self, runs, name, monkeypatch, capsys):
        monkeypatch.chdir(runs)
        codes = blocks(card_of(runs / name), "python")
        assert len(codes) == 1
        out = run(codes[0])
        assert out.textures.shape == (1, 2048) and np.isfinite(out.textures).all()
        assert capsys.readouterr().out.startswith("(1, 2048) 10000")

    @pytest.mark.parametrize(("name", "pictures"), [("lctg", 1), ("dale", 2), ("distilled", 3)])
    def test_the_hub_reads_it_and_it_names_nothing_of_this_machine(self, runs, prepared, name, pictures):
        text = card_of(runs / name)
        card = ModelCard(text)
        assert card.data.library_name == "diffusers" and {"tactile", "haptics"} <= set(card.data.tags)
        assert card.data.license == "cc0-1.0"  # that of virtual surfaces
        assert card.text.strip().startswith(f"# {name}\n")
        assert str(runs) not in text and str(prepared.parent) not in text
        assert not re.search(r"(?<![\w.)])/(tmp|home|root|work|usr|mnt|var)\b", text)
        assert "{" not in text and "None" not in text.replace("None yet", "")
        curves = re.findall(r"!\[.*?\]\((.*?)\)", text)  # of all phases
        assert len(curves) == pictures
        assert all((runs / name / curve).read_bytes()[:8] == b"\x89PNG\r\n\x1a\n" for curve in curves)

    def test_data_configuration_and_limits_are_told(self, runs):
        card = card_of(runs / "dale")
        for told in (
            *(
                "| source | virtual surfaces |",
                "| licence | CC0-1.0 |",
                "train 4, validation 1, test 1",
                "| seed | 3 |",
            ),
            *("normal force 0.4 to 0.6", "| band | 20 to 1000 |", "Cronbach's alpha 0"),
            *("| parameters | LCTG 0.0195 million, DALE", "LCTG 5 of VDDIMScheduler, DALE 5 of VDDIMScheduler"),
            *("2500 Hz inside, 10000 Hz delivered", "| reference speed | 8"),
            *("Virtual surfaces are simulated", "act as its ends do: roughness -", "No person has felt"),
            *("### lctg", "### dale", "Last validation: velocity_rated", "examples/evaluate.py --checkpoint dale"),
        ):
            assert told in card, told
        assert "train DALE on it" in card_of(runs / "lctg")
        assert "### distilled" in card_of(runs / "distilled") and "distilled LCTG 0.0" in card_of(runs / "distilled")

    def test_the_command_names_what_differs_from_the_defaults_and_gives_the_same_training(self, runs, script):
        launcher, launch, _, *words = words_of(blocks(card_of(runs / "dale"), "bash")[1])
        assert (launcher, launch) == ("accelerate", "launch")
        assert "--no-use_ema" in words and "--conditioning_weight" in words
        assert not {"--seed", "--adam_beta1", "--quiet"} & set(words)
        assert words[words.index("--report_to") + 1] == "none"  # else it asks for a tracker
        again = vars(script("train_dale").parse_args(words))
        record = json.loads((runs / "dale" / "training.json").read_text())
        for name, value in record["arguments"].items():
            if name != "quiet":
                assert str(again[name]) == str(value).rsplit("/", 1)[-1], name
        assert set(record["changed"]) < set(record["arguments"])

    def test_a_second_phase_tells_of_the_first(self, runs, script, run_script, tmp_path):
        options = TINY | {"pretrained_model_name_or_path": runs / "lctg", "subset": "full"}
        output = run_script(script("train_lctg"), "lctg", tmp_path / "second", **options)
        card = card_of(output)
        assert card.index("### lctg") < card.index("### second") and "--subset full" in card
        assert "(full), prepared by" in card and "| limits" not in card


def test_the_bundled_checkpoint_has_its_name_and_code_that_runs(monkeypatch):
    folder = Path(bundled_checkpoint())
    card = card_of(folder)
    assert ModelCard(card).text.strip().startswith(f"# {folder.name}\n")
    monkeypatch.chdir(folder.parent)
    codes = blocks(card, "python")
    assert len(codes) == 1
    assert run(codes[0]).textures.shape == (1, 16384)


class TestWriting:
    """`write_card` with what the scripts do not give it."""

    @pytest.fixture
    def folder(self, runs, tmp_path):
        return shutil.copytree(runs / "dale", tmp_path / "dale")

    def test_surfaces_that_nobody_rated(self, folder, pipe, dataset, monkeypatch):
        dataset.ratings.mean = np.full_like(dataset.ratings.mean, np.nan)
        write_card(folder, pipe, dataset, [])
        monkeypatch.chdir(folder.parent)
        card = card_of(folder)
        assert "pipe(ratings=None)" in card
        assert run(blocks(card, "python")[0]).textures.shape == (1, 2048)

    def test_data_without_newtons_or_normal_force_say_so(self, folder, pipe, dataset):
        dataset.unit, dataset.source = "1", "a sensor"
        dataset.friction_coefficients = np.full_like(dataset.friction_coefficients, np.nan)
        write_card(folder, pipe, dataset, [])
        card = card_of(folder)
        assert "uncalibrated" in card and "have no normal force" in card
        assert "Virtual surfaces are simulated" not in card

    @pytest.mark.parametrize(
        ("licence", "expected"),
        [
            ("CC BY-NC 4.0", {"license": "cc-by-nc-4.0"}),
            ("Apache-2.0", {"license": "apache-2.0"}),
            ("ask us: first", {"license": "other", "license_name": "ask us: first"}),
        ],
    )
    def test_licences(self, folder, pipe, dataset, licence, expected):
        dataset.attributes = dataset.attributes | {"licence": licence}
        write_card(folder, pipe, dataset, [])
        data = ModelCard(card_of(folder)).data.to_dict()
        assert {key: data[key] for key in expected} == expected
        write_card(folder, pipe, dataset, [], licence="mit")
        assert ModelCard(card_of(folder)).data.license == "mit"

    def test_a_training_that_lost_its_log(self, folder, pipe, dataset):
        (folder / "log.jsonl").unlink()
        (folder / "loss.png").unlink()
        write_card(folder, pipe, dataset, [folder])
        card = card_of(folder)
        assert "an unknown time" in card and "![loss" not in card and "Last training loss" not in card

    def test_values_of_a_command_are_quoted(self, folder, pipe, dataset):
        record = json.loads((folder / "training.json").read_text())
        record["changed"] = {"output_dir": "/home/me/my runs", "scalar_steps": [1, 2]}
        (folder / "training.json").write_text(json.dumps(record))
        write_card(folder, pipe, dataset, [folder])
        words = words_of(blocks(card_of(folder), "bash")[0])
        assert words[3:] == ["--output_dir", "my runs", "--scalar_steps", "1", "2"]

"""`examples/make_study.py`: from a checkpoint to a report of simulated participants, and refusals."""

import json
import shutil

import make_study
import pandas
import pytest


@pytest.fixture
def make(evaluable_pipe, prepared, tmp_path):
    """A function of further words: makes a study of two surfaces in tmp_path/study, returns the exit code."""
    evaluable_pipe().save_pretrained(str(tmp_path / "pipeline"))
    words = f"make --data {prepared} --checkpoint {tmp_path / 'pipeline'} --output {tmp_path / 'study'} --quiet"
    return lambda extra="": make_study.main(f"{words} --surfaces 2 --baselines ridge {extra}".split())


def test_from_stimuli_to_a_report(make, tmp_path, capsys):
    assert make("--participants 4") == 0
    study = tmp_path / "study"
    assert capsys.readouterr().out == ""  # quiet
    assert len(list((study / "trials").iterdir())) == 4
    assert make_study.main(f"rehearse --study {study} --repeats 2 --dprime ridge=4".split()) == 0
    printed = capsys.readouterr()
    assert "SIMULATED" in printed.out and "ABX unlike another take" in printed.out
    facts = json.loads((study / "rehearsal/power.json").read_text())
    assert facts["simulated"] and facts["participants"] == 4 and facts["repeats"] == 2
    # what they answered goes through the same door as the answers of people
    words = (
        f"analyse --study {study} --responses {study / 'rehearsal/responses'} --output {tmp_path / 'report'} --quiet"
    )
    assert make_study.main(words.split()) == 0
    first, second = (json.loads((p / "report.json").read_text()) for p in (study / "rehearsal", tmp_path / "report"))
    assert first == second and first["simulated"]
    assert (tmp_path / "report" / "report.md").read_text() == (study / "rehearsal" / "report.md").read_text()


def test_filled_in_lists_are_analysed(make, tmp_path, capsys):
    assert make("--participants 1 --tasks rating --level natural --full-scale 0.001") == 0
    study, responses = tmp_path / "study", tmp_path / "responses"
    responses.mkdir()
    trials = pandas.read_csv(study / "trials/participant_001.csv", dtype=str)
    trials.assign(response="4").to_csv(responses / "one.csv", index=False)
    words = f"analyse --study {study} --responses {responses} --output {tmp_path / 'report'}"
    assert make_study.main(words.split()) == 0
    assert "SIMULATED" not in capsys.readouterr().out
    trials.assign(response=["9", *["4"] * (len(trials) - 1)]).to_csv(responses / "one.csv", index=False)
    assert make_study.main(words.split()) == 2
    assert "one.csv, participant p001, trial 1, response '9'" in capsys.readouterr().err
    trials.assign(response=["", *["4"] * (len(trials) - 1)]).to_csv(responses / "one.csv", index=False)
    assert make_study.main(words.split()) == 2 and make_study.main([*words.split(), "--allow-missing"]) == 0
    assert json.loads((tmp_path / "report/report.json").read_text())["missing"] == 1
    assert json.loads((study / "experimenter/study.json").read_text())["attenuation_db"] > 0


@pytest.mark.parametrize("extra", ["--surfaces 1", "--surfaces 50", "--full-scale -1"])
def test_impossible_studies_are_refused_in_one_line(make, extra, tmp_path, capsys):
    assert make(extra) == 2
    error = capsys.readouterr().err.splitlines()[-1]  # after diffusers' bar of loading
    assert error.startswith("make_study.py: error:")
    assert not (tmp_path / "study").exists()


@pytest.mark.parametrize(
    "words",
    [
        "",
        "make --data nowhere.h5 --output x",
        f"make --data {__file__} --output x --participants 0",
        f"make --data {__file__} --output x --checkpoint nowhere",
        "rehearse --study x --dprime generated=loud",
    ],
)
def test_bad_arguments_end_with_code_2(words, capsys):
    with pytest.raises(SystemExit) as stop:
        make_study.main(words.split())
    assert stop.value.code == 2 and "error" in capsys.readouterr().err


def test_answers_of_another_study_are_refused(make, tmp_path, capsys):
    assert make("--participants 1 --tasks rating") == 0
    shutil.copytree(tmp_path / "study/trials", tmp_path / "responses")
    path = tmp_path / "responses/participant_001.csv"
    trials = pandas.read_csv(path, dtype=str, keep_default_na=False)
    trials.assign(response="4", stimulus_a=trials["stimulus_a"].iloc[::-1].to_numpy()).to_csv(path, index=False)
    words = f"analyse --study {tmp_path / 'study'} --responses {tmp_path / 'responses'} --output {tmp_path / 'r'}"
    assert make_study.main(words.split()) == 2
    assert "another `stimulus_a` than in the trial list" in capsys.readouterr().err

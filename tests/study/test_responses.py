"""Answers that cannot be right are refused by file, participant and trial."""

import pytest
from study import check_responses, participant_trials, read_tables


@pytest.fixture
def trials(make_key):
    return participant_trials(make_key(surfaces=3), 1, seed=0)


@pytest.fixture
def filled(trials):
    """The list with an answer that fits each task."""
    fitting = {"abx": "A", "similarity": "70", "rating": "3"}
    return trials.assign(response=trials["task"].map(fitting), trial=trials["trial"].astype(str))


def _first(filled, task):
    return filled.index[filled["task"] == task][0]


def test_complete_answers_are_taken(trials, filled):
    filled.loc[_first(filled, "abx"), "response"] = "b"  # small letters are fine
    answers, missing = check_responses(trials, filled)
    assert missing == 0 and len(answers) == len(trials)
    assert set(answers.loc[answers["task"] == "abx", "response"]) == {"A", "B"}
    assert answers.loc[answers["task"] == "abx", "value"].isna().all()
    assert set(answers["value"].dropna()) == {70.0, 3.0}


@pytest.mark.parametrize(
    ("task", "response", "message"),
    [
        ("abx", "X", "ABX that is not A or B"),
        ("similarity", "101", "similarity that is no number from 0 to 100"),
        ("similarity", "alike", "similarity that is no number"),
        ("rating", "-1", "rating that is no number from 0 to 8"),
        ("rating", "8.5", "rating that is no number from 0 to 8"),
        ("rating", "nan", "rating that is no number"),
        ("rating", "", "1 trials are not answered, first p001"),
    ],
)
def test_answers_off_the_scale_are_refused(trials, filled, task, response, message):
    filled.loc[_first(filled, task), "response"] = response
    with pytest.raises(ValueError, match=message):
        check_responses(trials, filled)


@pytest.mark.parametrize(
    ("column", "value", "message"),
    [
        ("participant", "p999", "participants without a trial list: table, participant p999"),
        ("trial", "100000", "trials that are not in the participant's list"),
        ("trial", "one", "trials that are not in the participant's list"),
        ("trial", "2", "trials that are answered twice"),
        ("stimulus_a", "unknwn", "another `stimulus_a` than in the trial list"),
        ("task", "taste", "another `task`"),
        ("participant", "simulated001", "are simulated, others are not"),
    ],
)
def test_rows_that_belong_nowhere_are_refused(trials, filled, column, value, message):
    filled.loc[0, column] = value
    with pytest.raises(ValueError, match=message):
        check_responses(trials, filled)


def test_missing_answers_may_be_left_out(trials, filled):
    filled.loc[3, "response"] = ""
    answers, missing = check_responses(trials, filled.drop(index=5), allow_missing=True)
    assert missing == 2 and len(answers) == len(trials) - 2


def test_bad_tables_are_named(filled, tmp_path):
    with pytest.raises(FileNotFoundError, match="no .csv file"):
        read_tables(tmp_path)
    filled.to_csv(tmp_path / "semicolons.csv", index=False, sep=";")
    with pytest.raises(ValueError, match=r"semicolons.csv lacks the columns .*export it with commas"):
        read_tables(tmp_path)
    (tmp_path / "semicolons.csv").write_bytes(b"")
    with pytest.raises(ValueError, match="semicolons.csv cannot be read as a table"):
        read_tables(tmp_path)


@pytest.mark.parametrize("what", ["empty rows below the last one", "a comma after each row", "a Mac's file beside it"])
def test_what_spreadsheets_and_file_systems_add_does_not_matter(trials, filled, tmp_path, what):
    text = filled.to_csv(index=False)
    if what.startswith("empty"):
        text += 2 * ("," * (filled.shape[1] - 1) + "\n")
    elif what.startswith("a comma"):
        names, *rows = text.splitlines()
        text = "\n".join([names, *(f"{row}," for row in rows)])
    else:
        (tmp_path / "._p001.csv").write_bytes(b"\0\5\26\7\0\2\0\0Mac OS X")
    (tmp_path / "p001.csv").write_text(text, encoding="utf-8")
    answers, _ = check_responses(trials, read_tables(tmp_path))
    assert len(answers) == len(trials) and set(answers["participant"]) == {"p001"}

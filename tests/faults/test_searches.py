"""A saved preference search: whole and of this checkpoint, or refused by name."""

import json

import numpy as np
import pytest

from tactile_diffusers.search import PreferenceSearch


@pytest.fixture
def case(make_pipeline, damaged, tmp_path):
    pipe, path = (
        make_pipeline(dale_config={"scalar_width": 16, "distilled_steps": 1}),
        tmp_path / "good" / "search.json",
    )
    path.parent.mkdir()
    search = PreferenceSearch(pipe, seed=3)
    for answer in ("first", "neither", "second"):
        search.next_pair()
        search.answer(answer)
    search.save(path)

    def read(path):
        found = PreferenceSearch.load(path, pipe)
        return [np.array([entry["first"], entry["second"]]) for entry in found.answers] + [found.best_point()[0]]

    return damaged(path, read)


def test_damage(case, flips, foreign):
    case.whole = False  # a line break at the end is no part of it
    case.damage(flips, foreign.values())


def test_a_key_is_absurd(case, refusal, odd_values):
    content = json.loads(case.content)
    for key in content:
        for odd in odd_values:
            changed = {name: value for name, value in content.items() if name != key}
            if odd != "missing":
                changed[key] = odd
            result, message = refusal(case.read, case.put(json.dumps(changed).encode()))
            assert message or case.sane(result), (key, odd)


def test_an_answer_is_absurd(case, refusal, odd_values):
    content = json.loads(case.content)
    for key in ("answer", "first", "second"):
        for odd in odd_values[1:]:
            answers = [{**content["answers"][0], key: odd}, *content["answers"][1:]]
            result, message = refusal(case.read, case.put(json.dumps({**content, "answers": answers}).encode()))
            assert message or case.sane(result), (key, odd)

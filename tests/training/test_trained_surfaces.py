"""Which surfaces a checkpoint was trained on: kept through phases, counted by name and seed."""

import json

import pytest

from tactile_diffusers.data import PreparedDataset
from tactile_diffusers.training.record import count_seen, surfaces_of, trained_on, warning, write_surfaces


def _told(*names, seed=None):
    return {"source": "a test", "seed": seed, "surfaces": list(names)}


def _training(folder, told=None, before=None):
    folder.mkdir()
    arguments = {} if before is None else {"pretrained_model_name_or_path": str(before)}
    record = {"arguments": arguments} | ({} if told is None else {"trained_on": told})
    (folder / "training.json").write_text(json.dumps(record))
    return folder


def test_phases_and_published_checkpoints_are_followed_back(tmp_path):
    published = tmp_path / "published"
    published.mkdir()
    write_surfaces(published, [_told("cork")], True)
    first = _training(tmp_path / "first", _told("denim", "glass"), before=published)
    last = _training(tmp_path / "last", _told("denim"), before=first)
    assert trained_on([last]) == ([_told("cork"), _told("denim", "glass"), _told("denim")], True)
    write_surfaces(published, [_told("cork")], False)
    assert trained_on([first, last])[1] is False


@pytest.mark.parametrize("content", ["{", "[]", '{"trained_on": 3}', '{"trained_on": [3, {"surfaces": "x"}]}'])
def test_a_phase_that_does_not_say_leaves_it_open(tmp_path, content):
    old = _training(tmp_path / "old")
    (old / "trained_on.json").write_text(content)
    assert trained_on([old]) == ([], False) == trained_on([])
    last = _training(tmp_path / "last", _told("denim"), before=old)
    assert trained_on([last]) == ([_told("denim")], False)
    write_surfaces(tmp_path, [], False)
    assert not (tmp_path / "trained_on.json").exists()


def test_names_count_and_the_seed_of_virtual_surfaces():
    found = [_told("a", "b", seed=1), _told("c")]
    assert count_seen(_told("a", "b", "x", seed=1), found) == 2
    assert count_seen(_told("a", "b", seed=2), found) == 0 == count_seen(_told("a"), found)
    assert count_seen(_told("c") | {"source": "in other words"}, found) == 1


def test_nothing_is_said_where_nothing_is_known():
    assert warning(None, 3) == "" == warning(0, 3)
    assert "trained on 2 of the 3 surfaces" in warning(2, 3)


def test_only_the_surfaces_of_a_view_count(prepared):
    data = PreparedDataset(prepared, "train", max_surfaces=2)
    told = surfaces_of(data)
    assert len(told["surfaces"]) == 2 and told["seed"] == 3 and set(told["surfaces"]) < set(data.surfaces)
    assert surfaces_of(data, [0])["surfaces"] == [data.surfaces[data.surface_ids[0]]]

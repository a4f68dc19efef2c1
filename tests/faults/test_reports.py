"""What commands go on from: reports, results and rows of ablations, data cards, settings of virtual surfaces.

The files are those under `examples`. Flipped digits of a report cannot be noticed: JSON has no checksum.
"""

import json
from pathlib import Path
from types import SimpleNamespace

import ablate
import publish
import pytest
from ablate_rows import read_rows
from compare import read_report
from data_card.writing import NUMBERS_FILE, check_card_folder
from report.running import _kept

from tactile_diffusers.pipelines.hub import forget_folders

EXAMPLES = Path(__file__).parents[2] / "examples"
CONDITIONS = {"digest": "abc", "split": "test"}


def _published_report(path):
    digest = json.loads((EXAMPLES / "results/judges/report.json").read_text())["checkpoint"]["sha256"]
    (path.parent / "out").mkdir(exist_ok=True)
    return publish._report(path.parent, {digest}, path.parent / "out", [])


def _published_card(path):
    recordings = json.loads((EXAMPLES / "results/data/card.json").read_text())["recordings"]
    surfaces = [None] * recordings["surfaces"]
    return publish._data_warnings(
        path.parent, SimpleNamespace(source=recordings["attributes"]["source"], surfaces=surfaces)
    )


def _row(path):
    return [len(row.train) for row in read_rows(path.parent)]


def _configs(path):
    forget_folders(path.parent)


def _ablation(path):
    """As the command goes on from it: damage is told, and the row is measured again."""
    plan = [SimpleNamespace(digest="abc", folder=path.parent / "dale")]
    arguments = SimpleNamespace(split="test", output=path.parents[1])
    found = ablate._stored(path.parent.name, plan, arguments)
    if found is None:
        raise ValueError(f"{path} is measured again")
    return found


READERS = {
    "report to compare": ("report.json", read_report),
    "report to publish": ("report.json", _published_report),
    "data card": ("card.json", _published_card),
    "row": ("base.json", _row),
    "result": ("result.json", _ablation),
    "config": ("config.json", _configs),
}


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    root = tmp_path_factory.mktemp("files")
    sources = {"row": "configs/ablation/base.json", "data card": "results/data/card.json"}
    sources |= {"report to compare": "results/judges/report.json", "report to publish": "results/judges/report.json"}
    found = {}
    for kind, (name, _) in READERS.items():
        (root / kind).mkdir()
        found[kind] = root / kind / name
        if kind in sources:
            found[kind].write_bytes((EXAMPLES / sources[kind]).read_bytes())
    for picture in (EXAMPLES / "results/judges").glob("*.png"):
        (root / "report to publish" / picture.name).write_bytes(b"png")
    row = next(iter(json.loads((EXAMPLES / "results/ablation/ablation.json").read_text())["rows"].values()))
    found["result"].write_text(json.dumps({**row, **CONDITIONS}))
    found["config"].write_text(json.dumps({"widths": [8, 16], "_name_or_path": "/somewhere/here"}))
    return found


@pytest.mark.parametrize("kind", READERS)
def test_damage(kind, files, damaged, flips, foreign):
    case = damaged(files[kind], READERS[kind][1])
    if kind in ("row", "config"):  # they may be absent, and other JSON beside a checkpoint is none of its business
        case.truncate()
        case.flip(flips)
        for name in set(foreign) - ({"json list", "json number"} if kind == "config" else set()):
            case.refuse(foreign[name])
    else:
        case.damage(flips, foreign.values())


def _places(content, place=(), depth=3):
    """Paths of the keys of a JSON object and of objects in it, so deep; the first item alone of each list."""
    listed = list(enumerate(content[:1])) if isinstance(content, list) else []
    for key, value in content.items() if isinstance(content, dict) else listed:
        yield (*place, key)
        if depth > 1:
            yield from _places(value, (*place, key), depth - 1)


@pytest.mark.parametrize("kind", READERS)
def test_a_key_is_missing_or_odd(kind, files, damaged, refusal, odd_values):
    """What is not read may be anything; what is read is refused by name, or goes through without an exception."""
    case = damaged(files[kind], READERS[kind][1])
    content = json.loads(case.content)
    places = list(_places(content, depth=2 if len(case.content) > 20_000 else 3))
    for place in places[:: max(1, len(places) // (2 * len(odd_values)))]:  # some, evenly spread
        for odd in odd_values:
            changed = json.loads(case.content)
            *above, last = place
            part = changed
            for key in above:
                part = part[key]
            if odd == "missing":
                del part[last]
            else:
                part[last] = odd
            refusal(case.read, case.put(json.dumps(changed).encode()))


def test_a_kept_section_is_measured_again(tmp_path, foreign):
    path, stored = tmp_path / "speed.json", {"conditions": {"a": 1}, "result": {"b": 2.0}, "seconds": 1.0}
    good = json.dumps(stored).encode()
    path.write_bytes(good)
    assert _kept(path, {"a": 1}, lambda: {"b": 3.0}) == ({"b": 2.0}, 1.0)
    cuts = [good[: len(good) * tenth // 10] for tenth in range(10)]
    for content in (*cuts, *foreign.values(), b'{"conditions": 7}', b'{"conditions": {"a": 1}}', b"\xff"):
        path.write_bytes(content)
        assert _kept(path, {"a": 1}, lambda: {"b": 3.0})[0] == {"b": 3.0}
        assert json.loads(path.read_text())["result"] == {"b": 3.0}


def test_a_damaged_card_is_no_card_to_replace(tmp_path, foreign):
    good = json.dumps({"format": "tactile-data-card", "files": [NUMBERS_FILE]})
    for content in (good[:20], '{"format": "tactile-data-card", "files": 7}', *foreign.values()):
        (tmp_path / NUMBERS_FILE).write_bytes(content.encode() if isinstance(content, str) else content)
        with pytest.raises(ValueError, match="which no data card wrote"):
            check_card_folder(tmp_path)
    (tmp_path / NUMBERS_FILE).write_text(good)
    check_card_folder(tmp_path)

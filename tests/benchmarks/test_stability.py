"""The benchmark of hard cases: each is there, and what misses its bound, or breaks, is reported."""

import json
import math
import platform

import numpy as np
import pytest
import stability
import torch
from stability import CASES, measure
from stability_bench import Bench, Row

from tactile_diffusers import TactileFeatureExtractor

KINDS = ["many in a row", "stream", "precision", "ratings", "guidance", "steps", "level", "length", "input"]
KINDS += ["sampling rate", "threads", "processes", "compiled"]


@pytest.fixture(autouse=True)
def one_thread():
    """Threads of small models wait for each other, long so on a busy machine."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture
def bench(pipe):
    return Bench(pipe, quick=True, minutes=0.05)


@pytest.fixture
def command(pipe, tmp_path):
    pipe.save_pretrained(str(tmp_path / "pipeline"))
    words = f"--quick --quiet --checkpoint {tmp_path / 'pipeline'} --output {tmp_path / 'out'}"
    return words.split()


#: These import the package again, or compile it.
SLOW = ("processes", "compiled")


@pytest.mark.parametrize(
    "kind", [pytest.param(kind, marks=pytest.mark.slow) if kind in SLOW else kind for kind in KINDS]
)
def test_every_kind_of_case_is_measured_to_its_end(bench, kind):
    assert list(CASES) == KINDS
    rows = measure(bench, {kind: CASES[kind]})
    assert rows and all(row.case.startswith(f"{kind}: ") for row in rows)
    assert not [row for row in rows if row.case.endswith("stopped")]
    # an untrained model obeys no bound of training, but arithmetic is the same
    if kind in ("level", "length", "input", "many in a row", "stream", "threads", "processes", "compiled"):
        assert [row for row in rows if not row.passed and "nine-band" not in row.measured] == []


def test_cases_are_those_of_the_issue(bench):
    names = {kind: {row.case for row in CASES[kind](bench)} for kind in ("precision", "guidance", "level")}
    for dtype in ("bfloat16", "float16"):
        ways = ("whole", "LCTG alone", "autocast", "layerwise casting")
        assert {f"{dtype}, {way}" for way in ways} <= names["precision"]
    assert {"all 0", "all 1", "all 1.5", "all 3", "all 10", "all 30", "bumpiness 3"} <= names["guidance"]
    assert {"ln RMS of -12", "ln RMS of 3", "times 1e-06", "times 1000"} <= names["level"]


def test_a_fault_of_the_package_is_found(bench, monkeypatch):
    right = TactileFeatureExtractor.denormalize
    monkeypatch.setattr(TactileFeatureExtractor, "denormalize", lambda *a, **k: 1.01 * right(*a, **k))
    rows = measure(bench, {"ratings": CASES["ratings"]})
    wrong = [row for row in rows if "RMS of the texture" in row.measured]
    assert wrong and not any(row.passed for row in wrong)
    assert wrong[0].value == pytest.approx(20 * math.log10(1.01), rel=1e-3)


@pytest.mark.skipif(platform.system() != "Linux", reason="memory is read from /proc")
def test_growing_memory_is_found(bench, monkeypatch):
    right, kept = type(bench.pipe).__call__, []

    def growing(self, *arguments, **options):
        kept.append(np.ones(2**23))  # 64 MiB: far above what other tests may give back meanwhile
        return right(self, *arguments, **options)

    monkeypatch.setattr(type(bench.pipe), "__call__", growing)
    rows = list(CASES["many in a row"](bench))
    grown = next(row for row in rows if row.unit == "MiB")
    assert not grown.passed and grown.value > 100
    assert [row.passed for row in rows if row is not grown] == [True, True]


def _planted(bench):
    yield Row("good", "error", 0.5, 1.0, "dB")
    yield Row("bad", "error", 2.0, 1.0, "dB")
    yield Row("not a number", "error", math.nan, 1.0, "dB")
    raise RuntimeError("it | broke")


def test_the_command_tells_what_fails(command, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(stability, "CASES", {"planted": _planted, "after": lambda bench: [Row("x", "y", 0, 0, "")]})
    assert stability.main(command) == 1
    text = (tmp_path / "out" / "stability.md").read_text()
    lines = [line for line in text.splitlines() if line.startswith("| planted") or line.startswith("| after")]
    assert ["**FAIL**" in line for line in lines] == ["pass" not in line for line in lines] == [0, 1, 1, 1, 0]
    assert "planted: stopped | RuntimeError: it / broke" in lines[3] and "2 of 5 within" in text
    rows = json.loads((tmp_path / "out" / "stability.json").read_text())["rows"]
    assert [row["passed"] for row in rows] == [True, False, False, False, True]
    assert text.strip() == capsys.readouterr().out.strip()

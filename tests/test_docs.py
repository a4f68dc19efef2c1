"""What is written for readers, against the code: docstrings' arguments and defaults, the pages' parts and links."""

import ast
import functools
import importlib.util
import inspect
import json
import re
import shutil
from pathlib import Path

import pytest

from tactile_diffusers import (
    DALEModel,
    LCTGModel,
    RatingEstimator,
    TactileFeatureExtractor,
    TactileTextureEditPipeline,
    TactileTexturePipeline,
    VDDIMScheduler,
    bundled_checkpoint,
)

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
EXAMPLES = (ROOT / "examples" / "README.md").read_text(encoding="utf-8")
RESULTS = ROOT / "examples" / "results" / "README.md"
PAGES = [ROOT / "README.md", ROOT / "examples" / "README.md", *sorted(RESULTS.parent.glob("*.md"))]
MODULES = sorted((ROOT / "src" / "tactile_diffusers").rglob("*.py"))
DOCUMENTED = [
    (DALEModel.__init__, DALEModel),
    (LCTGModel.__init__, LCTGModel),
    (RatingEstimator.__init__, RatingEstimator),
    (TactileFeatureExtractor.__init__, TactileFeatureExtractor),
    (VDDIMScheduler.__init__, VDDIMScheduler),
    (TactileTexturePipeline.__init__, TactileTexturePipeline),
    *((method, method) for method in (TactileTexturePipeline.__call__, TactileTexturePipeline.decode)),
    *((method, method) for method in (TactileTextureEditPipeline.__call__, TactileTextureEditPipeline.variations)),
    *((method, method) for method in (TactileTexturePipeline.encode, TactileTexturePipeline.estimate_ratings)),
    *((method, method) for method in (VDDIMScheduler.step, VDDIMScheduler.set_timesteps, VDDIMScheduler.add_noise)),
    *((cls.forward, cls.forward) for cls in (DALEModel, LCTGModel, RatingEstimator)),
]


def _arguments(function):
    arguments = inspect.signature(function).parameters.values()
    return [argument for argument in arguments if argument.name != "self" and argument.kind is not argument.VAR_KEYWORD]


@pytest.mark.parametrize(("function", "documented"), DOCUMENTED, ids=lambda value: value.__qualname__)
def test_every_argument_is_explained_with_its_default(function, documented):
    text = documented.__doc__
    for argument in _arguments(function):
        entry = re.search(rf"^ +(?:\w+, )*{argument.name}(?:, \w+)*(?: \((.*)\))?: ", text, re.M)
        assert entry, f"{argument.name} is not explained"
        stated = re.search(r"defaults to `?\"?([^`\"]+)", entry[1] or "")
        if stated:
            assert str(argument.default) == stated[1], argument.name
        if argument.default is not argument.empty and entry[1]:
            assert "optional" in entry[1], f"{argument.name} has a default"


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(ROOT / "src" / "tactile_diffusers")))
def test_public_names_have_docstrings(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    assert ast.get_docstring(tree) or not tree.body, "the module says nothing"
    kinds = (ast.ClassDef, ast.FunctionDef)
    public = [node for node in tree.body if isinstance(node, kinds) and not node.name.startswith("_")]
    silent = [node.name for node in public if not ast.get_docstring(node)]
    assert silent == []


def test_the_readme_has_its_parts_in_order():
    parts = (
        "# tactile_diffusers",
        "## Install and make a texture",
        "## Ratings and units",
        "## Eight numbers",
        "## How it works",
        "## Under a moving finger",
        "## Files",
        "## Your own surfaces",
        "## Limits",
        "## Citation and thanks",
    )
    places = [README.find(f"{part}\n") for part in parts]
    assert min(places) == 0 and places == sorted(places)
    assert "pipe = TactileTexturePipeline.from_pretrained" in README  # THE way
    assert len(README.splitlines()) <= 250


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_files_and_headings_that_a_page_names_are_there(path):
    text = path.read_text(encoding="utf-8")
    for name, _, heading in (link.partition("#") for link in re.findall(r"\]\(([^):]+)\)", text)):
        target = (path.parent / name) if name else path
        assert target.exists(), name
        if heading:
            titles = re.findall(r"^#+ (.*)$", target.read_text(encoding="utf-8"), re.M)
            assert heading in {re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-") for title in titles}, heading


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_scripts_that_a_page_names_are_there(path):
    text = path.read_text(encoding="utf-8")
    named = set(re.findall(r"(?:python|accelerate launch|torchrun --nproc_per_node \d) (examples/[\w/]+\.py)", text))
    assert [name for name in sorted(named) if not (ROOT / name).is_file()] == []


def test_commands_are_set_as_code():
    fences = README.split("```")[::2]  # what is outside of fenced blocks
    loose = [line for text in fences for line in text.splitlines() if re.match(r"(python|pip|accelerate) ", line)]
    assert loose == []


def _rows(text, heading):
    table = text.split(heading, 1)[1].split("|---", 1)[1].split("\n\n", 1)[0]
    return [[cell.strip() for cell in row.strip("| ").split("|")] for row in table.splitlines()[1:]]


NUMBER = re.compile(r"\d+\.\d+|\d+ of \d+")


@pytest.mark.parametrize("row", _rows(RESULTS.read_text(encoding="utf-8"), "# Results"), ids=lambda row: row[0])
def test_each_of_the_eight_numbers_stands_in_the_page_that_it_names(row):
    page = (RESULTS.parent / re.search(r"\((.*?)\)", row[-1])[1]).read_text(encoding="utf-8")
    for number in NUMBER.findall(f"{row[2]} {row[3]}"):
        assert re.search(rf"(?<![\d.]){re.escape(number)}(?!\d)", page), number


def test_the_readme_has_the_same_eight_numbers():
    ours = [NUMBER.findall(row[2])[0] for row in _rows(RESULTS.read_text(encoding="utf-8"), "# Results")]
    assert [NUMBER.findall(row[1])[0] for row in _rows(README, "## Eight numbers")] == ours and len(ours) == 8


@pytest.mark.parametrize("row", _rows(EXAMPLES, "## Equations and where they are"), ids=lambda row: row[0])
def test_the_map_of_equations_names_what_is_there(row):
    file, names = row[2].split(" ", 1)
    module = importlib.import_module(file.strip("`").removesuffix(".py").replace("/", "."))
    for name in re.findall(r"`([\w.]+)`", names):
        functools.reduce(getattr, name.split("."), module)


@pytest.fixture
def first_pages():
    spec = importlib.util.spec_from_file_location("first_pages", RESULTS.parent / "first_pages.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_first_pages_are_those_of_the_report_of_the_bundled_checkpoint(first_pages, capsys):
    assert first_pages.main(["--check"]) == 0, capsys.readouterr().err


def test_a_report_of_other_weights_is_stale(first_pages, tmp_path, monkeypatch, capsys):
    other = shutil.copytree(bundled_checkpoint(), tmp_path / "other")
    (other / "dale" / "config.json").write_text("{}")
    monkeypatch.setattr(first_pages, "bundled_checkpoint", lambda: other)
    assert first_pages.main(["--check"]) == 1 and "run results/run.py" in capsys.readouterr().err


def test_pages_of_a_check_go_to_its_folder_and_pages_without_figures_are_left_out(first_pages, tmp_path, capsys):
    for name in ("judges/report.json", "real_time/endless.json", "speed/peers.json"):
        (tmp_path / name).parent.mkdir()
        shutil.copy(RESULTS.parent / name, tmp_path / name)
    assert first_pages.main(["--results", str(tmp_path)]) == 0
    assert "27 of 36" in (tmp_path / "steering.md").read_text() and (tmp_path / "README.md").exists()
    assert not (tmp_path / "hard_cases.md").exists() and "hard_cases.md is left out" in capsys.readouterr().err


def test_rows_with_other_figures_are_stale(first_pages):
    text, files = RESULTS.read_text(encoding="utf-8"), {None: "judges/report.json"}
    files |= {name: path for name, (path, _) in first_pages.OTHERS.items()}
    reports = {name: json.loads((RESULTS.parent / path).read_text(encoding="utf-8")) for name, path in files.items()}
    assert first_pages.page_with_figures(text, reports, True) == text
    reports[None]["generation"]["1.0"]["ktd_excess"]["mean"] += 1
    assert first_pages.page_with_figures(text, reports, True) != text
    assert all(words in text for words in first_pages.ROWS)

"""What is written for readers, against the code: docstrings' arguments and defaults, the README's parts and blocks."""

import ast
import inspect
import re
from pathlib import Path

import pytest

from tactile_diffusers import (
    DALEModel,
    LCTGModel,
    RatingEstimator,
    TactileFeatureExtractor,
    TactileTexturePipeline,
    VDDIMScheduler,
)

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
MODULES = sorted((ROOT / "src" / "tactile_diffusers").rglob("*.py"))
DOCUMENTED = [
    (DALEModel.__init__, DALEModel),
    (LCTGModel.__init__, LCTGModel),
    (RatingEstimator.__init__, RatingEstimator),
    (TactileFeatureExtractor.__init__, TactileFeatureExtractor),
    (VDDIMScheduler.__init__, VDDIMScheduler),
    (TactileTexturePipeline.__init__, TactileTexturePipeline),
    *((method, method) for method in (TactileTexturePipeline.__call__, TactileTexturePipeline.decode)),
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
        "## How it works",
        "## Results",
        "## From recordings to a checkpoint",
        "## Limits",
        "## Citation and thanks",
    )
    places = [README.find(f"{part}\n") for part in parts]
    assert min(places) == 0 and places == sorted(places)
    assert "pipe = TactileTexturePipeline.from_pretrained" in README  # THE way
    assert "DiffusionPipeline.from_pretrained" not in README


def test_commands_are_set_as_code():
    fences = README.split("```")[::2]  # what is outside of fenced blocks
    loose = [line for text in fences for line in text.splitlines() if re.match(r"(python|pip|accelerate) ", line)]
    assert loose == []


def test_pictures_and_files_that_the_readme_names_are_there():
    named = re.findall(r"\]\(([^)#:]+)\)", README)
    assert len(named) > 5 and [name for name in named if not (ROOT / name).exists()] == []

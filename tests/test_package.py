"""The package as a whole: version, order of the rooms, size of the files."""

import ast
import re
import shutil
import subprocess
import tomllib
from importlib import metadata, util
from pathlib import Path

import pytest
from house import House

from tactile_diffusers.version import __version__

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src" / "tactile_diffusers"
MODULES = sorted(path for path in PACKAGE.rglob("*.py") if (path.parent / "__init__.py").is_file())
#: A room imports from itself and from rooms on its left.
ROOMS = (
    "checkpoints",  # files and one path: imports nothing
    "signal",
    "io",
    "schedulers",
    "features",
    "models",
    "pipelines",
    "data",
    "virtual",
    "training",
    "evaluation",
    "playback",
    "display",
    "export",
    "search",
    "cli",
)
#: The public names of the package are those of its rooms up to here.
LAST_PUBLIC_ROOM = "pipelines"
#: Packages that one call path needs and all would wait for.
HEAVY = {"librosa", "matplotlib", "numba", "soundfile", "gradio", "tensorboard", "peft"}


def _name(path):
    return str(path.relative_to(PACKAGE))


def _imported_rooms(path):
    """Rooms that a module imports from, wherever in the file, with the line."""
    package = path.relative_to(PACKAGE).parts[:-1]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            targets = [alias.name.split(".") for alias in node.names if alias.name.split(".")[0] == "tactile_diffusers"]
            targets = [target[1:] for target in targets]
        elif isinstance(node, ast.ImportFrom) and node.level:
            base = [*package[: len(package) - node.level + 1], *(node.module or "").split(".")]
            base = [part for part in base if part]
            targets = [base] if base else [[alias.name] for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module.split(".")[0] == "tactile_diffusers":
            targets = [node.module.split(".")[1:]] if "." in node.module else [[alias.name] for alias in node.names]
        else:
            continue
        for target in targets:
            room = target[0] if target and target[0] in ROOMS else LAST_PUBLIC_ROOM
            if target != ["version"]:  # below all rooms
                yield room, node.lineno


def test_version_is_that_of_the_installed_package():
    try:
        installed = metadata.version("tactile-diffusers")
    except metadata.PackageNotFoundError:
        pytest.skip("not installed")
    assert installed == __version__


def test_every_folder_is_a_known_room():
    folders = {path.name for path in PACKAGE.iterdir() if path.is_dir()} - {"__pycache__"}
    assert folders <= set(ROOMS)


def test_no_room_has_the_name_of_a_pipeline_of_diffusers():
    # the loader would store its components as that pipeline's
    [diffusers] = util.find_spec("diffusers").submodule_search_locations
    assert not {path.stem for path in (Path(diffusers) / "pipelines").iterdir()} & set(ROOMS)


@pytest.mark.parametrize("path", [path for path in MODULES if path.parent != PACKAGE], ids=_name)
def test_imports_run_from_left_to_right(path):
    own = ROOMS.index(path.relative_to(PACKAGE).parts[0])
    upward = [f"line {line} imports from {room}" for room, line in _imported_rooms(path) if ROOMS.index(room) > own]
    assert not upward


@pytest.mark.parametrize("path", MODULES, ids=_name)
def test_heavy_packages_are_imported_inside_functions(path):
    imported = set()
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Import):
            imported |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            imported.add(node.module.split(".")[0])
    assert not imported & HEAVY


def test_files_and_functions_stay_readable():
    figures = House(ROOT).figures()
    assert figures["files of more than 400 lines"] == []
    assert figures["functions with a body of more than 60 lines"] == []
    assert figures["circles of imports"] == []
    assert figures["lines of README.md"] <= 250


def test_every_dependency_has_a_floor_and_an_upper_bound():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    assert {"training", "demo", "test", "browser", "fuzz"} <= set(extras)
    named = [*project["dependencies"], *(name for extra in extras.values() for name in extra)]
    named = [name for name in named if not name.startswith("tactile")]  # an extra may ask for another
    assert len(named) > 20 and [name for name in named if not re.search(r">=[\d.]+,<\d", name)] == []
    assert {"requires-python", "license", "classifiers", "urls", "readme"} <= set(project)


def test_the_root_holds_what_belongs_there():
    git = shutil.which("git")
    done = git and subprocess.run([git, "ls-files"], cwd=ROOT, capture_output=True, text=True)
    if not done or done.returncode:
        pytest.skip("no repository")
    allowed = {"pyproject.toml", "README.md", "LICENSE", ".gitignore", ".ci", "src", "examples", "tests"}
    assert {line.split("/")[0] for line in done.stdout.splitlines()} == allowed

"""What the package takes from others: what it imports is declared, and nothing is fetched at import or run time."""

import ast
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src" / "tactile_diffusers"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS = PROJECT["optional-dependencies"]
#: Module -> the distribution that brings it, where the names differ.
DISTRIBUTIONS = {"PIL": "pillow", "sklearn": "scikit-learn"}
#: Extra -> what the package imports of it, and where (one call path each; the error names the extra).
OPTIONAL = {
    "training": {"tensorboard": "training/launch.py"},
    "parquet": {"pyarrow": "io/reading.py"},
}
#: Imported by nobody here: pandas needs it for xlsx, and huggingface_hub for model cards.
INDIRECT = {"openpyxl", "jinja2"}
#: As it is imported first by every Python process, its children's too: each attempt to leave the machine fails and is
#: written down, so that no `except` hides it. What C libraries open by themselves is not seen.
NO_NETWORK = """
import os
import socket


def refusing(function, place):
    def called(*arguments, **options):
        address = arguments[place]
        host = address[0] if isinstance(address, tuple) else address
        remote = not isinstance(address, bytes) and host not in (None, "", "localhost", "127.0.0.1", "::1")
        if remote and not (place and arguments[0].family == socket.AF_UNIX) and host != socket.gethostname():
            with open(os.environ["TACTILE_ATTEMPTS"], "a") as file:
                print(function.__name__, address, file=file)
            raise OSError(f"no network in this test: {address}")
        return function(*arguments, **options)

    return called


for name in ("connect", "connect_ex", "sendto"):
    setattr(socket.socket, name, refusing(getattr(socket.socket, name), -1 if name == "sendto" else 1))
for name in ("getaddrinfo", "gethostbyname", "gethostbyname_ex"):
    setattr(socket, name, refusing(getattr(socket, name), 0))
"""


def _distribution(requirement):
    return re.match(r"[\w-]+", requirement)[0].lower().replace("_", "-")


def _imports():
    """(module, path within the package) of every import of another package, wherever in a file."""
    for path in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            else:
                names = [node.module] if isinstance(node, ast.ImportFrom) and not node.level else []
            for name in {name.split(".")[0] for name in names} - sys.stdlib_module_names - {"tactile_diffusers"}:
                yield name, path.relative_to(PACKAGE).as_posix()


def test_what_is_imported_is_declared_and_the_other_way_round():
    declared = {_distribution(line) for line in PROJECT["dependencies"]}
    optional = {name: place for places in OPTIONAL.values() for name, place in places.items()}
    used = set()
    for name, path in _imports():
        if name in optional:
            assert path.startswith(optional[name]), f"{path} imports {name}, which an installation may lack"
        else:
            used.add(DISTRIBUTIONS.get(name, name).lower().replace("_", "-"))
    assert used | INDIRECT == declared


@pytest.mark.parametrize("extra", OPTIONAL)
def test_an_extra_is_named_where_it_is_missed(extra):
    assert extra in EXTRAS
    texts = [path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.py")]
    assert sum(f'pip install "tactile-diffusers[{extra}]"' in text for text in texts) == 1


def test_the_licence_of_the_weights_is_stated():
    assert PROJECT["license"] == "Apache-2.0" and PROJECT["readme"] == "README.md" and (PACKAGE / "py.typed").is_file()
    assert "code and bundled weights: Apache-2.0" in (ROOT / "README.md").read_text(encoding="utf-8")
    for card in (PACKAGE / "checkpoints").glob("*/README.md"):
        assert re.match(r"---\n(.*\n)*license: apache-2\.0\n", card.read_text(encoding="utf-8"))


@pytest.fixture
def offline(tmp_path):
    """A function that runs Python's words without a network, in an empty folder: what it printed."""
    (tmp_path / "sitecustomize.py").write_text(NO_NETWORK, encoding="utf-8")
    attempts, empty = tmp_path / "attempts", tmp_path / "empty"
    empty.mkdir()
    environment = {name: value for name, value in os.environ.items() if name != "HF_HUB_OFFLINE"}
    environment |= {"PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT / "src")])}
    environment |= {"TACTILE_ATTEMPTS": str(attempts), "HF_HOME": str(empty / "home")}

    def run(*words):
        words = [sys.executable, *map(str, words)]
        done = subprocess.run(words, capture_output=True, text=True, cwd=empty, env=environment, timeout=240)
        assert not attempts.exists(), attempts.read_text()
        assert done.returncode == 0, done.stderr
        return done.stdout

    run.attempts = attempts
    return run


def test_a_network_would_be_noticed(offline):
    """The test of the tests below."""
    local = "with socket.create_server(('127.0.0.1', 0)) as s: socket.create_connection(s.getsockname())"
    offline("-c", f"import socket\n{local}")
    for words in ("socket.create_connection(('192.0.2.1', 80))", "socket.getaddrinfo('example.com', 80)"):
        with pytest.raises(AssertionError, match="192.0.2.1|example.com"):
            offline("-c", f"import socket\ntry: {words}\nexcept OSError: pass")
        offline.attempts.unlink()


USE = """
import sys
import torch
from diffusers import DiffusionPipeline, ModelMixin, SchedulerMixin
from transformers import FeatureExtractionMixin, SequenceFeatureExtractor

before = set(sys.modules)  # what these two import by themselves depends on their version
from tactile_diffusers import TactileTexturePipeline, bundled_checkpoint

HEAVY = {"matplotlib", "librosa", "numba", "gradio", "pandas", "soundfile", "tensorboard"}
assert not HEAVY & (set(sys.modules) - before), HEAVY & (set(sys.modules) - before)
pipe = TactileTexturePipeline.from_pretrained(bundled_checkpoint())
out = pipe([[1.5, 0.0, -1.0]], num_inference_steps=2, generator=torch.Generator().manual_seed(0))
again = pipe.reconstruct(out.textures[0], out.sampling_rate, num_inference_steps=2)
assert again.textures.shape == out.textures.shape
from tactile_diffusers_cli import main
assert main(["generate", "--ratings", "1.5", "0", "-1", "--output", "made"]) == 0
assert main(["export", "--input", "made", "--output", "files"]) == 0
"""


def test_use_needs_no_network(offline):
    offline("-c", USE)


@pytest.mark.slow
def test_data_and_training_need_no_network(offline):
    small = "--source virtual --surfaces 4 --seconds 10 --workers 2 --output smoke.h5 --prepared prepared.h5"
    offline(ROOT / "examples" / "prepare_data.py", *small.split())
    few = "--train_data_dir prepared.h5 --max_train_steps 2 --train_batch_size 2 --validation_samples 2"
    end = "--dataloader_num_workers 1 --report_to tensorboard --output_dir"
    offline(ROOT / "examples" / "train_lctg.py", *few.split(), *end.split(), "lctg")
    start = "--pretrained_model_name_or_path lctg --rating_head_steps 5"
    offline(ROOT / "examples" / "train_dale.py", *few.split(), *start.split(), *end.split(), "pipeline")

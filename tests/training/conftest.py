"""What the tests of training share: a prepared data set, the scripts as modules, tiny trainings."""

import importlib.util
import json
from pathlib import Path

import pytest
import torch
from accelerate.state import AcceleratorState, GradientState
from safetensors.torch import load_file

from tactile_diffusers.data import SegmentLimits, prepare_recordings
from tactile_diffusers.training.launch import make_accelerator, training_parser
from tactile_diffusers.training.loop import Trainer
from tactile_diffusers.training.record import read_log
from tactile_diffusers.training.steps import velocity_loss
from tactile_diffusers.virtual import generate_recordings

EXAMPLES = Path(__file__).parents[2] / "examples"
#: segments of 0.2048 s: 2048 samples at 10 kHz, 512 at the working rate, 32 latent frames
SECONDS = 0.2048
LCTG_CONFIG = {
    "feature_extractor": {
        "num_filters": 24,
        "hop_length": 8,
        "window_lengths": [64, 256],
        "level_bands": 0,
        "envelope_samples": 0,
        "detail_samples": 0,
    },
    "lctg": {
        "latent_channels": 4,
        "encoder_width": 12,
        "widths": [8, 12, 16],
        "patch_size": 4,
        "embedding_dim": 16,
        "segment_samples": 512,
    },
}
DALE_CONFIG = {"dale": {"widths": [32, 32], "embedding_dim": 16, "rating_dim": 16, "cross_attention": True}}


def _reset_accelerate():
    """Accelerate keeps its state in the process."""
    AcceleratorState._reset_state(reset_partial_state=True)
    GradientState._reset_state()


@pytest.fixture(autouse=True)
def fresh_accelerate():
    yield
    _reset_accelerate()


@pytest.fixture(scope="session")
def script():
    """`script("train_lctg")` is the script as a module, a fresh one each time."""

    def load(name):
        spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module

    return load


@pytest.fixture(scope="session")
def prepared(tmp_path_factory):
    """Six virtual surfaces of 5 s each, in short segments."""
    folder = tmp_path_factory.mktemp("prepared")
    generate_recordings(folder / "recordings.h5", surfaces=6, seconds=5, explorers=1, seed=3, quiet=True)
    limits = SegmentLimits(seconds=SECONDS)
    prepare_recordings(folder / "recordings.h5", folder / "prepared.h5", limits, validation=1, test=1, quiet=True)
    return folder / "prepared.h5"


@pytest.fixture(scope="session")
def tiny_configs(tmp_path_factory):
    """Model configs of tiny models: {"lctg": path, "dale": path}."""
    folder = tmp_path_factory.mktemp("configs")
    for name, config in (("lctg", LCTG_CONFIG), ("dale", DALE_CONFIG)):
        (folder / f"{name}.json").write_text(json.dumps(config))
    return {name: folder / f"{name}.json" for name in ("lctg", "dale")}


def command_line(options):
    """{"max_train_steps": 3, "quiet": True} -> ["--max_train_steps", "3", "--quiet"]; `None` leaves an option out."""
    words = []
    for name, value in options.items():
        if value is not None:
            words += [f"--{name}"] if value is True else [f"--{name}={value}"]
    return words


@pytest.fixture(scope="session")
def options_of_a_tiny_training(prepared, tiny_configs):
    """`options_of_a_tiny_training("lctg", output, **changes)`: the command line's words; four steps by default."""

    def make(name, output, **changes):
        options = {
            "train_data_dir": prepared,
            "output_dir": output,
            "model_config_name_or_path": tiny_configs[name],
            "max_train_steps": 4,
            "train_batch_size": 4,
            "learning_rate": 1e-3,
            "lr_warmup_steps": 1,
            "checkpointing_steps": 2,
            "validation_steps": 1000,
            "validation_samples": 2,
            "report_to": "none",
            "quiet": True,
        }
        return command_line(options | changes)

    return make


@pytest.fixture(scope="session")
def run_script(options_of_a_tiny_training):
    """`run_script(module, "lctg", output, **changes)` runs a script's `main` with those words; returns `output`."""

    def run(module, name, output, **changes):
        with torch.random.fork_rng(devices=[]):  # the script seeds the global random state
            module.main(options_of_a_tiny_training(name, output, **changes))
        return output

    return run


@pytest.fixture(scope="session")
def runs(script, run_script, tmp_path_factory):
    """A folder with the output folders `lctg`, `dale` and `distilled` of short trainings. Copy what you change."""
    folder, short = tmp_path_factory.mktemp("runs"), {"max_train_steps": 2, "validation_steps": 2, "no-use_ema": True}
    run_script(script("train_lctg"), "lctg", folder / "lctg", **short)
    dale, options = small_figures(script("train_dale")), short | {"pretrained_model_name_or_path": folder / "lctg"}
    run_script(dale, "dale", folder / "dale", conditioning_weight=0, rating_head_steps=2, **options)
    options = short | {"pretrained_model_name_or_path": folder / "dale", "model_config_name_or_path": None}
    run_script(script("distill"), "lctg", folder / "distilled", model="lctg", **options)
    return folder


def small_figures(module):
    """train_dale.py with the validation figure of one take and three values: it is tested with the figures."""
    plot = module.plot_axis_sweep
    module.plot_axis_sweep = lambda pipe, path, takes=1: plot(pipe, path, takes=1, values=(-1.0, 0.0, 1.0))
    return module


@pytest.fixture(scope="session")
def train_dale(script):
    """`train_dale()`: train_dale.py as a fresh module, free to be patched, with a small figure."""
    return lambda: small_figures(script("train_dale"))


def weights_of(folder):
    """Weights of a model that was saved into a folder; a dict of tensors stays as it is."""
    return folder if isinstance(folder, dict) else load_file(folder / "diffusion_pytorch_model.safetensors")


@pytest.fixture(scope="session")
def differing_weights():
    """`differing_weights(first, second)`: names of the weights that differ between two folders, or dicts of tensors."""

    def compare(first, second):
        first, second = weights_of(first), weights_of(second)
        assert first.keys() == second.keys()
        return [name for name in first if not torch.equal(first[name], second[name])]

    return compare


@pytest.fixture(scope="session")
def read_entries():
    """`read_entries(folder)`: the log of a training without the running time."""

    def read(folder):
        return [{key: value for key, value in entry.items() if key != "seconds"} for entry in read_log(folder)]

    return read


# --- a training without any data, to see what the loop itself does


class _Step(torch.nn.Module):
    """The v-objective on random states; `at` maps the number of a call to what happens to its loss."""

    def __init__(self, model, at):
        super().__init__()
        self.model, self.at, self.calls = model, at, 0

    def forward(self, batch, random):
        self.calls += 1
        noise = random.normal(*batch["state"].shape)
        velocity = self.model(batch["state"] + noise, 500.0, batch["ratings"], return_dict=False)[0]
        loss = velocity_loss(velocity, batch["state"] - noise).mean()
        loss = self.at.get(self.calls, lambda value: value)(loss)
        return loss, {"velocity": loss.detach()}


class _Rows(torch.utils.data.Dataset):
    def __init__(self, count):
        generator = torch.Generator().manual_seed(0)
        self.states = torch.randn((count, 6, 8), generator=generator)
        self.ratings = torch.randn((count, 3), generator=generator)

    def __len__(self):
        return len(self.states)

    def __getitem__(self, index):
        return {"state": self.states[index], "ratings": self.ratings[index]}


@pytest.fixture
def make_trainer(make_dale):
    """`make_trainer(folder, max_train_steps=3, at={2: function})` makes a `Trainer` of a tiny DALE on random states."""

    def make(output, at=None, validate=None, rows=13, **options):
        _reset_accelerate()
        fixed = {"train_data_dir": "none", "output_dir": output, "report_to": "none", "quiet": True}
        fixed |= {"train_batch_size": 3, "lr_warmup_steps": 1, "learning_rate": 1e-2, "max_train_steps": 4}
        args = training_parser("a test").parse_args(command_line(fixed | options))
        validate = validate or (lambda model: {"nothing": 0.0})
        return Trainer(make_accelerator(args), args, _Step(make_dale(), at or {}), "dale", _Rows(rows), None, validate)

    return make

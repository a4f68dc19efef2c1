"""Rows of an ablation: one JSON file each, which says what it asks and how it differs from the row it extends."""

import inspect
from dataclasses import dataclass, replace
from pathlib import Path

from tactile_diffusers.io.reading import read_json

#: Keys of a row file.
KEYS = ("question", "extends", "model", "arguments", "train", "dale")
#: Arguments of the training scripts that the command sets itself.
RESERVED = (
    *("train_data_dir", "output_dir", "overwrite_output_dir", "pretrained_model_name_or_path"),
    *("model_config_name_or_path", "resume_from_checkpoint", "validation_steps", "quiet"),
)


@dataclass(frozen=True)
class Row:
    """One row, with everything that it takes over from others filled in.

    Attributes:
        path (`Path`): its file; the row is called as the file is.
        question (`str`): what it asks, one line.
        lineage (`tuple[str, ...]`): names from the row that extends nothing down to this one.
        model (`dict`): sections of `--model_config_name_or_path` of both scripts.
        arguments (`dict`): arguments of train_lctg.py in all phases.
        train (`list[dict]`): more of them, phase by phase.
        dale (`dict` or `None`): arguments of train_dale.py; `None` = the row only reconstructs.
        seed (`int`, *optional*): of all its trainings; `None` = as its arguments say.
        equal_time (`bool`): whether its steps are as many as fit into the time of another row.
    """

    path: Path
    question: str
    lineage: tuple
    model: dict
    arguments: dict
    train: list
    dale: dict | None
    seed: int | None = None
    equal_time: bool = False

    @property
    def name(self):
        """As folders call it."""
        return self.group + ("" if self.seed is None else f"-seed-{self.seed}")

    @property
    def group(self):
        """As tables call it: all of its seeds."""
        return self.path.stem + ("-equal-time" if self.equal_time else "")

    def seeded(self, seed):
        """The row with this seed of all its trainings."""
        dale = None if self.dale is None else {**self.dale, "seed": seed}
        return replace(self, seed=seed, arguments={**self.arguments, "seed": seed}, dale=dale)

    def scaled(self, factor, dale_factor=None, **changes):
        """The row with so many times as many steps, of warming up too, of LCTG and of DALE (by default the same)."""

        def longer(arguments, by):
            steps = {name: arguments[name] for name in ("max_train_steps", "lr_warmup_steps") if name in arguments}
            return {**arguments, **{name: max(1, round(by * count)) for name, count in steps.items()}}

        train = [longer({**self.arguments, **phase}, factor) for phase in self.train]
        dale = None if self.dale is None else longer(self.dale, factor if dale_factor is None else dale_factor)
        return replace(self, train=train, dale=dale, **changes)


def read_rows(folder):
    """All rows of a folder, each after the one it extends.

    Args:
        folder (`str` or `Path`): with one or more files NAME.json.

    Returns:
        `list[Row]`

    Raises:
        ValueError: naming file and key, if there is no row, a file is not as it must be, or rows extend what is
            missing or each other.
    """
    paths = {path.stem: path for path in sorted(Path(folder).glob("*.json"))}
    if not paths:
        raise ValueError(f"--rows: there is no row file (NAME.json) in {folder}. Write one, or give another folder.")
    files = {name: _read(path) for name, path in paths.items()}
    rows = [_resolve(name, paths, files) for name in paths]
    return sorted(rows, key=lambda row: row.lineage)


def _read(path):
    content = read_json(path, "a row of an ablation, one JSON object", "Correct it.")
    unknown = sorted(set(content) - set(KEYS))
    if unknown:
        raise ValueError(f"{path}: unknown key {unknown[0]!r}. A row has the keys {', '.join(KEYS)}.")
    question = content.get("question")
    if not isinstance(question, str) or not question.strip() or "\n" in question or "|" in question:
        raise ValueError(f"{path}: 'question' must say in one line, without '|', what the row asks, got {question!r}.")
    extended = content.get("extends")
    if not isinstance(extended, str | None):
        raise ValueError(f"{path}: 'extends' must be the name of a row, got {extended!r}.")
    return content


def _resolve(name, paths, files):
    lineage = [name]
    while (parent := files[lineage[0]].get("extends")) is not None:
        if parent in lineage:
            raise ValueError(f"{paths[name]}: 'extends' goes round in a circle: {' < '.join([parent, *lineage])}.")
        if parent not in files:
            raise ValueError(
                f"{paths[lineage[0]]}: 'extends' names {parent!r}, which is no row of {paths[name].parent}. "
                f"There are {', '.join(paths)}."
            )
        lineage.insert(0, parent)
    merged = {"model": {}, "arguments": {}, "train": [], "dale": None}
    for ancestor in lineage:
        merged = _merge(merged, {key: value for key, value in files[ancestor].items() if key in merged})
    _check(paths[name], merged)
    return Row(paths[name], files[name]["question"].strip(), tuple(lineage), **merged)


def _merge(base, changes):
    """`base` with `changes`: dicts key by key, anything else as a whole."""
    both = {**base, **changes}
    for key in base.keys() & changes.keys():
        if isinstance(base[key], dict) and isinstance(changes[key], dict):
            both[key] = _merge(base[key], changes[key])
    return both


def _check(path, merged):
    _check_model(path, merged["model"])
    _check_arguments(path, "arguments", merged["arguments"])
    train = merged["train"]
    if not isinstance(train, list) or not train:
        raise ValueError(f"{path}: 'train' must be a list of phases, here or in the row it extends, got {train!r}.")
    for number, phase in enumerate(train, 1):
        key = f"train, phase {number}"
        _check_arguments(path, key, phase)
        _check_steps(path, key, {**merged["arguments"], **phase})
    if merged["dale"] is not None:
        _check_arguments(path, "dale", merged["dale"])
        _check_steps(path, "dale", merged["dale"])


def _check_model(path, model):
    from tactile_diffusers import DALEModel, LCTGModel, TactileFeatureExtractor, VDDIMScheduler

    parts = {"feature_extractor": TactileFeatureExtractor, "lctg": LCTGModel, "scheduler": VDDIMScheduler}
    parts |= {"dale": DALEModel, "dale_scheduler": VDDIMScheduler}
    if not isinstance(model, dict):
        raise ValueError(f"{path}: 'model' must be an object with the sections {', '.join(parts)}, got {model!r}.")
    for section, settings in model.items():
        if section == "kept_at_zero":
            continue
        if section not in parts or not isinstance(settings, dict):
            raise ValueError(
                f"{path}: 'model' must hold objects named {', '.join(parts)}, got {section!r}: {settings!r}."
            )
        known = set(inspect.signature(parts[section].__init__).parameters) - {"self", "kwargs"}
        unknown = sorted(set(settings) - known)
        if unknown:
            raise ValueError(
                f"{path}: 'model', section {section!r} has the unknown key {unknown[0]!r}. "
                f"There are {', '.join(sorted(known))}."
            )


def _check_arguments(path, key, arguments):
    if not isinstance(arguments, dict):
        raise ValueError(f"{path}: '{key}' must be an object of arguments and values, got {arguments!r}.")
    for name, value in arguments.items():
        if name in RESERVED:
            raise ValueError(f"{path}: '{key}' must not set {name!r}: the command sets it. Leave it out.")
        if not isinstance(value, str | int | float | bool | None):
            raise ValueError(f"{path}: '{key}' must give {name!r} one value, no list or object, got {value!r}.")


def _check_steps(path, key, arguments):
    steps = arguments.get("max_train_steps")
    if type(steps) is not int or steps < 1:
        raise ValueError(f"{path}: '{key}' must say how long to train: 'max_train_steps', at least 1, got {steps!r}.")

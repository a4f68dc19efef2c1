"""Local checkpoint folders: checked before they are loaded, and told apart by a digest."""

import hashlib
from pathlib import Path

import diffusers
from huggingface_hub.errors import HFValidationError
from huggingface_hub.utils import validate_repo_id

from ..features import TactileFeatureExtractor
from ..io.reading import read_json, reading
from ..models import DALEModel, LCTGModel, RatingEstimator
from ..schedulers import VDDIMScheduler

_AGAIN = "Copy the checkpoint again as a whole."
# files of the components that are no models
_CONFIGS = {
    "scheduler": "scheduler_config.json",
    "dale_scheduler": "scheduler_config.json",
    "feature_extractor": "preprocessor_config.json",
}


def check_folder(folder, passed=()):
    """Refuses a local checkpoint folder that is damaged, incomplete or of another package.

    Components that are `passed` by keyword are not checked. Models check their own folders when they are loaded.

    Raises:
        OSError: if the folder of a component is missing, or `folder` is neither a folder nor a name on the Hub.
        ValueError: naming the file and what is wrong with it.
    """
    if not Path(folder).is_dir():
        try:
            validate_repo_id(str(folder))
        except HFValidationError as error:
            raise OSError(
                f"{str(folder)!r} is neither a folder here nor a name on the Hub, which has the form "
                '"user/name". Check the spelling.'
            ) from error
    folder = Path(folder)
    path = folder / "model_index.json"
    if not path.is_file():
        return  # a name on the Hub, or a folder that the loader itself refuses
    with reading(path, "the index of a checkpoint", _AGAIN):
        content = read_json(path, "JSON")
        if not isinstance(content["_class_name"], str):
            raise ValueError("`_class_name` is no name")
        index = {name: entry for name, entry in content.items() if not name.startswith("_")}
        if "lctg" not in index:
            raise ValueError("it names no `lctg`")
        needed = {name: entry for name, entry in index.items() if name not in passed and entry != [None, None]}
        classes = {name: _component_class(name, *entry) for name, entry in needed.items()}
    missing = [name for name in classes if not (folder / name).is_dir()]
    if missing:
        raise OSError(f"The checkpoint {folder} lacks the folder(s) of {missing} that {path.name} names. {_AGAIN}")
    for name, cls in classes.items():
        if name not in _CONFIGS:
            continue
        config = folder / name / _CONFIGS[name]
        with reading(config, f"the config of a {cls.__name__}", _AGAIN):
            build = cls.from_config if hasattr(cls, "from_config") else cls.from_dict
            build(read_json(config, "JSON"))


def _component_class(name, library, class_name):
    """The class of a component; none but ours and diffusers' schedulers, because to name one is to import it."""
    ours = (DALEModel, LCTGModel, RatingEstimator, TactileFeatureExtractor, VDDIMScheduler)
    cls = {("tactile_diffusers", each.__name__): each for each in ours}.get((library, class_name))
    if cls is None and library == "diffusers" and "scheduler" in name and class_name.endswith("Scheduler"):
        cls = getattr(diffusers, class_name, None)
    if cls is None:
        raise ValueError(f"its component {name!r} is {library}.{class_name}, which is none of this package")
    return cls


def folder_digest(folder):
    """SHA-256 over the configs and weights of a checkpoint folder; reports and training checkpoints do not count."""
    folder, digest = Path(folder), hashlib.sha256()
    index = folder / "model_index.json"
    components = read_json(index, "the index of a checkpoint") if index.is_file() else ()
    parts = {index.name, "training.json", *components}
    for path in sorted(folder.rglob("*")):
        place = path.relative_to(folder)
        if place.parts[0] in parts and path.suffix in (".json", ".safetensors"):
            digest.update(str(place).encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()

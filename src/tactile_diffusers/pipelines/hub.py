"""Checkpoints on the Hub: fetched without code, sent with their own card."""

import json
import shutil
from pathlib import Path
from tempfile import TemporaryDirectory

import huggingface_hub
from diffusers.utils import logging
from huggingface_hub.errors import LocalEntryNotFoundError, RepositoryNotFoundError, RevisionNotFoundError

from ..checkpoints import SURFACES_FILE
from ..io.files import write_text
from ..io.reading import reading

logger = logging.get_logger(__name__)

#: The model card of a checkpoint.
CARD_FILE = "README.md"
#: Makes `DiffusionPipeline.from_pretrained(folder, custom_pipeline="pipeline", trust_remote_code=True)` work.
CODE_FILE = "pipeline.py"
CODE = '''"""For `DiffusionPipeline.from_pretrained(folder, custom_pipeline="pipeline", trust_remote_code=True)`."""

from tactile_diffusers import TactileTexturePipeline  # noqa: F401
'''
#: What belongs to a checkpoint beside its components: the card, its pictures, the names of the surfaces that
#: must not judge it, and the code for `DiffusionPipeline`.
BESIDE = (CARD_FILE, SURFACES_FILE, CODE_FILE, "*.png", "report/*.png")
# what is sent: a training's folder holds its optimiser and logs too, and training.json names folders of this machine
_SENT = [CARD_FILE, SURFACES_FILE, CODE_FILE, "*.png", "model_index.json", "*/*.json", "*/*.safetensors"]
_NOT_SENT = ["checkpoint-*", "unfinished-*"]
#: What `download` says of errors.
_NOT_FETCHED = {
    RepositoryNotFoundError: "is neither a folder here nor a repository on the Hub that you may read. Check the "
    "spelling; a private or gated one needs `token=...`, or `hf auth login`",
    RevisionNotFoundError: "has no revision {revision!r} on the Hub",
    LocalEntryNotFoundError: "is neither a folder here nor whole in the Hub's cache, and the Hub is out of reach (no "
    "connection, `HF_HUB_OFFLINE=1` or `local_files_only=True`). Check the spelling, or fetch it once while online",
}


def write_code(folder):
    """Writes `pipeline.py`, the code for `DiffusionPipeline`."""
    write_text(Path(folder) / CODE_FILE, CODE)


def forget_folders(folder):
    """Removes the path that a checkpoint was loaded from (`_name_or_path`) from all its configs before it is shared."""
    for path in [*Path(folder).glob("*.json"), *Path(folder).glob("*/*.json")]:
        with reading(path, "JSON"):
            config = json.loads(path.read_text(encoding="utf-8"))
        if isinstance(config, dict) and config.pop("_name_or_path", None) is not None:
            write_text(path, json.dumps(config, indent=2, sort_keys=True) + "\n")


def upload_checkpoint(
    folder, repo_id, token=None, private=None, commit_message=None, create_pr=False, path_in_repo=None
):
    """Sends a checkpoint's folder to the Hub: configs, safetensors, the card and its pictures, and nothing else.

    Args:
        folder (`str` or `Path`): of the checkpoint.
        repo_id (`str`): "user/name"; the repository is created if need be.
        token (`str`, *optional*): defaults to that of `hf auth login`.
        private (`bool`, *optional*): of a new repository.
        commit_message (`str`, *optional*)
        create_pr (`bool`): a pull request in place of a commit.
        path_in_repo (`str`, *optional*): a folder of the repository; defaults to its root.

    Returns:
        `huggingface_hub.CommitInfo`

    Raises:
        huggingface_hub.errors.HfHubHTTPError: if the Hub refuses.
    """
    if not (Path(folder) / CARD_FILE).is_file():
        logger.warning(
            f"{folder} has no {CARD_FILE}: {repo_id} gets no model card. The training scripts and examples/publish.py "
            "write one."
        )
    repo_id = huggingface_hub.create_repo(repo_id, private=private, token=token, exist_ok=True).repo_id
    return huggingface_hub.upload_folder(
        repo_id=repo_id,
        folder_path=str(folder),
        path_in_repo=path_in_repo,
        commit_message=commit_message or "Upload TactileTexturePipeline",
        token=token,
        create_pr=create_pr,
        allow_patterns=_SENT,
        ignore_patterns=_NOT_SENT,
    )


def download(name, **kwargs):
    """Fetches configs and safetensors of a checkpoint, never code or pickles; returns its local folder.

    Raises:
        OSError: if there is no such repository or revision, or the Hub is out of reach.
    """
    variant, revision = kwargs.get("variant"), kwargs.get("revision")
    weights = f"*.{variant}*.safetensors" if variant else "*.safetensors"
    passed = ("revision", "token", "cache_dir", "local_files_only", "force_download")
    try:
        return huggingface_hub.snapshot_download(
            name,
            allow_patterns=["*.json", weights],
            **{name: kwargs[name] for name in passed if kwargs.get(name) is not None},
        )
    except tuple(_NOT_FETCHED) as error:
        reason = next(words for kind, words in _NOT_FETCHED.items() if isinstance(error, kind))
        raise OSError(f"{name!r} {reason.format(revision=revision)}.") from error


def push_pipeline(pipe, repo_id, *options, variant=None, subfolder=None):
    """Sends a pipeline, with what lies beside it in the folder that it was loaded from (`upload_checkpoint`)."""
    source = Path(pipe.name_or_path or "")
    with TemporaryDirectory() as folder:
        for pattern in BESIDE if pipe.name_or_path and source.is_dir() else ():
            for path in source.glob(pattern):
                target = Path(folder) / path.relative_to(source)
                target.parent.mkdir(exist_ok=True)
                shutil.copyfile(path, target)
        pipe.save_pretrained(folder, variant=variant)
        forget_folders(folder)
        return upload_checkpoint(folder, repo_id, *options, path_in_repo=subfolder)

"""Checkpoints on the Hub: fetched without code, sent with their own card."""

import json
import shutil
from pathlib import Path
from tempfile import TemporaryDirectory

import huggingface_hub
from diffusers.utils import logging
from huggingface_hub.errors import LocalEntryNotFoundError, RepositoryNotFoundError, RevisionNotFoundError

from ..checkpoints import DISTILLED, SURFACES_FILE
from ..io.files import write_text
from ..io.reading import reading
from ..models.loading import WHY_NO_PICKLES

logger = logging.get_logger(__name__)

#: The model card of a checkpoint.
CARD_FILE = "README.md"
#: Makes `DiffusionPipeline.from_pretrained(folder, custom_pipeline="pipeline", trust_remote_code=True)` work.
CODE_FILE = "pipeline.py"
CODE = '''"""For `DiffusionPipeline.from_pretrained(folder, custom_pipeline="pipeline", trust_remote_code=True)`."""

from tactile_diffusers import TactileTexturePipeline  # noqa: F401
'''
#: What belongs to a checkpoint beside its components: the card, its pictures, the distilled decoder, the names of
#: the surfaces that must not judge it, and the code for `DiffusionPipeline`.
BESIDE = (CARD_FILE, SURFACES_FILE, CODE_FILE, "*.png", "report/*.png", f"{DISTILLED}/*")
# what is sent: a training's folder holds its optimiser and logs too, and training.json names folders of this machine
_SENT = [CARD_FILE, SURFACES_FILE, CODE_FILE, "*.png", "model_index.json", "*/*.json", "*/*.safetensors"]
_NOT_SENT = ["checkpoint-*", "unfinished-*"]


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


class HubMixin:
    """The part of `TactileTexturePipeline` that exchanges checkpoints with the Hub.

    diffusers' own methods refuse components from outside diffusers, and overwrite the model card.
    """

    @classmethod
    def download(cls, pretrained_model_name, **kwargs):
        """Fetches a checkpoint from the Hub and returns its local folder; `from_pretrained` calls it.

        diffusers' own version refuses components from outside diffusers (it looks for their source in the
        repository). Only configs and safetensors are fetched, never code or pickles.

        Raises:
            OSError: if there is no such repository or revision, or the Hub is out of reach.
        """
        variant, revision = kwargs.get("variant"), kwargs.get("revision")
        weights = f"*.{variant}*.safetensors" if variant else "*.safetensors"
        passed = ("revision", "token", "cache_dir", "local_files_only", "force_download")
        try:
            return huggingface_hub.snapshot_download(
                pretrained_model_name,
                allow_patterns=["*.json", weights],
                **{name: kwargs[name] for name in passed if kwargs.get(name) is not None},
            )
        except RepositoryNotFoundError as error:
            raise OSError(
                f"{pretrained_model_name!r} is neither a folder here nor a repository on the Hub that you may read. "
                "Check the spelling; a private or gated one needs `token=...`, or `hf auth login`."
            ) from error
        except RevisionNotFoundError as error:
            raise OSError(f"{pretrained_model_name!r} has no revision {revision!r} on the Hub.") from error
        except LocalEntryNotFoundError as error:
            raise OSError(
                f"{pretrained_model_name!r} is neither a folder here nor whole in the Hub's cache, and the Hub is out "
                "of reach (no connection, `HF_HUB_OFFLINE=1` or `local_files_only=True`). Check the spelling, or "
                "fetch it once while online."
            ) from error

    def save_pretrained(
        self,
        save_directory,
        safe_serialization=True,
        variant=None,
        max_shard_size=None,
        push_to_hub=False,
        repo_id=None,
        **kwargs,
    ):
        """Saves all components, see [`DiffusionPipeline.save_pretrained`]; a card in the folder stays as it is.

        A file `pipeline.py` is written, too. With it diffusers' base class loads the folder:
        `DiffusionPipeline.from_pretrained(folder, custom_pipeline="pipeline", trust_remote_code=True)`. From the Hub
        it cannot: fetch the repository first (`huggingface_hub.snapshot_download`), or load it by this class.

        Args:
            save_directory (`str` or `Path`): the checkpoint's folder.
            safe_serialization, variant, max_shard_size: as in diffusers.
            push_to_hub (`bool`): send the folder to the Hub, too.
            repo_id (`str`, *optional*): "user/name" there; defaults to the name of the folder, in your namespace.
            kwargs: `token`, `private`, `commit_message`, `create_pr` of `upload_checkpoint`.

        Raises:
            ValueError: for pickled weights: they could not be read again.
        """
        hub = ("token", "private", "commit_message", "create_pr") if push_to_hub else ()
        sending = {name: kwargs.pop(name) for name in hub if name in kwargs}
        _check_safe(safe_serialization)
        super().save_pretrained(save_directory, safe_serialization, variant, max_shard_size, **kwargs)
        write_text(Path(save_directory) / CODE_FILE, CODE)
        if push_to_hub:
            forget_folders(save_directory)
            upload_checkpoint(save_directory, repo_id or Path(save_directory).resolve().name, **sending)

    def push_to_hub(
        self,
        repo_id,
        commit_message=None,
        private=None,
        token=None,
        create_pr=False,
        safe_serialization=True,
        variant=None,
        subfolder=None,
    ):
        """Sends this pipeline to the Hub, see [`PushToHubMixin.push_to_hub`].

        The card of the folder that it was loaded from goes along, with its pictures and a distilled decoder beside
        it. Was this pipeline changed since? Then save it, write another card, and send that folder.

        Returns:
            `huggingface_hub.CommitInfo`

        Raises:
            ValueError: for pickled weights: none are fetched from the Hub.
        """
        _check_safe(safe_serialization)
        source = Path(self.name_or_path or "")
        with TemporaryDirectory() as folder:
            for pattern in BESIDE if self.name_or_path and source.is_dir() else ():
                for path in source.glob(pattern):
                    target = Path(folder) / path.relative_to(source)
                    target.parent.mkdir(exist_ok=True)
                    shutil.copyfile(path, target)
            self.save_pretrained(folder, safe_serialization, variant)
            forget_folders(folder)
            return upload_checkpoint(folder, repo_id, token, private, commit_message, create_pr, subfolder)


def _check_safe(safe_serialization):
    if not safe_serialization:
        raise ValueError(f"`safe_serialization` must not be False. {WHY_NO_PICKLES}")

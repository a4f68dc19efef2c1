"""How the pipeline is loaded, saved and shared. What checks folders, or talks to the Hub, is imported when needed."""

import copy
from pathlib import Path


class LoadingMixin:
    """The part of `TactileTexturePipeline` that exchanges checkpoints with folders and with the Hub.

    diffusers' own methods refuse components from outside diffusers, and overwrite the model card.
    """

    @classmethod
    def from_pretrained(cls, pretrained_model_name_or_path, **kwargs):
        """Loads a checkpoint, see [`DiffusionPipeline.from_pretrained`].

        Args:
            pretrained_model_name_or_path (`str` or `Path`): a folder, or the id of a repository on the Hub.
            kwargs: as in diffusers: components by name (they are not looked for in the folder; `None` leaves an
                optional one out, such as `lctg_distilled`), `dtype`, `variant`, `revision`, `token` and so on.

        Raises:
            OSError: if a local folder lacks a component, naming it, or the Hub has no such repository or revision.
            ValueError: for a `subfolder`, or for a damaged file, naming it.
        """
        if kwargs.get("subfolder") is not None:
            raise ValueError(
                f"`subfolder` must be left out, got {kwargs['subfolder']!r}: a pipeline is loaded from a whole folder. "
                'One model alone is loaded by its own class, `LCTGModel.from_pretrained(folder, subfolder="lctg")`.'
            )
        from .folders import check_folder

        check_folder(pretrained_model_name_or_path, kwargs)
        return super().from_pretrained(pretrained_model_name_or_path, **kwargs)

    @classmethod
    def from_pipe(cls, pipeline, **components):
        """A pipeline that shares the models of another one and has copies of its schedulers.

        So two pipelines may serve two threads. Models keep their device, and their dtype unless another is asked for.

        Args:
            pipeline (`TactileTexturePipeline`): its setting of the progress bar is kept, too.
            components: those that replace the ones of `pipeline`, such as `lctg`; and `dtype`, to which the models are
                cast, in `pipeline` as well: they are shared.
        """
        dtype = components.pop("dtype", components.pop("torch_dtype", None))
        shared = {
            name: copy.deepcopy(component) if name.endswith("scheduler") else component
            for name, component in pipeline.components.items()
        }
        new = cls(**{**shared, **components})
        new.set_progress_bar_config(**getattr(pipeline, "_progress_bar_config", {}))
        return new if dtype is None else new.to(dtype)

    @classmethod
    def download(cls, pretrained_model_name, **kwargs):
        """Fetches a checkpoint from the Hub and returns its local folder; `from_pretrained` calls it."""
        from .hub import download

        return download(pretrained_model_name, **kwargs)

    def save_pretrained(
        self, save_directory, safe_serialization=True, variant=None, max_shard_size=None, push_to_hub=False, **kwargs
    ):
        """Saves all components, see [`DiffusionPipeline.save_pretrained`]; a card in the folder stays as it is.

        A file `pipeline.py` is written, too. With it diffusers' base class loads the folder:
        `DiffusionPipeline.from_pretrained(folder, custom_pipeline="pipeline", trust_remote_code=True)`. From the Hub
        it cannot: fetch the repository first (`huggingface_hub.snapshot_download`), or load it by this class.

        Args:
            save_directory (`str` or `Path`): the checkpoint's folder.
            safe_serialization, variant, max_shard_size: as in diffusers.
            push_to_hub (`bool`): send the folder to the Hub, too.
            kwargs: `repo_id` ("user/name"; defaults to the name of the folder, in your namespace), `token`, `private`,
                `commit_message`, `create_pr` of `upload_checkpoint`.

        Raises:
            ValueError: for pickled weights, or a model that wears adapters: they could not be read again.
        """
        from ..models.model_files import check_plain, check_safe
        from .hub import forget_folders, upload_checkpoint, write_code

        check_safe("safe_serialization", safe_serialization)
        for component in self.components.values():
            check_plain(component)
        names = ("token", "private", "commit_message", "create_pr") if push_to_hub else ()
        sending = {name: kwargs.pop(name) for name in names if name in kwargs}
        repo_id = kwargs.pop("repo_id", None) or Path(save_directory).resolve().name
        super().save_pretrained(save_directory, safe_serialization, variant, max_shard_size, **kwargs)
        write_code(save_directory)
        if push_to_hub:
            forget_folders(save_directory)
            upload_checkpoint(save_directory, repo_id, **sending)

    def push_to_hub(self, repo_id, commit_message=None, private=None, token=None, create_pr=False, **kwargs):
        """Sends this pipeline to the Hub, see [`PushToHubMixin.push_to_hub`].

        The card of the folder that it was loaded from goes along, with its pictures. Was this pipeline changed since?
        Then save it, write another card, and send that folder.

        Args:
            repo_id, commit_message, private, token, create_pr: of `upload_checkpoint`.
            kwargs: `variant` of the weights' names, `subfolder` of the repository.

        Returns:
            `huggingface_hub.CommitInfo`

        Raises:
            ValueError: for pickled weights: none are fetched from the Hub.
        """
        from ..models.model_files import check_safe
        from .hub import push_pipeline

        check_safe("safe_serialization", kwargs.pop("safe_serialization", None))
        return push_pipeline(self, repo_id, token, private, commit_message, create_pr, **kwargs)

"""Checkpoints on the Hub, its calls patched or answered from its cache: what is sent, fetched, kept and refused."""

import shutil
from pathlib import Path
from types import SimpleNamespace

import huggingface_hub
import pytest
import torch
from huggingface_hub.errors import (
    GatedRepoError,
    LocalEntryNotFoundError,
    RepositoryNotFoundError,
    RevisionNotFoundError,
)
from huggingface_hub.utils import filter_repo_objects

from tactile_diffusers import DALEModel, LCTGModel, TactileTexturePipeline
from tactile_diffusers.checkpoints import SURFACES_FILE

CARD = "---\nlibrary_name: diffusers\n---\n\n# ours\n\n![loss](loss.png)\n"
COMMIT = "0123456789abcdef0123456789abcdef01234567"


class Hub:
    """Stands for the Hub's three calls: repositories are folders; what is asked of it is kept."""

    def __init__(self, folder):
        self.folder, self.created, self.sent, self.fetched = folder, [], [], []

    def create_repo(self, repo_id, **options):
        self.created.append((repo_id, options))
        return SimpleNamespace(repo_id=repo_id if "/" in repo_id else f"someone/{repo_id}")

    def upload_folder(self, *, repo_id, folder_path, path_in_repo, allow_patterns, ignore_patterns, **options):
        self.sent.append((repo_id, options))
        target = self.folder / repo_id / (path_in_repo or "")
        self._copy(folder_path, target, allow_patterns, ignore_patterns)
        return "the commit"

    def snapshot_download(self, repo_id, *, allow_patterns, **options):
        self.fetched.append((repo_id, options))
        cached = self.folder / "cache" / repo_id
        self._copy(self.folder / repo_id, cached, allow_patterns, None)
        return str(cached)

    def _copy(self, source, target, allowed, ignored):
        files = files_of(source)
        for name in filter_repo_objects(files, allow_patterns=allowed, ignore_patterns=ignored):
            (target / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(f"{source}/{name}", target / name)


def files_of(folder):
    return sorted(str(path.relative_to(folder)) for path in Path(folder).rglob("*") if path.is_file())


@pytest.fixture
def hub(tmp_path, monkeypatch):
    hub = Hub(tmp_path / "hub")
    for call in ("create_repo", "upload_folder", "snapshot_download"):
        monkeypatch.setattr(huggingface_hub, call, getattr(hub, call))
    return hub


@pytest.fixture
def saved(pipe, tmp_path):
    """A checkpoint with a card, a picture and its surfaces, as `publish.py` writes it."""
    folder = tmp_path / "saved"
    pipe.save_pretrained(str(folder))
    (folder / "README.md").write_text(CARD)
    (folder / "loss.png").write_bytes(b"png")
    (folder / SURFACES_FILE).write_text("{}")
    return folder


def assert_equal_weights(first, second):
    first, second = first.state_dict(), second.state_dict()
    assert [name for name in first if not torch.equal(first[name], second[name])] == []


def of_loading(warnings):
    """Without those that the Hub is offline, and of the Hub's package about how diffusers calls it."""
    return [text for text in warnings if "Could not reach the Hub" not in text and "local_dir_use_symlinks" not in text]


class TestSending:
    def test_saving_with_push_sends_the_folder_with_our_card(self, hub, saved, pipe):
        pipe.save_pretrained(
            str(saved), push_to_hub=True, repo_id="someone/textures", token="secret", private=True, create_pr=True
        )
        assert (saved / "README.md").read_text() == CARD  # diffusers would write its own over it
        assert (hub.folder / "someone/textures/README.md").read_text() == CARD
        assert hub.created == [("someone/textures", {"private": True, "token": "secret", "exist_ok": True})]
        [(repo, options)] = hub.sent
        assert repo == "someone/textures" and options["token"] == "secret" and options["create_pr"] is True
        sent = {"lctg/config.json", "loss.png", "model_index.json", SURFACES_FILE}
        assert sent <= set(files_of(hub.folder / repo))

    def test_pushing_a_loaded_pipeline_takes_the_card_of_its_folder_along(self, hub, saved):
        before = files_of(saved)
        pipe = TactileTexturePipeline.from_pretrained(str(saved))
        made = pipe.push_to_hub("someone/textures", commit_message="better", private=True, token="secret")
        assert made == "the commit" and files_of(saved) == before
        assert files_of(hub.folder / "someone/textures") == before
        assert (hub.folder / "someone/textures/README.md").read_text() == CARD
        assert hub.sent[0][1]["commit_message"] == "better"

    def test_only_the_checkpoint_of_a_training_is_sent(self, hub, saved, pipe):
        whole = files_of(saved)
        for name in ("checkpoint-2/lctg/config.json", "checkpoint-2/optimizer.bin", "unfinished-checkpoint-4/x.json"):
            (saved / name).parent.mkdir(parents=True, exist_ok=True)
            (saved / name).write_text("{}")
        for name in ("training.json", "log.jsonl", "code.py", "notes.txt"):
            (saved / name).write_text('{"train_data_dir": "/home/someone/prepared.h5"}')
        pipe.save_pretrained(saved, push_to_hub=True)  # a Path, too, which diffusers' own refuses
        assert files_of(hub.folder / "someone/saved") == whole  # the repository is called like the folder

    def test_a_card_on_the_hub_is_left_alone_by_a_pipeline_without_one(self, hub, pipe, recorded_warnings):
        theirs = hub.folder / "someone/textures/README.md"
        theirs.parent.mkdir(parents=True)
        theirs.write_text("theirs")
        with recorded_warnings() as found:
            pipe.push_to_hub("someone/textures")
        assert theirs.read_text() == "theirs"
        assert len(found) == 1 and "has no README.md" in found[0]

    def test_pickles_are_refused_before_anything_is_created(self, hub, pipe, tmp_path):
        with pytest.raises(ValueError, match="`safe_serialization` must not be False"):
            pipe.push_to_hub("someone/textures", safe_serialization=False)
        with pytest.raises(ValueError, match="`safe_serialization` must not be False"):
            pipe.save_pretrained(str(tmp_path / "new"), safe_serialization=False, push_to_hub=True)
        assert hub.created == [] and not (tmp_path / "new").exists()


class TestFetching:
    def test_what_was_sent_is_loaded_again(self, hub, pipe, recorded_warnings):
        pipe.push_to_hub("someone/textures")
        with recorded_warnings() as found:
            again = TactileTexturePipeline.from_pretrained(
                "someone/textures", revision="v2", token="secret", local_files_only=True
            )
        assert found == []
        assert hub.fetched == [
            (
                "someone/textures",
                {"revision": "v2", "token": "secret", "local_files_only": True, "force_download": False},
            )
        ]
        for name in ("lctg", "dale"):
            assert_equal_weights(getattr(again, name), getattr(pipe, name))

    def test_neither_code_nor_pickles_are_fetched(self, hub, pipe):
        pipe.push_to_hub("someone/textures")
        repo = hub.folder / "someone/textures"
        for name in ("pipeline.py", "lctg/lctg.py", "lctg/diffusion_pytorch_model.bin", "evil.pkl", "notes.md"):
            (repo / name).write_text("raise SystemExit")
        TactileTexturePipeline.from_pretrained("someone/textures")
        fetched = files_of(hub.folder / "cache/someone/textures")
        assert {name.rsplit(".", 1)[1] for name in fetched} == {"json", "safetensors"}

    def test_a_variant_fetches_its_own_weights_alone(self, hub, pipe):
        pipe.push_to_hub("someone/textures")
        pipe.push_to_hub("someone/textures", variant="fp16")
        again = TactileTexturePipeline.from_pretrained("someone/textures", variant="fp16")
        fetched = [name for name in files_of(hub.folder / "cache/someone/textures") if name.endswith("safetensors")]
        assert sorted(fetched) == [f"{n}/diffusion_pytorch_model.fp16.safetensors" for n in ("dale", "lctg")]
        assert_equal_weights(again.lctg, pipe.lctg)
        with pytest.raises(ValueError, match="variant=bf16"):
            TactileTexturePipeline.from_pretrained("someone/textures", variant="bf16")

    @pytest.mark.parametrize(
        ("error", "message"),
        [
            (RepositoryNotFoundError, "'runs/dael' is neither a folder here nor a repository on the Hub.*`token="),
            (GatedRepoError, "'runs/dael' is neither a folder here nor a repository on the Hub that you may read"),
            (RevisionNotFoundError, "'runs/dael' has no revision 'v9' on the Hub"),
            (LocalEntryNotFoundError, "'runs/dael' is neither a folder here nor whole in the Hub's cache"),
        ],
    )
    def test_what_is_not_there_is_said(self, monkeypatch, error, message):
        def refuse(*_, **__):
            made = error.__new__(error)
            Exception.__init__(made, "401 Client Error")
            raise made

        monkeypatch.setattr(huggingface_hub, "snapshot_download", refuse)
        with pytest.raises(OSError, match=message) as caught:
            TactileTexturePipeline.from_pretrained("runs/dael", revision="v9")
        assert isinstance(caught.value.__cause__, error)


class TestCache:
    """The Hub's own code, offline (tests/conftest.py): a repository that was fetched before."""

    @pytest.fixture
    def cache(self, saved, tmp_path):
        """The cache folder with someone/textures: the branch main and the tag v2 are one commit."""
        repo = tmp_path / "cache" / "models--someone--textures"
        shutil.copytree(saved, repo / "snapshots" / COMMIT)
        for revision in ("main", "v2"):
            (repo / "refs").mkdir(exist_ok=True)
            (repo / "refs" / revision).write_text(COMMIT)
        return str(tmp_path / "cache")

    @pytest.mark.parametrize("options", [{}, {"revision": "v2"}, {"local_files_only": True}, {"token": "secret"}])
    def test_pipelines_and_single_models(self, cache, pipe, options, recorded_warnings):
        options = {"cache_dir": cache, **options}
        again = TactileTexturePipeline.from_pretrained("someone/textures", **options)
        with recorded_warnings() as found:
            lctg = LCTGModel.from_pretrained("someone/textures", subfolder="lctg", **options)
            dale = DALEModel.from_pretrained("someone/textures", subfolder="dale", **options)
        assert of_loading(found) == []
        for model, expected in ((again.dale, pipe.dale), (lctg, pipe.lctg), (dale, pipe.dale)):
            assert_equal_weights(model, expected)

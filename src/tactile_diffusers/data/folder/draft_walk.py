"""The files of a folder, and those that are not looked at with the reason."""

import os
from dataclasses import dataclass, field
from pathlib import Path

from .tables import kind_of

#: No more files than this are listed: enough to see how they are named.
MOST_FILES = 5000
#: Nor more of one folder, so that one sensor's files do not hide another's.
MOST_IN_FOLDER = 1000
#: Files of other programs, not of the person who recorded.
HIDDEN_PREFIXES = (".", "__", "~$")
#: Text files that are no tables.
TEXT_NAMES = ("readme", "license", "licence", "changelog", "requirements")


@dataclass
class FileList:
    """What `list_files` found, sorted; paths are relative and written with "/".

    Attributes:
        files (`dict[str, int]`): files of a kind that can be read -> bytes.
        others (`list[str]`): files of other kinds.
        skipped (`dict[str, str]`): file or folder that was not looked at -> why.
        truncated (`bool`): whether there are more files than that.
    """

    files: dict = field(default_factory=dict)
    others: list = field(default_factory=list)
    skipped: dict = field(default_factory=dict)
    truncated: bool = False


def list_files(root):
    """Lists a folder and all below it, without following links to folders.

    Args:
        root (`str` or `Path`): the folder.

    Returns:
        `FileList`.

    Raises:
        FileNotFoundError: if there is no folder.
    """
    root = Path(root)
    if not root.is_dir():
        raise FileNotFoundError(f"There is no folder {root}.")
    found = FileList()

    def refused(error):
        found.skipped[Path(error.filename).relative_to(root).as_posix()] = error.strerror

    for place, folders, names in os.walk(root, onerror=refused):
        here = Path(place).relative_to(root)
        for name in sorted(folders):
            if name.startswith(HIDDEN_PREFIXES):
                found.skipped[(here / name).as_posix()] = "hidden folder"
            elif Path(place, name).is_symlink():
                found.skipped[(here / name).as_posix()] = "link to a folder"
        folders[:] = sorted(name for name in folders if (here / name).as_posix() not in found.skipped)
        found.truncated |= len(names) > MOST_IN_FOLDER
        for name in sorted(names)[:MOST_IN_FOLDER]:
            if len(found.files) + len(found.others) + len(found.skipped) >= MOST_FILES:
                found.truncated = True
                return found
            _sort_in(found, root, (here / name).as_posix())
    return found


def _sort_in(found, root, path):
    name = path.rpartition("/")[2]
    if not _is_text(path):
        found.skipped[path.encode(errors="replace").decode()] = "its name is no valid UTF-8"
    elif name.startswith(HIDDEN_PREFIXES):
        found.skipped[path] = "hidden"
    elif kind_of(name) is None or name.lower().startswith(TEXT_NAMES):
        found.others.append(path)
    elif not os.access(root / path, os.R_OK):
        found.skipped[path] = "may not be read, or is a broken link"
    elif not (size := (root / path).stat().st_size):
        found.skipped[path] = "empty"
    else:
        found.files[path] = size


def _is_text(path):
    try:
        path.encode()
    except UnicodeEncodeError:
        return False
    return True

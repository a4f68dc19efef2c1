"""Refusals of damaged files: every room reads through this, and nothing heavy is imported for it."""

import json
from contextlib import contextmanager
from pathlib import Path

# of a library's message: some quote the file
_LONGEST_REASON = 300


@contextmanager
def reading(path, kind, remedy="Copy it again, or write it again."):
    """Whatever a damaged file makes the block raise becomes a `ValueError` that names the file, and `kind`.

    So do a `PermissionError` and a `MemoryError`, whose remedies are others. A `FileNotFoundError`, and a `ValueError`
    or `OSError` that names the file already, pass as they are.
    """
    try:
        yield
    except FileNotFoundError:
        raise
    except PermissionError as error:
        raise ValueError(f"{path} may not be read ({error}). Change its permissions.") from error
    except MemoryError as error:
        raise ValueError(
            f"{path} cannot be read as {kind}: it does not fit into memory ({str(error)[:_LONGEST_REASON] or 'full'}). "
            "Free memory, or read it on a larger machine; write the file again if it is much smaller than that: its "
            "header claims too much."
        ) from error
    except Exception as error:  # h5py, zipfile, numpy, json and others raise a dozen kinds
        if type(error) in (ValueError, OSError) and str(path) in str(error):
            raise
        reason = f"{error} is missing" if type(error) is KeyError else str(error) or type(error).__name__
        raise ValueError(f"{path} cannot be read as {kind} ({reason[:_LONGEST_REASON]}). {remedy}") from error


def read_json(path, kind, remedy="Copy it again, or write it again."):
    """A JSON object from a file, a dict.

    Raises:
        FileNotFoundError: if there is no file.
        ValueError: if it is truncated, no JSON, or no object.
    """
    with reading(path, kind, remedy):
        content = json.loads(Path(path).read_text(encoding="utf-8-sig"))  # Windows puts a mark before UTF-8
        if not isinstance(content, dict):
            raise ValueError(f"it holds a {type(content).__name__}, not an object")
    return content

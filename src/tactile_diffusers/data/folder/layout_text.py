"""`layout.toml` as text: read with its faults named by key, and written; the standard library only reads TOML."""

import difflib
import json
import re
import tomllib
from pathlib import Path

from pydantic import ValidationError

from ...io.reading import reading
from .layout import TODO, FilesLayout, Force, Lateral, Layout, RatingsLayout

#: Characters of a line: tomllib takes the square of a key's length, minutes for 200 kB of dots.
LONGEST_LINE = 10_000
#: A comment that makes a line longer than this stands before it.
LONGEST_WRITTEN = 100


def load_layout(path):
    """Reads and checks a `layout.toml`.

    Args:
        path (`str` or `Path`): the file.

    Returns:
        `Layout`.

    Raises:
        FileNotFoundError: if there is no file.
        ValueError: naming the file and every key that is wrong, or still holds "TODO".
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"There is no layout {path}.")
    with reading(path, "TOML", "Correct it."):
        text = path.read_text(encoding="utf-8-sig")
        if max(map(len, text.splitlines()), default=0) > LONGEST_LINE:
            raise ValueError(f"a line has more than {LONGEST_LINE} characters")
        content = tomllib.loads(text)
    faults = list(_todos(content))
    if not faults:
        try:
            layout = Layout.model_validate(content)
        except ValidationError as error:
            faults = [_in_words(fault) for fault in error.errors(include_url=False)]
        else:
            layout._path = path
            return layout
    raise ValueError(f"{path}: " + "\n".join(faults))


def _todos(value, keys=()):
    """A sentence for each key whose name or value is still to be filled in."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for name, item in items:
        if isinstance(name, str) and TODO in name:
            yield f"the name of `{_key(keys + (name,))}` is still to be filled in."
        if isinstance(item, str) and TODO in item:
            yield f"`{_key(keys + (name,))}` = {item!r} is still to be filled in, or to be removed."
        yield from _todos(item, keys + (name,))


def _in_words(fault):
    reason = fault["msg"].removeprefix("Value error, ").rstrip(".")
    if fault["type"] == "extra_forbidden":
        known = {key for model in (Layout, FilesLayout, RatingsLayout, Force, Lateral) for key in model.model_fields}
        near = difflib.get_close_matches(fault["loc"][-1], known, n=1)
        reason = f"is no key of a layout{f', did you mean `{near[0]}`?' if near else ''}"
    value = f" = {fault['input']!r}" if isinstance(fault["input"], str | int | float | list) else ""
    return f"`{_key(fault['loc'])}`{value}: {reason}." if fault["loc"] else f"{reason}."


def _key(keys):
    """A key as people find it: "[[files]] 2, time.unit"."""
    keys = tuple(key for key in keys if key != "[key]")
    text = "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in keys)[1:]
    if keys[0] != "files" or len(keys) < 2:
        return text
    return ", ".join([f"[[files]] {keys[1] + 1}", *([_key(keys[2:])] if keys[2:] else [])])


def toml_value(value):
    """A `str`, `int`, `float`, `list` or `dict` (as an inline table) as TOML text; whole floats lose their point."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{_name(name)} = {toml_value(item)}" for name, item in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(toml_value, value)) + "]"
    if isinstance(value, str):
        # TOML's basic strings are JSON's, except that U+007F must be escaped
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return str(int(value)) if value == int(value) else repr(float(value))


def toml_comment(text):
    """A comment on one line."""
    return "# " + re.sub(r"[\s\x00-\x1f\x7f]+", " ", text)


def toml_table(header, values, comments=()):
    """A `header` such as "[ratings]" and lines "key = value"; `comments` are key -> text behind or before its line."""
    lines = [header] if header else []
    for name, value in values.items():
        line, comment = f"{_name(name)} = {toml_value(value)}", comments[name] if name in comments else ""
        if not comment:
            lines.append(line)
        elif len(line) + len(comment) > LONGEST_WRITTEN:
            lines += [toml_comment(comment), line]
        else:
            lines.append(f"{line}  {toml_comment(comment)}")
    return "\n".join(lines)


def _name(name):
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else toml_value(name)

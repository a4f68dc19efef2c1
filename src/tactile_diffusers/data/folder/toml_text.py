"""Values of TOML as text: what `layout.toml` needs, since the standard library only reads it."""

import json
import re

#: A comment that makes a line longer than this stands before it.
LONGEST_LINE = 100
_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")


def toml_value(value):
    """A `str`, `int`, `float`, `list` or `dict` (as an inline table) as TOML text; whole floats lose their point."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{toml_key(name)} = {toml_value(item)}" for name, item in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(toml_value, value)) + "]"
    if isinstance(value, str):
        # TOML's basic strings are JSON's, except that U+007F must be escaped
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return str(int(value)) if value == int(value) else repr(float(value))


def toml_key(name):
    """A key: bare where TOML allows it, else quoted."""
    return name if _BARE_KEY.fullmatch(name) else toml_value(name)


def toml_comment(text):
    """A comment on one line."""
    return "# " + re.sub(r"[\s\x00-\x1f\x7f]+", " ", text)


def toml_lines(values, comments=()):
    """Lines "key = value" of a mapping.

    Args:
        values (`dict`): name -> value; `None` is left out.
        comments (`dict`, *optional*): name -> text of a comment, behind the value or on a line before a long one.

    Returns:
        `list[str]`.
    """
    comments, lines = dict(comments), []
    for name, value in values.items():
        if value is None:
            continue
        line = f"{toml_key(name)} = {toml_value(value)}"
        if name not in comments:
            lines.append(line)
        elif len(line) + len(comments[name]) > LONGEST_LINE:
            lines += [toml_comment(comments[name]), line]
        else:
            lines.append(f"{line}  {toml_comment(comments[name])}")
    return lines

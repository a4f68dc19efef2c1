"""Values of TOML as text: what `layout.toml` needs, since the standard library only reads it."""

import json
import re

#: A comment that makes a line longer than this stands before it.
LONGEST_LINE = 100


def toml_value(value):
    """A `str`, `int`, `float`, `list` or `dict` (as an inline table) as TOML text; whole floats lose their point."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{_key(name)} = {toml_value(item)}" for name, item in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(toml_value, value)) + "]"
    if isinstance(value, str):
        # TOML's basic strings are JSON's, except that U+007F must be escaped
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return str(int(value)) if value == int(value) else repr(float(value))


def _key(name):
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else toml_value(name)


def toml_comment(text):
    """A comment on one line."""
    return "# " + re.sub(r"[\s\x00-\x1f\x7f]+", " ", text)


def toml_table(values, comments=None, header=None):
    """Lines "key = value" of a mapping, without those that are `None`, behind a `header` such as "[ratings]".

    `comments` are name -> text, written behind the value, or on a line before a long one.
    """
    lines = [] if header is None else [header]
    for name, value in values.items():
        line, comment = f"{_key(name)} = {toml_value(value)}" if value is not None else None, (comments or {}).get(name)
        if line is None:
            continue
        if comment is None:
            lines.append(line)
        elif len(line) + len(comment) > LONGEST_LINE:
            lines += [toml_comment(comment), line]
        else:
            lines.append(f"{line}  {toml_comment(comment)}")
    return "\n".join(lines)

"""Patterns of paths with named fields, such as "sliding/{surface}/P{explorer}_{trial}_force.csv"."""

import re
import unicodedata
from dataclasses import dataclass, field

_PARTS = re.compile(r"\{([^{}]*)\}|\*")
_FIELD = re.compile(r"[A-Za-z]\w*(\.\w+)?")


@dataclass(frozen=True)
class Pattern:
    """Matches paths written with "/" and reads the named fields.

    `{name}` stands for one or more characters without "/", as few as possible, and `*` for any number of them. A name
    that occurs twice must have the same value in both places. `{trial.speed}_{trial.force}` makes one field `trial` of
    several parts, joined by "_".

    Args:
        text (`str`): the pattern, relative.

    Raises:
        ValueError: if a field has no valid name, or the path is absolute or leaves its folder.
    """

    text: str
    fields: tuple[str, ...] = field(init=False)
    _regex: re.Pattern = field(init=False, repr=False, compare=False)

    def __post_init__(self):
        if not self.text or self.text.startswith("/") or "\\" in self.text or ".." in self.text.split("/"):
            raise ValueError("must be a relative path written with '/' and without '..'")
        fields, regex, end = {}, "", 0
        for part in _PARTS.finditer(self.text):
            regex += re.escape(self.text[end : part.start()])
            end = part.end()
            name = part.group(1)
            if name is None:
                regex += "[^/]*"
            elif not _FIELD.fullmatch(name):
                raise ValueError(f"{{{name}}} is no name for a field, write for example {{surface}}")
            else:
                group = name.replace(".", "__")
                regex += f"(?P={group})" if name in fields else f"(?P<{group}>[^/]+?)"
                fields[name] = True
        regex += re.escape(self.text[end:])
        if set("{}") & set(_PARTS.sub("", self.text)):
            raise ValueError("has a brace without its partner")
        object.__setattr__(self, "fields", tuple(fields))
        object.__setattr__(self, "_regex", re.compile(regex))

    @property
    def names(self):
        """Names of the fields, parts joined: a tuple in the order of appearance."""
        return tuple(dict.fromkeys(name.partition(".")[0] for name in self.fields))

    @property
    def literal(self):
        """Whether it matches its own text only."""
        return not _PARTS.search(self.text)

    def match(self, path):
        """The fields of a path: `dict[str, str]`, or `None` if it does not match."""
        found = self._regex.fullmatch(path)
        if found is None:
            return None
        values = {}
        for name in self.fields:
            value = found.group(name.replace(".", "__"))
            # macOS stores "é" as two characters: one spelling, so that names compare
            values.setdefault(name.partition(".")[0], []).append(unicodedata.normalize("NFC", value))
        return {name: "_".join(parts) for name, parts in values.items()}

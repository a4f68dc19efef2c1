"""The keys of a TOML table, taken one by one and checked: what is wrong is named by file, key, value and remedy."""

import difflib

from .patterns import Pattern

#: What a value or name holds that is still to be filled in.
TODO = "TODO"
_TYPE_WORDS = {str: "a text", int: "a whole number", float: "a number", dict: "a table", list: "a list"}


def refuse_todo(path, value):
    """Raises a `ValueError` naming all keys of nested tables whose name or value is still to be filled in."""
    left = list(_todos(value))
    if left:
        raise ValueError(f"{path}: " + "\n".join(left))


def _todos(value, key=""):
    """A sentence for each."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for name, item in items:
        inner = f"{key}.{name}" if isinstance(name, str) and key else f"{key}[{name}]" if key else name
        if isinstance(name, str) and TODO in name:
            yield f"the name of `{inner}` is still to be filled in."
        if isinstance(item, str) and TODO in item:
            yield f"`{inner}` = {item!r} is still to be filled in, or to be removed."
        yield from _todos(item, inner)


class Keys:
    """One table of a TOML file.

    Args:
        path (`Path`): the file.
        where (`str`): the table for messages, "" = the top.
        content (`dict`): what it holds.

    All methods raise a `ValueError` for what is missing, unknown or of the wrong type.
    """

    def __init__(self, path, where, content):
        self.path, self.where, self._content, self._known = path, where, dict(content), []

    @property
    def names(self):
        """The keys that nobody took yet: `list[str]`."""
        return list(self._content)

    def __contains__(self, key):
        return key in self._content

    def fail(self, key, problem):
        name = f"{self.where}, `{key}`" if self.where else f"`{key}`"
        raise ValueError(f"{self.path}: {name} {problem}{'' if problem.endswith('?') else '.'}")

    def take(self, key, kinds, *default):
        """The value of a key; without a default it must be there. A whole number is a float, but no bool a number."""
        self._known.append(key)
        if key not in self._content:
            if not default:
                self.fail(key, "is missing")
            return default[0]
        value = self._content.pop(key)
        kinds = kinds if isinstance(kinds, tuple) else (kinds,)
        if isinstance(value, bool) or not isinstance(value, kinds + ((int,) if float in kinds else ())):
            self.fail(key, f"= {value!r} must be {' or '.join(_TYPE_WORDS[kind] for kind in kinds)}")
        return float(value) if kinds == (float,) else value

    def choice(self, key, choices, *default):
        """The value, one of `choices`."""
        value = self.take(key, str, *default)
        if value not in choices and not (default and value == default[0]):
            self.fail(key, f"= {value!r} must be one of {', '.join(map(repr, choices))}")
        return value

    def table(self, key):
        """A table inside this one as `Keys`, or `None`."""
        content = self.take(key, dict, None)
        if content is None:
            return None
        return Keys(self.path, f"{self.where}, `{key}`" if self.where else f"[{key}]", content)

    def tables(self, key):
        """One or more tables, [[key]], as a list of `Keys`."""
        contents = self.take(key, list)
        if not contents or not all(isinstance(content, dict) for content in contents):
            self.fail(key, f"must be one or more tables, each headed [[{key}]]")
        return [Keys(self.path, f"[[{key}]] {number}", content) for number, content in enumerate(contents, 1)]

    def pattern(self, key, *default):
        """The value as a `Pattern`."""
        text = self.take(key, str, *default)
        try:
            return None if text is None else Pattern(text)
        except ValueError as error:
            self.fail(key, f"= {error}".rstrip("."))

    def finish(self):
        """Refuses keys that nobody took."""
        for key in self._content:
            near = difflib.get_close_matches(key, self._known, n=1)
            self.fail(key, "is unknown" + (f": did you mean `{near[0]}`?" if near else f"; known: {self._known}"))

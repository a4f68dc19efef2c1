"""Keys of a layout that say which files are meant and how their tables are stored."""

from .patterns import Pattern
from .tables import KINDS, TREE_KINDS, kind_of


def table_keys(keys, header=None):
    """Takes `pattern`, `kind`, `inside` or `sheet`, `delimiter` and `header` from a table of a layout.

    Args:
        keys (`Keys`): the table.
        header (`int` or `None`): the default of `header`.

    Returns:
        `dict`: pattern (`Pattern`), kind (`str`), inside (`Pattern` or `None`), delimiter, header.

    Raises:
        ValueError: naming file, key, value and remedy.
    """
    pattern = keys.pattern("pattern")
    kind = keys.choice("kind", tuple(sorted(set(KINDS.values()))), kind_of(pattern.text))
    if kind is None:
        keys.fail("kind", f"is missing, and the ending of {pattern.text!r} does not tell it")
    header = keys.take("header", int, header)
    if header is not None and header < 0:
        keys.fail("header", f"= {header} must be 0 (no names) or the number of lines before the data")
    delimiter = keys.take("delimiter", str, None)
    if delimiter is not None and len(delimiter) != 1:
        keys.fail("delimiter", f"= {delimiter!r} must be one character; a space stands for any white space")
    for key, kinds in (("inside", TREE_KINDS), ("sheet", ("xlsx",))):
        if key in keys and kind not in kinds:
            keys.fail(key, f"is for {', '.join(kinds)}, not for {kind}: remove it")
    inside: Pattern | None = keys.pattern("sheet" if kind == "xlsx" else "inside", None)
    return dict(pattern=pattern, kind=kind, inside=inside, delimiter=delimiter, header=header)

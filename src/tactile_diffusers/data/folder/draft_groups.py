"""Groups of tables of one kind, a few of each opened, and what they probably are in a recording."""

import re
from dataclasses import dataclass, field, replace
from pathlib import Path

from tqdm import tqdm

from .draft_columns import HEAD_ROWS, Column, TableFacts, describe_table
from .draft_names import NameField, NameGroup, group_names
from .tables import kind_of, list_tables
from .trees import open_tree

#: Files of a kind that are opened: the first, the one in the middle, the last.
FILES_OPENED = 3
#: Files that are opened in all.
MOST_OPENED = 90
#: Files of kinds that are read as a whole are opened up to this size (bytes).
LARGEST_OPENED = 500_000_000
READ_WHOLE = ("mat", "npz", "parquet", "xlsx")
#: Names that may turn out to be of several kinds, such as "forces.csv" beside "subjects.csv".
MOST_SPLIT = 6
#: Attribute `format` of HDF5 files that this package writes.
OUR_FORMATS = "tactile-"
_HERTZ = re.compile(r"(\d+(?:\.\d+)?)[ _]?(k?)Hz", re.IGNORECASE)


@dataclass
class TableGroup:
    """Tables of one kind.

    Attributes:
        files (`NameGroup`): names of the files.
        kind (`str`): of the files, as in `tables.KINDS`.
        bytes (`int`): of all files.
        inside (`NameGroup` or `None`): places inside a file, or sheets; `None` = a file is one table.
        tables (`list[TableFacts]`): of the files that were opened, the first place inside each.
        channels (`dict[str, dict[str, Column]]`): "force", "lateral", "position", "velocity" -> axis -> column.
        doubts (`list[str]`): what was only guessed, or looks wrong.
    """

    files: NameGroup
    kind: str
    bytes: int = 0
    inside: NameGroup | None = None
    tables: list[TableFacts] = field(default_factory=list)
    channels: dict[str, dict[str, Column]] = field(default_factory=dict)
    doubts: list[str] = field(default_factory=list)

    @property
    def fields(self):
        """Fields of the names of the files, then of the places inside."""
        return self.files.fields + (self.inside.fields if self.inside else [])

    @property
    def words(self):
        return self.files.words + (self.inside.words if self.inside else [])

    @property
    def first(self):
        """Facts of the first table."""
        return self.tables[0]

    @property
    def place(self):
        """How messages name it."""
        return self.files.pattern + (f" [{self.inside.pattern}]" if self.inside else "")

    def field_of(self, role):
        """The `NameField` with a role, or `None`."""
        return next((item for item in self.fields if item.role == role), None)

    @property
    def rate(self):
        """Hz and where it is known from: `tuple[float | None, str]`; the name of the file is asked last."""
        if self.first.rate is not None:
            return self.first.rate, self.first.rate_from
        rates = {float(number) * (1000 if kilo else 1) for number, kilo in _HERTZ.findall(self.files.pattern)}
        return (rates.pop(), "the name of the file") if len(rates) == 1 else (None, "")

    @property
    def seconds(self):
        """Length of the first table, s; `None` if that is unknown."""
        rate, _ = self.rate
        return self.first.table.rows / rate if rate and self.first.complete else None


def open_groups(root, sizes, skipped, quiet):
    """Groups files by their names, and opens a few of each kind.

    Args:
        root (`Path`): the folder.
        sizes (`dict[str, int]`): relative path -> bytes.
        skipped (`dict[str, str]`): path -> reason; files that cannot be read are added.
        quiet (`bool`): no progress bar.

    Returns:
        `list[TableGroup]`: without channels.
    """
    groups, waiting, opened = [], group_names(list(sizes)), {}
    bar = tqdm(desc="looking at files", unit="file", disable=quiet)
    while waiting:
        names = waiting.pop(0)
        kind = kind_of(names.names[0])
        found = []
        for path in _few(names.names):
            if path not in opened and len(opened) < MOST_OPENED:
                opened[path] = _open(root, path, kind, sizes[path], names.words, skipped)
                bar.update()
            if opened.get(path):
                found.append(opened[path])
        varying = _that_tells_apart(names, found)
        if varying is not None:
            waiting = names.split(varying) + waiting
            continue
        size = sum(sizes[name] for name in names.names)
        groups += _tables(names, kind, size, found) or [TableGroup(names, kind, size)]
    bar.close()
    return groups


def _few(names):
    """First, middle and last of a list."""
    return list(dict.fromkeys(names[i * (len(names) - 1) // (FILES_OPENED - 1)] for i in range(FILES_OPENED)))


def _open(root, path, kind, size, words, skipped):
    """Tables of a file that were looked at: place inside -> `TableFacts`; {} if it cannot be read."""
    if kind in READ_WHOLE and size > LARGEST_OPENED:
        skipped[path] = f"{size / 1e6:.0f} MB of a kind that is read as a whole: not opened"
        return {}
    head_only = kind in ("csv", "xlsx")
    try:
        if kind == "hdf5" and _is_ours(Path(root, path)):
            skipped[path] = "a file of this package, already converted"
            return {}
        tables = list_tables(Path(root, path), kind, max_rows=HEAD_ROWS)
        inside = group_names([table.inside or "" for table in tables])
        firsts = {places.names[0]: places.words for places in inside}
        facts = {}
        for table in tables:
            place = table.inside or ""
            known = place in firsts and table.names and table.rows
            facts[place] = describe_table(table, words + firsts[place], head_only) if known else TableFacts(table)
        return facts
    except Exception as error:  # readers of ten formats, and files of anyone: the other files are to be listed
        kind_of_error = "" if isinstance(error, ValueError) else f"{type(error).__name__}: "
        skipped[path] = kind_of_error + str(error).replace(f"{root}/", "")
        return {}


def _is_ours(path):
    return str(open_tree(path, "hdf5").attributes.get("format", "")).startswith(OUR_FORMATS)


def _that_tells_apart(names, found):
    """A field by whose values files with other columns differ, or `None`."""
    shapes = {frozenset(tuple(facts.table.names) for facts in tables.values()) for tables in found}
    words = [item for item in names.fields if 1 < len(set(item.bare)) <= MOST_SPLIT and not item.bare[0].isdigit()]
    return min(words, key=lambda item: len(set(item.bare))) if len(shapes) > 1 and words else None


def _tables(names, kind, size, found):
    """One `TableGroup` for each kind of place inside the files."""
    if not found:
        return []
    groups, only_sheet = [], kind == "xlsx" and len(found[0]) == 1
    for places in group_names(list(found[0])):
        first = places.names[0]
        tables = [tables[first] for tables in found if tables.get(first) and tables[first].columns]
        if tables:
            files = replace(names, items=[replace(i) if isinstance(i, NameField) else i for i in names.items])
            groups.append(TableGroup(files, kind, size, places if first and not only_sheet else None, tables))
    return groups

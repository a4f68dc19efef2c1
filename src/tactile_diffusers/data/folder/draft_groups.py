"""The tables of a folder in groups of one kind, a few files of each opened."""

import os
import re
from collections import Counter
from copy import copy
from dataclasses import dataclass, field, replace

from tqdm import tqdm

from .draft_columns import HEAD_ROWS, Column, TableFacts, describe_table
from .draft_names import NameGroup, group_names
from .sources import files_below
from .tables import kind_of, list_tables
from .trees import open_tree

#: No more files than this are listed: enough to see how they are named.
MOST_FILES = 5000
#: Nor more of one folder, so that one sensor's files do not hide another's.
MOST_IN_FOLDER = 1000
#: Text files that are no tables.
TEXT_NAMES = ("readme", "license", "licence", "changelog", "requirements")
#: Files that are opened in all; of each kind the first, the one in the middle and the last.
MOST_OPENED = 90
#: Files of kinds that are read as a whole are opened up to this size (bytes).
LARGEST_OPENED = 500_000_000
READ_WHOLE = ("mat", "npz", "parquet", "xlsx")
#: Names that may turn out to be of several kinds, such as "forces.csv" beside "subjects.csv".
MOST_SPLIT = 6
_HERTZ = re.compile(r"(\d+(?:\.\d+)?)[ _]?(k?)Hz", re.IGNORECASE)


@dataclass
class FileList:
    """Files of a folder: those that can be read, `others`, and those `skipped` with the reason.

    Paths are relative and written with "/". `truncated` = there are more files.
    """

    files: list = field(default_factory=list)
    others: list = field(default_factory=list)
    skipped: dict = field(default_factory=dict)
    truncated: bool = False


@dataclass
class TableGroup:
    """Tables of one kind.

    `files` are the names of the files, `inside` those of places or sheets in a file (`None` = a file is one table),
    `tables` the facts of those that were opened, `channels` "force", "lateral", "position", "velocity" -> axis ->
    column, and `doubts` what was only guessed, or looks wrong.
    """

    files: NameGroup
    kind: str
    inside: NameGroup | None = None
    tables: list[TableFacts] = field(default_factory=list)
    channels: dict[str, dict[str, Column]] = field(default_factory=dict)
    doubts: list[str] = field(default_factory=list)

    @property
    def fields(self):
        """Fields of the names of the files, then of the places inside."""
        return self.files.fields + (self.inside.fields if self.inside else [])

    @property
    def first(self):
        """Facts of the first table."""
        return self.tables[0]

    @property
    def place(self):
        """Its name in messages."""
        return self.files.pattern + (f" [{self.inside.pattern}]" if self.inside else "")

    @property
    def surfaces(self):
        """Names of the surfaces: `list[str]`, each once."""
        surface = self.field_of("surface")
        return surface.distinct if surface is not None else []

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


def list_files(root):
    """Lists the files of a folder and all below it that are not hidden, without following links: `FileList`.

    Raises:
        FileNotFoundError: if there is no folder.
    """
    found, listed = FileList(), Counter()
    for path in files_below(root):
        folder, _, name = path.rpartition("/")
        if listed.total() >= MOST_FILES or listed[folder] >= MOST_IN_FOLDER:
            found.truncated = True
            continue
        listed[folder] += 1
        if (readable := path.encode(errors="replace").decode()) != path:
            found.skipped[readable] = "its name is not valid UTF-8"
        elif kind_of(name) is None or name.lower().startswith(TEXT_NAMES):
            found.others.append(path)
        elif not os.access(root / path, os.R_OK):
            found.skipped[path] = "may not be read, or is a broken link"
        elif not (root / path).stat().st_size:
            found.skipped[path] = "empty"
        else:
            found.files.append(path)
    return found


def open_groups(root, files, quiet):
    """Groups the files of a `FileList` by their names, and opens a few of each kind: `list[TableGroup]`.

    Files that cannot be read are added to those that are skipped, with the reason.
    """
    groups, waiting, opened = [], group_names(files.files), {}
    bar = tqdm(desc="looking at files", unit="file", disable=quiet)
    while waiting:
        names = waiting.pop(0)
        count = len(names.names)
        for path in {names.names[0]: 0, names.names[(count - 1) // 2]: 0, names.names[-1]: 0}:
            if path not in opened and len(opened) < MOST_OPENED:
                opened[path] = _open(root, path, names.words, files.skipped)
                bar.update()
        found = [opened[path] for path in names.names if opened.get(path)]
        varying = _varying_kind(names, found)
        if varying is not None:
            waiting = names.by_value(varying) + waiting
        else:
            groups += _groups_inside(names, found)
    bar.close()
    return groups


def _open(root, path, words, skipped):
    """Tables of a file that were looked at: place inside -> `TableFacts`; {} if it cannot be read."""
    kind, size = kind_of(path), (root / path).stat().st_size
    if kind in READ_WHOLE and size > LARGEST_OPENED:
        skipped[path] = f"{size / 1e6:.0f} MB of a kind that is read as a whole: not opened"
        return {}
    try:
        if kind == "hdf5" and str(open_tree(root / path, kind).attributes.get("format", "")).startswith("tactile-"):
            skipped[path] = "a file of this package, already converted"
            return {}
        tables = list_tables(root / path, kind, max_rows=HEAD_ROWS)
        firsts = {places.names[0]: places.words for places in group_names([table.inside or "" for table in tables])}
        facts = {}
        for table in tables:
            place = table.inside or ""
            looked_at = place in firsts and table.names and table.rows
            more = (words + firsts[place], kind in ("csv", "xlsx")) if looked_at else ()
            facts[place] = describe_table(table, *more) if looked_at else TableFacts(table)
        return facts
    except Exception as error:  # readers of ten formats, and files of anyone: the other files are to be listed
        kind_of_error = "" if isinstance(error, ValueError) else f"{type(error).__name__}: "
        skipped[path] = kind_of_error + str(error).replace(f"{root}/", "")
        return {}


def _varying_kind(names, found):
    """A field by whose values files with other columns differ, or `None`."""
    shapes = {frozenset(tuple(facts.table.names) for facts in tables.values()) for tables in found}
    words = [i for i in names.fields if 1 < len(set(i.values)) <= MOST_SPLIT and not i.values[0].isdigit()]
    return min(words, key=lambda item: len(set(item.values))) if len(shapes) > 1 and words else None


def _groups_inside(names, found):
    """One `TableGroup` for each kind of place inside the files; one without tables if none was opened."""
    groups, kind = [], kind_of(names.names[0])
    for places in group_names(list(found[0])) if found else ():
        first = places.names[0]
        tables = [tables[first] for tables in found if tables.get(first) and tables[first].columns]
        if tables:
            files = replace(names, items=list(map(copy, names.items)))
            is_whole = not first or (kind == "xlsx" and len(found[0]) == 1)
            groups.append(TableGroup(files, kind, None if is_whole else places, tables))
    return groups or [TableGroup(names, kind)]

"""What a few tables of each kind in a folder look like: units, ranges, rates, and what each column probably measures.

Everything here is a guess from names and numbers (recipe), and is reported as one.
"""

import os
import re
from collections import defaultdict
from copy import copy
from dataclasses import dataclass, field, replace

import numpy as np
from tqdm import tqdm

from .clocks import MOST_DUPLICATES
from .draft_names import NameField, NameGroup, content_of, group_names, words_of
from .layout import LENGTH_UNITS, TIME_UNITS
from .sources import files_below
from .tables import Table, kind_of, list_tables, paths_inside
from .trees import open_tree

#: Units as people write them in names of columns -> ours; units that a layout cannot use are shown as they are.
UNITS = {unit: unit for unit in "N mN gf s ms us mm cm m um mm/s cm/s m/s Nm Nmm V mV g deg rad Hz".split()} | {
    **{"newton": "N", "newtons": "N", "gram": "gf", "grams": "gf", "counts": "1", "raw": "1", "a.u.": "1"},
    **{"sec": "s", "seconds": "s", "msec": "ms", "usec": "us", "µs": "us", "μs": "us", "µm": "um", "μm": "um"},
    **{"mm_s": "mm/s", "mmps": "mm/s", "cm_s": "cm/s", "m_s": "m/s", "m_s2": "m/s2", "m/s^2": "m/s2", "m/s2": "m/s2"},
}
_LOWER_UNITS = {name.lower(): unit for name, unit in UNITS.items()}
_UNIT_AT_END = re.compile(
    rf"(.+?)(?:\s*[/,]\s*|\s+in\s+|[_\s-]+)({'|'.join(map(re.escape, sorted(UNITS, key=len, reverse=True)))})",
    re.IGNORECASE,
)
#: What a column measures, by its name in lower case without unit, letters and digits only; the first that fits. The
#: group `axis` is a letter or a number, `last` likewise behind the word.
_AXIS = r"(?P<axis>[xyz])"
_LAST = r"(?P<last>[xyz]|\d+)"
NAMES = {
    "time": r"t|time|times|timestamps?|elapsed(time)?|seconds?|secs?|clock",
    "counter": r"index|idx|i|samples?|samplenumber|frames?|counter|no|nr|number|row|unnamed\d*",
    "normal": r"fn|fnormal|normal|normalforce|forcenormal|normalload",
    "lateral": r"f[tl]|ftan|flat|fric|(lateral|tangential|friction|frictional|shear)(force)?",
    "force": rf"(f|force|forces|contactforce|load){_LAST}?|{_AXIS}(force|load)",
    "torque": rf"(m|t|tau|torque|torques|moment)(?P<last>[xyz])|{_AXIS}(torque|moment)|torques?\d?",
    "acceleration": rf"(a|acc|accel|acceleration){_LAST}?|{_AXIS}(acc|accel|acceleration)",
    "velocity": rf"(v|vel|velocity|velocities|speed){_LAST}?|{_AXIS}(vel|velocity|speed)",
    "position": rf"(p|pos|position|positions|coord|stage|displacement){_LAST}?|{_AXIS}(pos|position|coord)",
    "bare": rf"(ch|channel|col|column|var|data|values?)?{_LAST}",
}
#: Text files that are no tables.
TEXT_NAMES = ("readme", "license", "licence", "changelog", "requirements")
#: Files that are opened in all; of each kind the first, the one in the middle and the last.
MOST_OPENED = 90
#: Files of kinds that are read as a whole are opened up to this size (bytes).
LARGEST_OPENED = 500_000_000
READ_WHOLE = ("mat", "npz", "parquet", "xlsx")
#: Rows of a text table and columns of any table that are looked at; arrays with more rows are not read.
HEAD_ROWS, MOST_COLUMNS, MOST_ROWS = 50_000, 200, 20_000_000
#: Names that may turn out to be of several kinds, such as "forces.csv" beside "subjects.csv".
MOST_SPLIT = 6
#: Rates (Hz) between which time stamps without a unit must lie.
LIKELY_RATES = (20.0, 60_000.0)
#: Up to this share the mean step of stamps may differ from the median by rounding.
ROUNDED = 0.2
_HERTZ = re.compile(r"(\d+(?:\.\d+)?)[ _]?(k?)Hz", re.IGNORECASE)


@dataclass
class Column:
    """One column: its name, the unit in it, what it measures along which axis, and its values.

    `measures` is a key of `NAMES`, "ratings", "sound", "text" or "number". `low`, `high` and `mean` are NaN for text;
    `missing` counts empty cells, `distinct` different texts, and `whole` says whether all are whole numbers.
    """

    name: str
    unit: str | None = None
    measures: str = "number"
    axis: str = ""
    low: float = np.nan
    high: float = np.nan
    mean: float = np.nan
    missing: int = 0
    distinct: int = 0
    whole: bool = False


@dataclass
class TableFacts:
    """One table: its columns (no more than `MOST_COLUMNS`), its rate in Hz and where that is known from.

    `complete` = all rows were read; `stamps_coarse` = too many of the time stamps are repeated;
    `time_unit` of the stamps, `None` = unknown; `doubts` = what was only guessed.
    """

    table: Table
    columns: list = field(default_factory=list)
    complete: bool = True
    rate: float | None = None
    rate_from: str = ""
    stamps_coarse: bool = False
    time_unit: str | None = None
    doubts: list = field(default_factory=list)

    def measuring(self, measures):
        """The columns that measure something, by axis; the first of several."""
        return {column.axis: column for column in reversed(self.columns) if column.measures == measures}


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


def list_files(root):
    """Files of a folder that may be tables, other files, and skipped files with the reason.

    Raises:
        FileNotFoundError: if there is no folder.
    """
    files, others, skipped = [], [], {}
    for path in files_below(root):
        name = path.rpartition("/")[2]
        if (readable := path.encode(errors="replace").decode()) != path:
            skipped[readable] = "its name is not valid UTF-8"
        elif kind_of(name) is None or name.lower().startswith(TEXT_NAMES):
            others.append(path)
        elif not os.access(root / path, os.R_OK):
            skipped[path] = "may not be read, or is a broken link"
        elif not (root / path).stat().st_size:
            skipped[path] = "empty"
        else:
            files.append(path)
    return files, others, skipped


def open_groups(root, files, skipped, quiet):
    """Groups files by their names, and opens a few of each kind: `list[TableGroup]`.

    Files that cannot be read are added to those that are `skipped`, with the reason.
    """
    groups, waiting, opened = [], group_names(files), {}
    with tqdm(desc="looking at files", unit="file", disable=quiet) as bar:
        while waiting:
            names = waiting.pop(0)
            for path in (names.names[0], names.names[(len(names.names) - 1) // 2], names.names[-1]):
                if path not in opened and len(opened) < MOST_OPENED:
                    opened[path] = _open(root, path, names.words, skipped)
                    bar.update()
            found = [opened[path] for path in names.names if opened.get(path)]
            varying = _varying_kind(names, found)
            if varying is not None:
                waiting = names.by_value(varying) + waiting
            else:
                groups += _groups_inside(names, found)
    return groups


def _open(root, path, words, skipped):
    """Tables of a file that were looked at: place inside -> `TableFacts`; {} if it cannot be read."""
    kind, size, facts = kind_of(path), (root / path).stat().st_size, {}
    if kind in READ_WHOLE and size > LARGEST_OPENED:
        skipped[path] = f"{size / 1e6:.0f} MB of a kind that is read as a whole: not opened"
        return {}
    try:
        if kind == "hdf5" and str(open_tree(root / path, kind).attributes.get("format", "")).startswith("tactile-"):
            skipped[path] = "a file of this package, already converted"
            return {}
        tables = {table.inside or "": table for table in list_tables(root / path, kind, max_rows=HEAD_ROWS)}
        firsts = {places.names[0]: places.words for places in _places(tables, kind)}
        for place, table in tables.items():  # of places of one kind the first is enough
            is_read = place in firsts and table.names and table.rows
            facts[place] = describe_table(table, words + firsts[place]) if is_read else TableFacts(table)
        return facts
    except Exception as error:  # readers of ten formats, and files of anyone: the other files are to be listed
        kind_of_error = "" if isinstance(error, ValueError) else f"{type(error).__name__}: "
        skipped[path] = kind_of_error + str(error).replace(f"{root}/", "")
        return {}


def _varying_kind(names, found):
    """A field by whose values files with other columns differ, or `None`."""
    shapes = {frozenset(tuple(facts.table.names) for facts in tables.values()) for tables in found}
    beginning = NameField([re.split("[ _-]", name.rpartition("/")[2])[0] for name in names.names])
    fields = (names.fields, [beginning])  # "Kraft_Glas_Anna.csv" beside "Weg_Glas_Anna.csv"
    words = [[i for i in f if 1 < len(set(i.values)) <= MOST_SPLIT and not i.values[0].isdigit()] for f in fields]
    words = words[0] or words[1]
    return min(words, key=lambda item: len(set(item.values))) if len(shapes) > 1 and words else None


def _groups_inside(names, found):
    """One `TableGroup` for each kind of place inside the files; one without tables if none was opened."""
    groups, kind = [], kind_of(names.names[0])
    for places in _places({place: facts.table for place, facts in found[0].items()}, kind) if found else ():
        first = places.names[0]
        tables = [tables[first] for tables in found if first in tables and tables[first].columns]
        if tables:
            files = replace(names, items=list(map(copy, names.items)))
            is_whole = not first or (kind == "xlsx" and len(paths_inside(tables[0].table.path, kind)) == 1)
            groups.append(TableGroup(files, kind, None if is_whole else places, tables))
    return groups or [TableGroup(names, kind)]


def _places(tables, kind):
    """Groups of places inside a file of one kind of name; of sheets also with one name of the first column."""
    alike = defaultdict(list)
    for place, table in tables.items():
        alike[kind == "xlsx" and tuple(table.names[:1])].append(place)
    return [group for places in alike.values() for group in group_names(places)]


def split_unit(name):
    """The unit in the name of a column: `tuple[str, str | None]`, name without it and unit as in `UNITS`."""
    if name.lower() in ("f_n", "f_t"):  # normal and tangential
        return name, None
    found = re.fullmatch(r"(.*?)[\s_]*[\[(<]\s*([^\])>]+?)\s*[\])>]\s*", name) or _UNIT_AT_END.fullmatch(name)
    if not found:
        return name, None
    base, unit = found.groups()
    return base, UNITS.get(unit) or _LOWER_UNITS.get(unit.lower(), unit)  # names are often in lower case


def describe_table(table, words=()):
    """Looks at the columns of a table: `TableFacts`; `words` of the name of its file say what "x" measures."""
    cut_off = table.first_line is not None and table.rows == HEAD_ROWS
    facts = TableFacts(table, complete=not cut_off)
    for name in table.names[:MOST_COLUMNS]:
        base, unit = split_unit(name)
        column = Column(name, unit, *_measured(base))
        if table.rows <= MOST_ROWS:
            _look_at_values(column, table)
        facts.columns.append(column)
    _name_bare(facts, content_of(words))
    _look_at_time(facts)
    if table.rate is not None:
        facts.rate, facts.rate_from = table.rate, "the file"
    return facts


def _measured(base):
    """What a column measures by its name, and along which axis."""
    compact = re.sub(r"[^a-z0-9]", "", base.lower())
    for measures, regex in NAMES.items():
        if found := re.fullmatch(regex, compact):
            groups = found.groupdict()
            axis = groups.get("axis") or groups.get("last") or ""
            return ("force", "z") if measures == "normal" else (measures, axis)
    return content_of(words_of(base)) or "number", ""


def _look_at_values(column, table):
    try:
        values = table.numbers(column.name)
    except ValueError:
        texts = [text for text in table.text(column.name) if text]
        column.measures, column.distinct, column.missing = "text", len(set(texts)), table.rows - len(texts)
        return
    known = values[~np.isnan(values)]
    column.missing = len(values) - len(known)
    if len(known):
        column.low, column.high, column.mean = known.min() + 0.0, known.max() + 0.0, known.mean() + 0.0  # -0 is 0
        column.whole = bool(np.all(known[:HEAD_ROWS] == np.round(known[:HEAD_ROWS])))


def _name_bare(facts, content):
    """Columns that have only a letter or a number measure what the name of the file says; numbers become axes."""
    bare = [column for column in facts.columns if column.measures == "bare"]
    if len(bare) > 1 and all(column.axis.isdigit() for column in facts.columns) and _is_clock(facts.table, bare[0]):
        bare[0].measures, bare[0].axis = "time", ""
        facts.doubts.append(f"column {bare.pop(0).name} taken as time: it rises steadily")
    known = content not in (None, "ratings", "sound")
    for column in [column for column in bare if column.unit in LENGTH_UNITS and column.axis in "xy"]:
        bare.remove(column)
        column.measures = "position"
    for column in bare:
        column.measures = content if known else "number"
    if bare and known:
        names = ", ".join(column.name for column in bare)
        facts.doubts.append(f"columns {names} taken as {content}: the name of the file or table says so")
    for measures in {column.measures for column in facts.columns}:
        numbered = [column for column in facts.columns if column.measures == measures and column.axis.isdigit()]
        for position, column in enumerate(sorted(numbered, key=lambda column: int(column.axis))):
            column.axis = "xyz"[position : position + 1]
            column.measures = measures if column.axis or measures != "force" else "torque"


def _is_clock(table, column):
    steps = np.diff(table.numbers(column.name)[:HEAD_ROWS])
    return len(steps) > 1 and bool((steps > 0).all() and np.quantile(steps, 0.9) < 3 * np.median(steps))


def _time_by_unit(facts):
    """The first column if it has a unit of time and rises steadily, whatever it is called; or `None`."""
    first = facts.columns[0] if facts.columns else None
    if first is None or first.unit not in TIME_UNITS or first.measures == "text" or not _is_clock(facts.table, first):
        return None
    first.measures, first.axis = "time", ""
    return first


def _look_at_time(facts):
    """Sets the unit of the time stamps and the rate."""
    column = facts.measuring("time").get("") or _time_by_unit(facts)
    if column is None or not column.high > column.low:
        return
    stamps = facts.table.numbers(column.name)
    steps = np.diff(stamps[~np.isnan(stamps)])
    facts.stamps_coarse = bool((steps == 0).mean() > MOST_DUPLICATES)
    period, mean = float(np.median(steps)), float(np.mean(steps))
    if abs(mean - period) < ROUNDED * period:  # stamps that are rounded to a few digits
        period = mean
    if facts.stamps_coarse:  # counted from the first new stamp to the last
        first, *_, last = np.flatnonzero(steps) if np.count_nonzero(steps) > 1 else (-1, len(steps) - 1)
        period = float(steps[first + 1 : last + 1].sum() / (last - first))
    low, high = LIKELY_RATES
    units = [unit for unit, scale in TIME_UNITS.items() if period > 0 and low <= 1 / (period * scale) <= high]
    facts.time_unit = column.unit if column.unit in TIME_UNITS else None
    if facts.time_unit is None and len(units) == 1:
        facts.time_unit = units[0]
        facts.doubts.append(f"time taken as {units[0]}: a step of {period:g} would otherwise be an unlikely rate")
    if facts.time_unit is not None and period > 0:
        facts.rate, facts.rate_from = 1 / (period * TIME_UNITS[facts.time_unit]), f"column {column.name!r}"

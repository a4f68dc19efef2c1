"""What the columns of a table look like: units in names, ranges, rates, and what each probably measures.

Everything here is a guess from names and numbers (recipe), and is reported as one.
"""

import re
from dataclasses import dataclass, field

import numpy as np

from .draft_names import content_of, words_of
from .layout import TIME_UNITS
from .tables import Table

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
#: Rows of a text table that are looked at.
HEAD_ROWS = 50_000
#: Arrays with more rows are not read.
MOST_ROWS = 20_000_000
#: Columns of a table that are looked at.
MOST_COLUMNS = 200
#: Rates (Hz) between which time stamps without a unit must lie.
LIKELY_RATES = (20.0, 60_000.0)
#: Time stamps with a larger share of repeated ones are coarser than the samples.
MOST_REPEATED = 0.1


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

    `complete` = all rows were read; `stamps_coarse` = more than `MOST_REPEATED` of the time stamps are repeated;
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


def split_unit(name):
    """The unit in the name of a column: `tuple[str, str | None]`, name without it and unit as in `UNITS`."""
    if name.lower() in ("f_n", "f_t"):  # normal and tangential
        return name, None
    found = re.fullmatch(r"(.*?)[\s_]*[\[(<]\s*([^\])>]+?)\s*[\])>]\s*", name) or _UNIT_AT_END.fullmatch(name)
    if not found:
        return name, None
    base, unit = found.groups()
    return base, UNITS.get(unit) or _LOWER_UNITS.get(unit.lower(), unit)  # names are often in lower case


def describe_table(table, words=(), head_only=False):
    """Looks at the columns of a table: `TableFacts`.

    `words` of the name of its file say what "x" measures; with `head_only` there may be more than `HEAD_ROWS` rows.
    """
    facts = TableFacts(table, complete=not (head_only and table.rows >= HEAD_ROWS))
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


def _look_at_time(facts):
    """Sets the unit of the time stamps and the rate."""
    column = facts.measuring("time").get("")
    if column is None or not column.high > column.low:
        return
    stamps = facts.table.numbers(column.name)
    steps = np.diff(stamps[~np.isnan(stamps)])
    facts.stamps_coarse = bool((steps == 0).mean() > MOST_REPEATED)
    period = float(np.median(steps))
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

"""Files of other people as tables of named columns: csv, xlsx, mat, hdf5, npy, npz, wav, parquet.

A layout says which column is what; nothing is guessed here. Pickles are never read.
"""

import codecs
import csv
import difflib
import re
import unicodedata
from collections import Counter
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path

import numpy as np
import pandas as pd

from ...io.reading import check_archive, check_size, check_wav, open_parquet, reading
from .trees import Tree, open_tree

#: Kind of a file by its extension (lower case).
KINDS = dict.fromkeys((".csv", ".tsv", ".txt", ".dat"), "csv") | dict.fromkeys((".xlsx", ".xlsm"), "xlsx")
KINDS |= dict.fromkeys((".h5", ".hdf5", ".hdf"), "hdf5")
KINDS |= {".mat": "mat", ".npy": "npy", ".npz": "npz", ".wav": "wav", ".parquet": "parquet"}
#: Kinds whose files hold a tree of arrays, in which `inside` names one place.
TREE_KINDS = ("mat", "hdf5", "npz")
#: Cells of a column of numbers that are empty rather than unreadable.
EMPTY = ("", "nan", "NaN", "NA")
#: Delimiters that are tried, the likeliest first; " " stands for any white space.
DELIMITERS = ("\t", ";", "|", ",", " ")
#: Rows in which the delimiter and the names are looked for.
HEAD_ROWS = 60
#: A number, also with a decimal comma, or what stands for a missing one.
_NUMBER = re.compile(r"[+-]?(\d+[.,]?\d*|[.,]\d+)(e[+-]?\d+)?|-?nan|-?inf|na|n/a|null|none|", re.IGNORECASE)
_REMEDY = "Check that it is whole, and what its layout says about it."


@dataclass
class Table:
    """Columns of numbers or text; those that are not in memory are read when they are needed.

    `inside` is the sheet, or the place of the group, struct or array; `names` are "0", "1", .. where there are none;
    `rate` is in Hz, where the file itself states one; `rows` is the length of the longest column; `first_line` is the
    line of the first row in a text file, from 1. `load` gives a column by name, `load_text` exactly as written.
    `unreadable` counts the cells that are no finite number in columns that `numbers` has read.
    """

    path: Path
    inside: str | None
    names: list[str]
    rate: float | None
    rows: int
    first_line: int | None = None
    load: object = field(default=None, repr=False)
    load_text: object = field(default=None, repr=False)
    unreadable: Counter = field(default_factory=Counter)

    @property
    def where(self):
        """The place of this table for messages."""
        return str(self.path) if self.inside is None else f"{self.path} [{self.inside}]"

    def place(self, row):
        """Place of row `row` (from 0) for messages: a line of a text file, otherwise a sample (from 0)."""
        return f"sample {row}" if self.first_line is None else f"line {self.first_line + row}"

    def name(self, column):
        """Name of a column given by name or by index from 0, or a `ValueError` that lists the columns."""
        if isinstance(column, int) and 0 <= column < len(self.names):
            return self.names[column]
        if isinstance(column, str) and column in self.names:
            return column
        lower = {name.casefold(): name for name in self.names}
        near = difflib.get_close_matches(str(column).casefold(), lower, n=1)
        hint = f" Did you mean {lower[near[0]]!r}?" if near else ""
        raise ValueError(f"{self.where} has no column {column!r}; it has {few(self.names, 12) or 'none'}.{hint}")

    def numbers(self, column):
        """A column, by name or index, as (rows,) float64; NaN = empty or no number.

        Raises:
            ValueError: if there is no such column, or it holds text only.
        """
        name = self.name(column)
        with reading(self.path, "a whole table", _REMEDY):
            values = np.asarray(self.load(name))
        if values.dtype.kind in "fiub":
            numbers = values.astype(np.float64)
            odd = np.isinf(numbers)
        else:
            text = np.array([_as_text(value) for value in values], dtype=object)
            numbers = pd.to_numeric(pd.Series(text), errors="coerce").to_numpy(dtype=np.float64, copy=True)
            odd = ~np.isfinite(numbers) & ~np.isin(text, EMPTY)
            if odd.any() and np.isnan(numbers).all():
                example = text[np.argmax(odd)]
                raise ValueError(f"{self.where}: column {name!r} holds no number but, for example, {example!r}.")
        numbers[odd] = np.nan
        self.unreadable[name] = int(odd.sum())
        return numbers

    def text(self, column):
        """A column as it is written: (rows,) list of `str` in NFC, without spaces around them, "" = empty."""
        name = self.name(column)
        with reading(self.path, "a whole table", _REMEDY):
            values = (self.load_text or self.load)(name)
        return [unicodedata.normalize("NFC", _as_text(value)) for value in values]


def few(names, most=8):
    """The first of several names for a message, and how many more there are."""
    names = [repr(name) for name in names]
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def kind_of(path):
    """Kind of a file by its extension, or `None`."""
    return KINDS.get(Path(path).suffix.lower())


def read_table(path, kind=None, *, inside=None, delimiter=None, header=None, max_rows=None):
    """Opens one table of a file.

    Args:
        path (`str` or `Path`): the file.
        kind (`str`, *optional*): one of the values of `KINDS`; default: by the extension.
        inside (`str`, *optional*): mat, hdf5, npz: the group, struct or array, "a/b"; default: the top. xlsx: the
            sheet; default: the first.
        delimiter (`str`, *optional*): csv; " " = any white space; default: found out.
        header (`int`, *optional*): csv, xlsx: lines before the data; the names are in the last one that has as many
            different names as there are columns; 0 = no names; default: found out.
        max_rows (`int`, *optional*): csv, xlsx: read no more rows than that, to look at the columns only.

    Returns:
        `Table`. Of 2-D arrays the longer axis is time.

    Raises:
        FileNotFoundError: if there is no file.
        ValueError: naming the file and the remedy, if it cannot be read as this kind.
    """
    path = Path(path)
    kind = kind or kind_of(path)
    if kind not in KINDS.values():
        known = ", ".join(sorted(set(KINDS.values())))
        raise ValueError(f"{path}: its kind is unknown ({kind!r}). Give `kind`, one of {known}.")
    if not path.is_file():
        raise FileNotFoundError(f"There is no file {path}.")
    with reading(path, kind, _REMEDY):
        if kind == "csv":
            return _read_csv(path, delimiter, header, max_rows)
        if kind == "xlsx":
            return _read_xlsx(path, inside, header, max_rows)
        if kind in TREE_KINDS:
            return _tree_table(path, open_tree(path, kind), (inside or "").strip("/"))
        return {"npy": _read_npy, "wav": _read_wav, "parquet": _read_parquet}[kind](path)


def list_tables(path, kind=None, **options):
    """All tables of a file: the sheets of an xlsx, the groups and arrays of a mat, hdf5 or npz, otherwise one.

    Takes the options of `read_table`, and raises the same.
    """
    path, kind, inside = Path(path), kind or kind_of(path), [None]
    if kind == "xlsx" and path.is_file():
        inside = paths_inside(path, kind)
    elif kind in TREE_KINDS:
        with reading(path, kind, _REMEDY):
            inside = open_tree(path, kind).tables
    return [read_table(path, kind, inside=place, **options) for place in inside]


def paths_inside(path, kind=None):
    """Places inside a file: all groups, structs and arrays of a mat, hdf5 or npz ("" = the top), or sheets."""
    path, kind = Path(path), kind or kind_of(path)
    with reading(path, kind, _REMEDY):
        if kind != "xlsx":
            return list(open_tree(path, kind).columns)
        check_archive(path)
        with pd.ExcelFile(path, engine="openpyxl") as book:
            return [str(name) for name in book.sheet_names]


def _read_csv(path, delimiter, header, max_rows):
    separator, encoding, header, names = _text_format(path, delimiter, header)
    if not names:
        return Table(path, None, [], None, 0, first_line=1)
    common = dict(sep=separator, header=None, skiprows=header, encoding=encoding, nrows=max_rows, skipinitialspace=True)
    try:
        frame = pd.read_csv(path, names=names, low_memory=False, **common)
    except pd.errors.EmptyDataError:  # names without any row
        frame = pd.DataFrame(columns=names, dtype=np.float64)
    if not isinstance(frame.index, pd.RangeIndex):
        raise ValueError(
            f"{path}, line {header + 1}: has more than the {len(names)} columns of the other lines. Correct it, or "
            "give `header`, the lines before the data."
        )

    def load(name):  # the first decimal comma may stand behind many whole numbers
        column = frame[name]
        words = column.dtype.kind not in "fiub" and separator != ","
        return (column.str.replace(",", ".", regex=False) if words else column).to_numpy()

    def load_text(name):  # read again: the numbers 1 and 01 are the same, the names are not
        column = names.index(name)
        again = pd.read_csv(path, usecols=[column], dtype=str, keep_default_na=False, **common)
        return again.iloc[:, 0].to_numpy(dtype=object)

    return Table(path, None, names, None, len(frame), header + 1, load, load_text)


def _read_xlsx(path, sheet, header, max_rows):
    sheets = paths_inside(path, "xlsx")
    sheet = sheets[0] if sheet is None else sheet
    if sheet not in sheets:
        raise ValueError(f"{path}: there is no sheet {sheet!r}, only {few(sheets, 12)}")
    rows = None if max_rows is None else max_rows + HEAD_ROWS
    options = dict(header=None, dtype=object, nrows=rows, keep_default_na=False, na_values=[""], engine="openpyxl")
    cells = pd.read_excel(path, sheet_name=sheet, **options)
    head = [[_as_text(value) for value in row] for row in cells.head(HEAD_ROWS).itertuples(index=False)]
    lines, names = _find_header(head, header)
    frame = cells.iloc[lines:].set_axis(names, axis=1)
    return _frame_table(path, sheet, frame if max_rows is None else frame.head(max_rows), lines + 1)


def _read_parquet(path):
    with open_parquet(path) as file:
        frame = file.read().to_pandas()
    frame.columns = [str(name) for name in frame.columns]
    return _frame_table(path, None, frame, None)


def _frame_table(path, inside, frame, first_line):
    return Table(path, inside, list(frame), None, len(frame), first_line, lambda name: frame[name].to_numpy())


def _read_npy(path):
    array = np.load(path, mmap_mode="r", allow_pickle=False)
    if not isinstance(array, np.ndarray):
        raise ValueError("it is an archive, npz")
    return _tree_table(path, Tree({"": array}), "")


def _read_wav(path):
    import soundfile

    with path.open("rb") as file:
        check_wav(file)
    info = soundfile.info(path)
    check_size(path, 8 * info.frames * info.channels)

    def load(name):
        return soundfile.read(path, dtype="float64", always_2d=True)[0][:, int(name)]

    names = [str(channel) for channel in range(info.channels)]
    return Table(path, None, names, float(info.samplerate), info.frames, load=load)


def _tree_table(path, tree, inside):
    columns = tree.columns.get(inside)
    if columns is None:
        names = list(tree.columns)[1:]
        near = difflib.get_close_matches(inside, names, n=3) or names
        raise ValueError(f"{path} has no group, struct or array {inside!r}; it has {few(near, 12) or 'none'}.")

    def load(name):
        length, read = columns[name]
        check_size(path, 8 * length)
        return np.array(read())

    rows = max((length for length, _ in columns.values()), default=0)
    return Table(path, inside or None, list(columns), tree.rate(inside), rows, load=load)


def _as_text(value):
    """A cell as text: whole numbers without a point, missing ones as ""."""
    if isinstance(value, bytes):
        return value.decode("utf-8", errors="replace").strip()
    if isinstance(value, str):
        return value.strip()
    if value is None or value != value:
        return ""
    if isinstance(value, float | np.floating) and float(value).is_integer():
        return str(int(value))
    return str(value).strip()


def _text_format(path, delimiter, header):
    """Separator, encoding, lines before the data, and names of columns (none = an empty file) of a text table."""
    encoding = _encoding(path)
    with path.open(encoding=encoding, newline="") as file:
        lines = [line.rstrip("\r\n") for line in islice(file, HEAD_ROWS + (header or 0))]
    filled = [line for line in lines if line.strip()]
    sample = filled[len(filled) // 2 :]  # behind what may stand before the data
    delimiter = delimiter or max(DELIMITERS, key=lambda candidate: _fit(sample, candidate))
    header, names = _find_header([_split(line.lstrip("#% "), delimiter) for line in lines], header)
    return r"\s+" if delimiter == " " else delimiter, encoding, header, names


def _find_header(rows, header=None):
    """Finds the lines before the data, and the names of the columns, from the first rows of a table.

    Without `header`, a table of numbers starts with the first row of numbers; a table with words has at least one line
    of names. The names are in the last line before the data that has as many different names as there are columns (a
    line of units has not), else "0", "1", ..
    """
    if not any(rows):
        return 0, []
    filled = [row for row in (rows if header is None else rows[header:] or rows) if row]
    body = filled[len(filled) // 2 :]
    columns = Counter(map(len, body)).most_common(1)[0][0]
    if header is None:
        header = _lines_before_data(rows, [row for row in body if len(row) == columns])
    for row in reversed(rows[:header]):
        if len(row) == columns and len(set(row)) == columns:
            return header, row
    return header, [str(column) for column in range(columns)]


def _is_number(text):
    """Whether a cell can stand in a column of numbers: a number, also with a decimal comma, or a missing one."""
    return bool(_NUMBER.fullmatch(text))


def _lines_before_data(rows, body):
    columns = len(body[0])
    only_numbers = all(Counter(tuple(map(_is_number, row)) for row in body).most_common(1)[0][0])
    for line, row in enumerate(rows):
        numbers = [bool(value) and _is_number(value) for value in row]
        if len(row) < columns or not any(numbers):  # a row with too many cells is faulty, and will be refused
            continue
        if only_numbers and numbers[0] and sum(numbers) > columns / 2:
            return line
        if not only_numbers:
            return max(line, 1)
    return 1


def _encoding(path):
    with path.open("rb") as file:
        start = file.read(1 << 16)
    if start.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    if b"\0" in start:
        raise ValueError("it holds zero bytes, which no text does")
    try:
        codecs.getincrementaldecoder("utf-8")().decode(start)  # a character cut at the end is no error
    except UnicodeDecodeError:
        return "latin-1"
    return "utf-8-sig"


def _split(line, delimiter):
    if delimiter == " ":
        return line.split()
    return [value.strip() for row in csv.reader([line], delimiter=delimiter, skipinitialspace=True) for value in row]


def _fit(lines, delimiter):
    """How well a delimiter explains lines: 1 if most have as many columns, and the share of cells that are numbers."""
    rows = [_split(line, delimiter) for line in lines]
    if not rows:
        return 0, 0
    count, times = Counter(map(len, rows)).most_common(1)[0]
    if count < 2 or times < 0.6 * len(rows):
        return 0, 0
    cells = [value for row in rows for value in row]
    return 1, sum(_is_number(value) and not (delimiter == "," and "," in value) for value in cells) / len(cells)

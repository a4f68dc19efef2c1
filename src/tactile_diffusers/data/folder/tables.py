"""Files of other people as tables of named columns: csv, xlsx, mat, hdf5, npy, npz, wav, parquet.

A layout says which column is what; nothing is guessed here. Pickles are never read.
"""

import difflib
import unicodedata
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

from ...io.reading import check_archive, check_size, reading
from ...io.wav_header import check_wav
from .text_tables import HEAD_ROWS, find_header, text_format
from .trees import Tree, open_tree

#: Kind of a file by its extension (lower case).
KINDS = dict.fromkeys((".csv", ".tsv", ".txt", ".dat"), "csv") | dict.fromkeys((".xlsx", ".xlsm"), "xlsx")
KINDS |= dict.fromkeys((".h5", ".hdf5", ".hdf"), "hdf5")
KINDS |= {".mat": "mat", ".npy": "npy", ".npz": "npz", ".wav": "wav", ".parquet": "parquet"}
#: Kinds whose files hold a tree of arrays, in which `inside` names one place.
TREE_KINDS = ("mat", "hdf5", "npz")
#: Cells of a column of numbers that are empty rather than unreadable.
EMPTY = ("", "nan", "NaN", "NA")
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
    path = Path(path)
    kind = kind or kind_of(path)
    if kind == "xlsx" and path.is_file():
        return [read_table(path, kind, inside=sheet, **options) for sheet in paths_inside(path, kind)]
    if kind in TREE_KINDS:
        with reading(path, kind, _REMEDY):
            tree = open_tree(path, kind)
            return [_tree_table(path, tree, place) for place in tree.tables]
    return [read_table(path, kind, **options)]


def paths_inside(path, kind=None):
    """Places inside a file: all groups, structs and arrays of a mat, hdf5 or npz ("" = the top), or sheets."""
    path, kind = Path(path), kind or kind_of(path)
    with reading(path, kind, _REMEDY):
        if kind != "xlsx":
            return open_tree(path, kind).places
        check_archive(path)
        with pd.ExcelFile(path, engine="openpyxl") as book:
            return [str(name) for name in book.sheet_names]


def _read_csv(path, delimiter, header, max_rows):
    found = text_format(path, delimiter, header)
    if not found.names:
        return Table(path, None, [], None, 0, first_line=1)
    common = dict(sep=found.separator, header=None, skiprows=found.header, encoding=found.encoding)
    common |= dict(nrows=max_rows, skipinitialspace=True)
    try:
        frame = pd.read_csv(path, names=found.names, decimal=found.decimal, low_memory=False, **common)
    except pd.errors.EmptyDataError:  # names without any row
        frame = pd.DataFrame(columns=found.names, dtype=np.float64)
    if not isinstance(frame.index, pd.RangeIndex):
        raise ValueError(
            f"{path}, line {found.header + 1}: has more than the {len(found.names)} columns of the other lines. Correct"
            " it, or give `header`, the lines before the data."
        )

    def load(name):  # the first decimal comma may stand behind many whole numbers
        column = frame[name]
        words = column.dtype.kind not in "fiub" and found.separator != ","
        return (column.str.replace(",", ".", regex=False) if words else column).to_numpy()

    def load_text(name):
        # read again: the numbers 1 and 01 are the same, the names are not
        column = found.names.index(name)
        again = pd.read_csv(path, usecols=[column], dtype=str, keep_default_na=False, **common)
        return again.iloc[:, 0].to_numpy(dtype=object)

    return Table(path, None, found.names, None, len(frame), found.header + 1, load, load_text)


def _read_xlsx(path, sheet, header, max_rows):
    check_archive(path)
    rows = None if max_rows is None else max_rows + HEAD_ROWS
    with pd.ExcelFile(path, engine="openpyxl") as book:
        sheet = book.sheet_names[0] if sheet is None else sheet
        if sheet not in book.sheet_names:
            raise ValueError(f"there is no sheet {sheet!r}, only {few(book.sheet_names, 12)}")
        cells = pd.read_excel(
            book, sheet_name=sheet, header=None, dtype=object, nrows=rows, keep_default_na=False, na_values=[""]
        )
    head = [[_as_text(value) for value in row] for row in cells.head(HEAD_ROWS).itertuples(index=False)]
    lines, names = find_header(head, header)
    frame = cells.iloc[lines:].reset_index(drop=True)
    frame.columns = names
    return _frame_table(path, sheet, frame if max_rows is None else frame.head(max_rows), lines + 1)


def _read_parquet(path):
    try:
        import pyarrow.parquet
    except ImportError as error:
        raise ValueError(f'{path}: parquet files need pyarrow: pip install "tactile-diffusers[parquet]"') from error
    described = pyarrow.parquet.read_metadata(path)
    check_size(path, 8 * described.num_rows * described.num_columns)  # equal numbers take no room
    frame = pd.read_parquet(path)
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
    columns = tree.columns(inside)
    if columns is None:
        names = tree.places[1:]
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

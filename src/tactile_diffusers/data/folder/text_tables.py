"""How a text table is written: encoding, delimiter, and which of its first lines are names."""

import codecs
import csv
import re
from collections import Counter
from dataclasses import dataclass
from itertools import islice

#: Delimiters that are tried, the likeliest first; " " stands for any white space.
DELIMITERS = ("\t", ";", "|", ",", " ")
#: Rows in which the delimiter and the names are looked for.
HEAD_ROWS = 60
#: A number, also with a decimal comma, or what stands for a missing one.
_NUMBER = re.compile(r"[+-]?(\d+[.,]?\d*|[.,]\d+)(e[+-]?\d+)?|-?nan|-?inf|na|n/a|null|none|", re.IGNORECASE)


@dataclass
class TextFormat:
    """Arguments for `pandas.read_csv`: separator, decimal sign, encoding, lines before the data, names of columns."""

    separator: str
    decimal: str
    encoding: str
    header: int
    names: list[str]


def text_format(path, delimiter=None, header=None):
    """Looks at the first lines of a text table: `TextFormat`; no names = the file is empty.

    A `delimiter` that is not given is the one that gives the most columns of numbers; `header` as in `find_header`.

    Raises:
        ValueError: if the file is no text.
    """
    encoding = _encoding(path)
    with path.open(encoding=encoding, newline="") as file:
        lines = [line.rstrip("\r\n") for line in islice(file, HEAD_ROWS + (header or 0))]
    filled = [line for line in lines if line.strip()]
    sample = filled[len(filled) // 2 :]  # behind what may stand before the data
    delimiter = delimiter or max(DELIMITERS, key=lambda candidate: _fit(sample, candidate))
    cells = [cell for line in sample for cell in _split(line, delimiter)]
    decimal = "," if delimiter != "," and any("," in cell and is_number(cell) for cell in cells) else "."
    header, names = find_header([_split(line.lstrip("#% "), delimiter) for line in lines], header)
    return TextFormat(r"\s+" if delimiter == " " else delimiter, decimal, encoding, header, names)


def find_header(rows, header=None):
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


def is_number(text):
    """Whether a cell can stand in a column of numbers: a number, also with a decimal comma, or a missing one."""
    return bool(_NUMBER.fullmatch(text))


def _lines_before_data(rows, body):
    columns = len(body[0])
    only_numbers = all(Counter(tuple(map(is_number, row)) for row in body).most_common(1)[0][0])
    for line, row in enumerate(rows):
        numbers = [bool(value) and is_number(value) for value in row]
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
    return 1, sum(is_number(value) and not (delimiter == "," and "," in value) for value in cells) / len(cells)

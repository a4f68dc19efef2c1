"""Refusals of damaged files. Every room reads files through this module; it imports nothing heavy."""

import io
import json
import os
import zipfile
from contextlib import contextmanager
from pathlib import Path

#: Longest quote of a library's message; some quote the file.
_LONGEST_REASON = 300
#: A file may unpack to so many bytes, or to so many times its own size, whichever is more. Recordings and texts do not
#: compress a hundredfold; a damaged header, or an archive built to fill the memory, claims more.
MOST_UNPACKED, MOST_RATIO = 2**26, 100
#: Lengths of the samples of a WAV file that programs write to a pipe, where they cannot come back to say the true one:
#: ffmpeg; arecord; sox.
UNKNOWN = (0xFFFFFFFF, 0x80000000, 0x7FFFFFFF, 0x7FFFF000)


@contextmanager
def reading(path, kind, remedy="Copy it again, or write it again."):
    """Turns whatever the block raises over a damaged file into a `ValueError` that names the file.

    A `FileNotFoundError`, and a `ValueError` or `OSError` that already names the file, pass unchanged.

    Args:
        path (`str` or `Path`): the file.
        kind (`str`): what the file should be, for the message: "a checkpoint".
        remedy (`str`): the last sentence of the message.
    """
    try:
        yield
    except FileNotFoundError:
        raise
    except PermissionError as error:
        raise ValueError(f"{path} may not be read ({error}). Change its permissions.") from error
    except MemoryError as error:
        raise ValueError(
            f"{path} cannot be read as {kind}: it does not fit into memory ({str(error)[:_LONGEST_REASON] or 'full'}). "
            "Free memory, or read it on a larger machine; write the file again if it is much smaller than that: its "
            "header claims too much."
        ) from error
    except Exception as error:  # h5py, zipfile, numpy, json and others raise a dozen kinds
        if type(error) in (ValueError, OSError) and str(path) in str(error):
            raise
        reason = f"{error} is missing" if type(error) is KeyError else str(error) or type(error).__name__
        raise ValueError(f"{path} cannot be read as {kind} ({reason[:_LONGEST_REASON]}). {remedy}") from error


def read_json(path, kind, remedy="Copy it again, or write it again."):
    """Reads a JSON object as a dict.

    Raises:
        FileNotFoundError: if there is no file.
        ValueError: if the file is truncated, not JSON, or not an object.
    """
    with reading(path, kind, remedy):
        content = json.loads(Path(path).read_text(encoding="utf-8-sig"))  # Windows puts a mark before UTF-8
        if not isinstance(content, dict):
            raise ValueError(f"it holds a {type(content).__name__}, not an object")
    return content


def read_table(path, *headers):
    """Reads a CSV file of numbers under a header, one of `headers`, each a tuple of names.

    Returns:
        `tuple`: the header, and the numbers, (rows, columns) float64. To be called within `reading`.
    """
    import numpy as np

    first, *rows = Path(path).read_text(encoding="utf-8-sig").splitlines() or [""]
    header = tuple(name.strip() for name in first.split(","))
    if header not in headers:
        wanted = " or ".join(",".join(names) for names in headers)
        raise ValueError(f"its header is {first[:60] or 'empty'}, not {wanted}")
    if not any(rows):
        raise ValueError("it has no rows below its header")
    table = np.loadtxt(rows, delimiter=",", ndmin=2)  # skips blank lines
    if table.shape[1] != len(header):
        raise ValueError(f"its rows have {table.shape[1]} numbers, not {len(header)}")
    return header, table


def check_size(path, claimed):
    """Raises a `ValueError` if the header of a file claims absurdly more bytes than the file has."""
    held = os.stat(path).st_size
    if claimed > max(MOST_UNPACKED, MOST_RATIO * held):
        raise ValueError(
            f"{path} claims to hold {claimed:.3g} bytes, but has {held}: its header is damaged, or it was built to "
            "fill the memory. Copy it again, or write it again."
        )


def check_archive(path):
    """`check_size` of a zip archive: npz, xlsx."""
    with zipfile.ZipFile(path) as archive:
        check_size(path, sum(member.file_size for member in archive.infolist()))


def import_pyarrow(path):
    """The module `pyarrow` with `pyarrow.parquet`; a `ValueError` for the Parquet file `path` where it is missing."""
    try:
        import pyarrow.parquet
    except ImportError as error:
        raise ValueError(f'{path}: Parquet files need pyarrow: pip install "tactile-diffusers[parquet]"') from error
    return pyarrow


def open_parquet(path):
    """Opens a Parquet file: a `pyarrow.parquet.ParquetFile`, which verifies checksums where the file has them.

    Raises:
        ValueError: if pyarrow is missing, or the header claims absurdly much.
    """
    file = import_pyarrow(path).parquet.ParquetFile(path, page_checksum_verification=True)
    head = file.metadata
    # rows of equal values take no room; columns are not asked: a damaged one ends the process (pyarrow 26)
    sizes = (head.row_group(number).total_byte_size for number in range(file.num_row_groups))
    check_size(path, max(8 * head.num_rows * head.num_columns, sum(sizes)))
    return file


def check_wav(file):
    """Raises a `ValueError` unless the samples that the header of a WAV file promises are all there.

    A length of `UNKNOWN`, which the length of the whole file confirms, promises nothing: the samples go on to the end.

    Args:
        file: binary, open for reading. What begins like no RIFF file (RF64, for example) is left to the reader.
    """
    size = file.seek(0, io.SEEK_END)
    file.seek(0)
    if file.read(4) != b"RIFF":
        return
    whole, place = int.from_bytes(file.read(4), "little"), 12
    while place + 8 <= size:
        file.seek(place)
        name, length = file.read(4), int.from_bytes(file.read(4), "little")
        if name == b"data":
            if length in UNKNOWN and whole in (0xFFFFFFFF, length + place) and size > place + 8:
                return
            if place + 8 + length > size:
                raise ValueError(
                    f"its header promises {length} bytes of samples, it holds {size - place - 8}: cut off?"
                )
            return
        place += 8 + length + length % 2  # chunks are padded to even lengths
    raise ValueError("it has no samples: cut off?")

"""Parquet files, by the optional package pyarrow."""

from .reading import check_size


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

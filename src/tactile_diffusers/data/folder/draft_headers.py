"""The names of the columns of every text file of a kind: one odd batch among many would only be seen by chance."""

from .tables import read_table

#: Rows that are read of each file, enough to find its header.
HEADER_ROWS = 5
#: Files whose names a doubt lists.
_FEW = 3


def check_headers(root, groups):
    """Adds a doubt to each group of csv files in which some have other columns than the first.

    Args:
        root (`Path`): the folder.
        groups (`list[TableGroup]`): with channels.
    """
    for group in groups:
        if group.kind != "csv":
            continue
        known = {facts.table.path: facts.table.names for facts in group.tables}
        usual = group.first.table.names
        found = {name: known.get(root / name) or _names(root / name) for name in group.files.names}
        odd = {name: names for name, names in found.items() if names and names != usual}
        if odd:
            more = f" and {len(odd) - _FEW} more" if len(odd) > _FEW else ""
            group.doubts.append(
                f"{len(odd)} of {len(found)} files have other columns: {', '.join(list(odd)[:_FEW])}{more}; "
                f"the first of them has {', '.join(next(iter(odd.values())))}. Give them a [[files]] of their own, "
                "with `where`"
            )


def _names(path):
    """Names of the columns, or `None` if the file cannot be read: the conversion says why."""
    try:
        return read_table(path, "csv", max_rows=HEADER_ROWS).names
    except (ValueError, OSError):
        return None

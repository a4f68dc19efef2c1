"""What was found in a folder, as a listing for a terminal."""

from collections import Counter

from .draft_columns import HEAD_ROWS
from .draft_names import shown

#: Kinds of tables that are listed.
MOST_GROUPS = 40
#: Columns of a kind of table that are listed.
MOST_LISTED = 24
#: Files that were not looked at, listed by name.
MOST_SKIPPED = 12
#: Names that differ between ratings and recordings, listed.
MOST_NAMES = 4


def listing(inventory):
    """The listing; see `draft.FolderInventory`."""
    files = inventory.files
    total = len(files.files) + len(files.others) + len(files.skipped)
    lines = [
        f"{inventory.root}: {total} files, {len(inventory.groups)} kinds of tables" + " (and more)" * files.truncated
    ]
    told = set()  # files of force and of motion share their names, and what was guessed from these
    for group in inventory.groups[:MOST_GROUPS]:
        lines += ["", *_group(group, inventory.ratings, told)]
    if len(inventory.groups) > MOST_GROUPS:
        lines += ["", f"and {len(inventory.groups) - MOST_GROUPS} more kinds of tables"]
    lines.append("")
    if files.others:
        endings = Counter("." + path.rpartition(".")[2] if "." in path else path for path in files.others)
        lines.append("no tables: " + ", ".join(f"{count} {ending}" for ending, count in endings.most_common()))
    skipped = list(files.skipped.items())
    lines += [f"not looked at: {path}: {reason}" for path, reason in skipped[:MOST_SKIPPED]]
    if len(skipped) > MOST_SKIPPED:
        lines.append(f"not looked at: {len(skipped) - MOST_SKIPPED} more")
    names = list(inventory.surface_names.items())
    lines += [f"{theirs!r} in the ratings is {ours!r} in the recordings (guess)" for theirs, ours in names[:MOST_NAMES]]
    if len(names) > MOST_NAMES:
        lines.append(f"and {len(names) - MOST_NAMES} more such names")
    lines += [f"check: {doubt}" for doubt in inventory.doubts]
    return "\n".join(lines)


def _group(group, ratings, told):
    count = len(group.files.names)
    lines = [f"{group.place}   {count} file{'s' * (count > 1)}, {_size(group.bytes)}, {group.kind}"]
    lines += [f"    {item.role or 'varies'}: {shown(item)}" for item in group.fields]
    if not group.tables:
        return [*lines, "    not opened"]
    facts = group.first
    rows = f"{facts.table.rows} rows" if facts.complete else f"{HEAD_ROWS} rows and more"
    rate, rate_from = group.rate
    clock = f", {rate:.6g} Hz (from {rate_from})" if rate else ""
    seconds = f", {facts.table.rows / rate:.1f} s" if rate and facts.complete else ""
    lines.append(f"    {rows}{clock}{seconds}; {len(group.tables)} opened, ranges of all of them:")
    meaning, doubts = ", ".join(group.channels), group.doubts
    rated = ratings is not None and ratings.group is group
    if rated:
        meaning, doubts = f"ratings ({ratings.keys['form']}) on {', '.join(ratings.axes)}", doubts + ratings.doubts
    lines += _columns(group, rated)
    lines.append(f"    guess: {meaning or 'not used'}")
    new = [doubt for doubt in doubts if doubt not in told]
    told.update(doubt for doubt in new if " taken as the " in doubt)
    return lines + [f"    check: {doubt}" for doubt in new]


def _columns(group, rated):
    columns = group.first.columns
    used = {
        column.name: f"{name} {axis}".strip() for name, axes in group.channels.items() for axis, column in axes.items()
    }
    width = max(len(column.name) for column in columns[:MOST_LISTED])
    lines = []
    for column in columns[:MOST_LISTED]:
        same = [other for facts in group.tables for other in facts.columns if other.name == column.name]
        span = f"{min(c.low for c in same):.4g} .. {max(c.high for c in same):.4g}"
        if column.measures == "text":
            span = f"text, {column.distinct} different"
        missing = f", {column.missing} missing" if column.missing else ""
        measures = "" if column.measures in ("text", "number") else f"{column.measures} {column.axis}".strip()
        known = used.get(column.name) or (f"({measures})" if measures and not rated else "")
        lines.append(f"      {column.name:<{width}}  {column.unit or '-':<5} {span + missing:<28} {known}".rstrip())
    if len(group.first.table.names) > len(lines):
        lines.append(f"      and {len(group.first.table.names) - len(lines)} more columns")
    return lines


def _size(count):
    return f"{count / 1e6:.1f} MB" if count >= 1e5 else f"{count / 1e3:.1f} kB"

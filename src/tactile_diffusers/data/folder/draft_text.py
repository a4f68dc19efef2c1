"""What was found in a folder as text: a listing for a terminal, and the draft of a `layout.toml`."""

from collections import Counter
from pathlib import PurePath

from .draft_columns import HEAD_ROWS
from .layout import CHANNEL_UNITS, FORMAT, TODO, VERSION, VelocityLayout
from .toml_text import toml_comment, toml_table

#: Kinds of tables, columns of one, and other things that are listed.
MOST_GROUPS, MOST_COLUMNS, MOST_LISTED = 40, 24, 12
#: The mean of z must be this share of its range for its sign to decide which way is pressing (recipe).
CLEAR_SIGN = 0.1
#: A rate this close (share) to a whole number of Hz is written as that.
WHOLE_RATE = 1e-3


def listing(inventory):
    """The listing; see `draft.FolderInventory`."""
    files, groups = inventory.files, inventory.groups
    total = len(files.files) + len(files.others) + len(files.skipped)
    lines = [f"{inventory.root}: {total} files, {len(groups)} kinds of tables" + " (and more)" * files.truncated]
    for group in groups[:MOST_GROUPS]:
        lines += ["", *_listed_group(group, inventory.ratings)]
    if len(groups) > MOST_GROUPS:
        lines += ["", f"and {len(groups) - MOST_GROUPS} more kinds of tables"]
    lines.append("")
    if files.others:
        endings = Counter(PurePath(path).suffix or path for path in files.others)
        lines.append("no tables: " + ", ".join(f"{count} {ending}" for ending, count in endings.most_common()))
    lines += _first(f"not looked at: {path}: {reason}" for path, reason in files.skipped.items())
    pairs = inventory.surface_names.items()
    lines += _first(f"{theirs!r} in the ratings is {ours!r} in the recordings (guess)" for theirs, ours in pairs)
    return "\n".join(lines + [f"check: {doubt}" for doubt in inventory.doubts])


def _first(lines):
    lines = list(lines)
    return lines[:MOST_LISTED] + [f"and {len(lines) - MOST_LISTED} more such lines"] * (len(lines) > MOST_LISTED)


def _listed_group(group, ratings):
    count = len(group.files.names)
    lines = [f"{group.place}   {count} file{'s' * (count > 1)}, {group.kind}"]
    lines += [f"    {item.role or 'varies'}: {item}" for item in group.fields]
    if not group.tables:
        return [*lines, "    not opened"]
    facts, (rate, rate_from) = group.first, group.rate
    rows = f"{facts.table.rows} rows" if facts.complete else f"{HEAD_ROWS} rows and more"
    clock = f", {rate:.6g} Hz (from {rate_from})" if rate else ""
    seconds = f", {group.seconds:.1f} s" if group.seconds else ""
    lines.append(f"    {rows}{clock}{seconds}; {len(group.tables)} opened, ranges of all of them:")
    meaning, doubts = ", ".join(group.channels), group.doubts
    if ratings is not None and ratings.group is group:
        meaning, doubts = f"ratings ({ratings.keys['form']}) on {', '.join(ratings.axes)}", doubts + ratings.doubts
    used = {column.name: f"{name} {axis}" for name, axes in group.channels.items() for axis, column in axes.items()}
    width = max(len(column.name) for column in facts.columns)
    for column in facts.columns[:MOST_COLUMNS]:
        same = [other for table in group.tables for other in table.columns if other.name == column.name]
        span = f"{min(c.low for c in same):.4g} .. {max(c.high for c in same):.4g}"
        span = f"text, {column.distinct} different" if column.measures == "text" else span
        span += f", {column.missing} missing" * bool(column.missing)
        known = "" if column.measures in ("text", "number") else f"({column.measures} {column.axis}".strip() + ")"
        known = used.get(column.name, known)
        lines.append(f"      {column.name:<{width}}  {column.unit or '-':<5} {span:<28} {known}".rstrip())
    more = len(facts.table.names) - MOST_COLUMNS
    lines += [f"      and {more} more columns"] * (more > 0) + [f"    guess: {meaning or 'not used'}"]
    return lines + [f"    check: {doubt}" for doubt in doubts]


def draft_layout(inventory):
    """Drafts a `layout.toml`: what was inferred with the evidence, and "TODO: ..." where nothing decides.

    Always to be filled in are the licence, the source, and which word the largest answer on each axis means.

    Args:
        inventory (`FolderInventory`): of `inspect_folder`.

    Returns:
        `str`: TOML. `load_layout` refuses it, naming the keys, until no TODO is left.
    """
    recorded = inventory.recorded
    blocks = [_head(inventory), *map(_files, recorded)]
    held = {name for group in recorded for name in group.channels}
    missing = {}
    if not held & {"force", "lateral"}:
        missing["pattern"] = f"{TODO}: the files with force, such as {{surface}}/{{explorer}}_force.csv"
        missing["force"] = f"{TODO}: {{ x, y, z = columns, unit, normal_sign }}, or remove this and give lateral"
    elif "force" in held and not held & {"position", "velocity"}:
        ask = "the files with position or velocity; or, if x is the sliding direction, give it as lateral above"
        missing["pattern"] = f"{TODO}: {ask}"
    if missing:
        blocks.append(toml_table(missing, header="[[files]]"))
    if inventory.unused:
        blocks.append("\n".join(["# Not used:", *(toml_comment(group.place) for group in inventory.unused)]))
    if "position" in held:
        header = "[velocity]  # of the filter that makes velocity from position"
        blocks.append(toml_table(VelocityLayout().model_dump(), {"window": "s"}, header))
    if inventory.ratings is not None:
        blocks.append(_ratings(inventory.ratings))
    if inventory.surface_names:
        header = "# name in the ratings = name in the recordings: paired by numbers or spelling, check them"
        blocks.append(toml_table(inventory.surface_names, header=f"{header}\n[surface_names]"))
    return "\n\n".join(blocks) + "\n"


def _head(inventory):
    licences = [path for path in inventory.files.others if "licen" in path.lower() or "readme" in path.lower()]
    see = f"; see {', '.join(licences[:2])}" if licences else ""
    facts = {
        "format": FORMAT,
        "version": VERSION,
        "source": f"{TODO}: what these data are and where they come from",
        "licence": f"{TODO}: under which licence{see}",
    }
    drafted = f"Drafted from {inventory.root.resolve().name}: check every line, fill in what holds {TODO}."
    return "\n".join([toml_comment(drafted), *_checks(inventory.doubts), toml_table(facts)])


def _checks(doubts):
    return [toml_comment(f"check: {doubt}") for doubt in doubts]


def _files(group):
    """One `[[files]]`."""
    facts, comments = group.first, {}
    rows = f"first {HEAD_ROWS} rows" if not facts.complete else f"{facts.table.rows} rows"
    lines = [f"# files: {len(group.files.names)}; {rows} of {len(group.tables)} looked at"]
    lines += [toml_comment(f"{item.role}: {item}") for item in group.fields if item.role]
    keys = {"pattern": group.files.pattern, **_inside(group)}
    if group.field_of("surface") is None:
        keys["pattern"] = f"{TODO}: put {{surface}} where its name stands in {group.files.pattern}"
    keys |= _clock(group, comments)
    for name, columns in group.channels.items():
        keys[name], comments[name] = _channel(group, name, columns)
    return "\n".join([*lines, *_checks(group.doubts), toml_table(keys, comments, "[[files]]")])


def _inside(group):
    key = "sheet" if group.kind == "xlsx" else "inside"
    return {key: group.inside.pattern} if group.inside else {}


def _clock(group, comments):
    """`time` or `rate`."""
    facts = group.first
    time = facts.measuring("time").get("")
    rate, rate_from = group.rate
    if rate is not None:
        rate = round(rate) if abs(rate - round(rate)) <= WHOLE_RATE * rate else float(f"{rate:.6g}")
    if time is not None and not facts.stamps_coarse and time.high > time.low:
        comments["time"] = f"{rate} Hz" if rate else "the unit is unknown"
        return {"time": {"column": _column(facts, time), "unit": facts.time_unit or f"{TODO}: s, ms or us"}}
    if rate is None:
        return {"rate": f"{TODO}: samples per second"}
    comments["rate"] = f"Hz, from {rate_from}" + ", whose stamps are coarser than the samples" * facts.stamps_coarse
    return {"rate": rate}


def _column(facts, column):
    """Its name, or its index where columns have none."""
    names = facts.table.names
    return names.index(column.name) if names == [str(i) for i in range(len(names))] else column.name


def _channel(group, name, columns):
    """Inline table of a channel, and the evidence."""
    axes = {axis or "column": _column(group.first, column) for axis, column in columns.items()}
    units = {column.unit for column in columns.values()}
    unit = " and ".join(map(str, sorted(units, key=str))) if len(units) > 1 else units.pop()
    largest = max(max(abs(column.low), abs(column.high)) for column in columns.values())
    channel, evidence = axes | {"unit": unit}, f"up to {largest:.3g}"
    if unit not in CHANNEL_UNITS[name]:
        named = f"; the name says {unit}" if unit else ""
        counts = " for counts" if "1" in CHANNEL_UNITS[name] else ""
        channel["unit"] = f"{TODO}: {', '.join(CHANNEL_UNITS[name])}{counts}{named}"
    if group.kind == "wav":
        channel["scale"] = f"{TODO}: N at full scale of the sound file"
    if name == "force":
        z = columns["z"]
        evidence = f"z is {z.mean:.4g} on average, from {z.low:.4g} to {z.high:.4g}"
        if abs(z.mean) >= CLEAR_SIGN * max(z.high - z.low, 1e-30):
            channel["normal_sign"] = 1 if z.mean > 0 else -1
            evidence += f": pressing is {'positive' if z.mean > 0 else 'negative'}"
        else:
            channel["normal_sign"] = f"{TODO}: 1 if pressing is positive in z, else -1"
    return channel, evidence


def _ratings(guess):
    group = guess.group
    keys = {"pattern": group.files.pattern, **_inside(group), **guess.keys}
    first_line = group.first.table.first_line
    if first_line not in (None, 2):
        keys["header"] = first_line - 1
    axes = toml_table(guess.axes, header="[ratings.axes]")
    return "\n".join([*_checks(guess.doubts), toml_table(keys, guess.comments, "[ratings]"), axes])

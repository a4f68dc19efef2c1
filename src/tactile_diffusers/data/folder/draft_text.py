"""The draft of a `layout.toml` as text, with the evidence as comments."""

from .draft_columns import HEAD_ROWS
from .draft_names import shown
from .layout import CHANNEL_UNITS, FORMAT, TODO, VERSION, VelocityLayout
from .toml_text import toml_comment, toml_lines

#: The mean of z must be this share of its range for its sign to tell which way is pressing (recipe).
CLEAR_SIGN = 0.1
#: A rate this close (share) to a whole number of Hz is told as that.
WHOLE_RATE = 1e-3


def layout_text(inventory):
    """The whole draft; see `draft.draft_layout`."""
    recorded = inventory.recorded
    blocks = [_head(inventory), *(_files(group) for group in recorded)]
    held = {name for group in recorded for name in group.channels}
    if not held & {"force", "lateral"}:
        blocks.append(_unknown_files(inventory))
    elif "force" in held and not held & {"position", "velocity"}:
        ask = (
            f"{TODO}: the files with position or velocity; or, if x is the sliding direction, give it as lateral above"
        )
        blocks.append("\n".join(["[[files]]", *toml_lines({"pattern": ask})]))
    unused = [group.place for group in inventory.groups if not group.channels and not _holds_ratings(inventory, group)]
    if unused:
        blocks.append("\n".join(["# Not used:", *(toml_comment(place) for place in unused)]))
    if "position" in held:
        filter_ = VelocityLayout()
        lines = toml_lines({"window": filter_.window, "order": filter_.order}, {"window": "s"})
        blocks.append("\n".join(["[velocity]  # of the filter that makes velocity from position", *lines]))
    if inventory.ratings is not None:
        blocks.append(_ratings(inventory.ratings))
    if inventory.surface_names:
        lines = ["# name in the ratings = name in the recordings: paired by numbers or spelling, check them"]
        blocks.append("\n".join([*lines, "[surface_names]", *toml_lines(inventory.surface_names)]))
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
    lines = [
        toml_comment(f"Drafted from {inventory.root.resolve().name}: check every line, fill in what holds {TODO}."),
        *_checks(inventory.doubts),
        *toml_lines(facts),
    ]
    return "\n".join(lines)


def _checks(doubts):
    return [toml_comment(f"check: {doubt}") for doubt in doubts]


def _files(group):
    """One `[[files]]`."""
    facts, comments = group.first, {}
    rows = f"first {HEAD_ROWS} rows" if not facts.complete else f"{facts.table.rows} rows"
    lines = [f"# files: {len(group.files.names)}; {rows} of {len(group.tables)} looked at"]
    lines += [toml_comment(f"{item.role}: {shown(item)}") for item in group.fields if item.role]
    lines += _checks(group.doubts)
    keys = {"pattern": group.files.pattern, **_inside(group)}
    if group.field_of("surface") is None:
        keys["pattern"] = f"{TODO}: put {{surface}} where its name stands in {group.files.pattern}"
    keys |= _clock(group, comments)
    for name, columns in group.channels.items():
        keys[name], comments[name] = _channel(group, name, columns)
    return "\n".join([*lines, "[[files]]", *toml_lines(keys, comments)])


def _inside(group):
    if group.inside is None:
        return {}
    return {"sheet" if group.kind == "xlsx" else "inside": group.inside.pattern}


def _clock(group, comments):
    """`time` or `rate`."""
    facts = group.first
    time = facts.measuring("time").get("")
    rate, rate_from = group.rate
    if time is not None and not facts.stamps_coarse and time.high > time.low:
        comments["time"] = f"{_hertz(rate)} Hz" if rate else "the unit is unknown"
        return {"time": {"column": _column(facts, time), "unit": facts.time_unit or f"{TODO}: s, ms or us"}}
    if rate is None:
        return {"rate": f"{TODO}: samples per second"}
    comments["rate"] = f"Hz, from {rate_from}" + ", whose stamps are coarser than the samples" * facts.stamps_coarse
    return {"rate": _hertz(rate)}


def _hertz(rate):
    return round(rate) if abs(rate - round(rate)) <= WHOLE_RATE * rate else float(f"{rate:.6g}")


def _column(facts, column):
    """Its name, or its index where columns have none."""
    names = facts.table.names
    return names.index(column.name) if names == [str(i) for i in range(len(names))] else column.name


def _channel(group, name, columns):
    """Inline table of a channel, and the evidence."""
    axes = {axis or "column": _column(group.first, column) for axis, column in columns.items()}
    first = next(iter(columns.values()))
    largest = max(max(abs(column.low), abs(column.high)) for column in columns.values())
    channel, evidence = axes | {"unit": first.unit}, f"up to {largest:.3g}"
    if first.unit not in CHANNEL_UNITS[name]:
        named = f"; the name says {first.unit}" if first.unit else ""
        choices = ", ".join(CHANNEL_UNITS[name])
        channel["unit"] = f"{TODO}: {choices}{' for counts' if name in ('force', 'lateral') else ''}{named}"
    if group.kind == "wav":
        channel["scale"] = f"{TODO}: N at full scale of the sound file"
    if name == "force":
        sign, evidence = _normal_sign(columns["z"])
        channel["normal_sign"] = sign
    return channel, evidence


def _normal_sign(z):
    spread = max(z.high - z.low, 1e-30)
    evidence = f"z is {z.mean:.4g} on average, from {z.low:.4g} to {z.high:.4g}"
    if not abs(z.mean) >= CLEAR_SIGN * spread:
        return f"{TODO}: 1 if pressing is positive in z, else -1", evidence
    return (1, f"{evidence}: pressing is positive") if z.mean > 0 else (-1, f"{evidence}: pressing is negative")


def _unknown_files(inventory):
    """A `[[files]]` to be filled in, of the largest kind of file that nothing is known about."""
    unknown = [g for g in inventory.groups if not g.channels and not _holds_ratings(inventory, g)]
    lines = ["# no force was recognised"]
    keys = {"pattern": f"{TODO}: the files with force, such as {{surface}}/{{explorer}}_force.csv"}
    if unknown:
        group = max(unknown, key=lambda g: g.bytes)
        names = ", ".join(group.first.table.names[:12]) if group.tables else "unknown"
        lines.append(toml_comment(f"the largest files are {group.place}, with columns {names}"))
    keys["force"] = f"{TODO}: {{ x, y, z = columns, unit, normal_sign }}, or remove this and give lateral"
    return "\n".join([*lines, "[[files]]", *toml_lines(keys)])


def _holds_ratings(inventory, group):
    return inventory.ratings is not None and inventory.ratings.group is group


def _ratings(guess):
    group = guess.group
    keys = {"pattern": group.files.pattern, **_inside(group), **guess.keys}
    first_line = group.first.table.first_line
    if first_line is not None and first_line != 2:
        keys["header"] = first_line - 1
    lines = [
        *_checks(guess.doubts),
        "[ratings]",
        *toml_lines(keys, guess.comments),
        "[ratings.axes]",
        *toml_lines(guess.axes),
    ]
    return "\n".join(lines)

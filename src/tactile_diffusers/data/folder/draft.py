"""Looks at anyone's folder of recordings and drafts its `layout.toml`.

Names of files become patterns, a few files of each pattern are opened, and what their columns probably are is guessed
from names, units and numbers. Every guess is reported; what cannot be guessed is marked TODO in the draft, and a layout
with a TODO is refused.
"""

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path, PurePath

from .clocks import whole
from .draft_names import assign_roles, content_of
from .draft_ratings import RatingsGuess, guess_ratings
from .draft_tables import HEAD_ROWS, TableGroup, list_files, open_groups
from .layout import CHANNEL_UNITS, FORMAT, TODO, VERSION, VelocityLayout
from .layout_text import toml_comment, toml_table
from .rating_tables import pair_names
from .sources import Pattern

#: Columns of a kind of table, and files that were not looked at, that are listed.
MOST_COLUMNS, MOST_SKIPPED = 24, 12
#: The mean of z must be this share of its range for its sign to decide which way is pressing (recipe).
CLEAR_SIGN = 0.1


@dataclass
class FolderInventory:
    """What is in a folder; `draft_layout` puts it in words.

    Attributes:
        root (`Path`): the folder. Paths in it are relative and written with "/".
        files, others (`list[str]`): files that may be tables, and other files.
        skipped (`dict[str, str]`): files that were not looked at -> the reason.
        groups (`list[TableGroup]`): tables of one kind each.
        ratings (`RatingsGuess` or `None`): what looks like answers of raters.
        surface_names (`dict[str, str]`): name in the ratings -> name in the recordings, where they differ.
        doubts (`list[str]`): about the folder as a whole.
    """

    root: Path
    files: list[str]
    others: list[str]
    skipped: dict[str, str]
    groups: list[TableGroup] = field(default_factory=list)
    ratings: RatingsGuess | None = None
    surface_names: dict = field(default_factory=dict)
    doubts: list[str] = field(default_factory=list)

    @property
    def recorded(self):
        """Groups that hold a channel of recordings."""
        return [group for group in self.groups if group.channels]

    @property
    def held(self):
        """Names of all channels."""
        return {name for group in self.recorded for name in group.channels}

    @property
    def surfaces(self):
        """Names of recorded surfaces, of the kind of file that has most of them."""
        return max((group.surfaces for group in self.recorded), key=len, default=[])


def inspect_folder(root, quiet=False):
    """Looks at a folder: names, columns, units, rates and ranges, and what they probably mean.

    At most 90 files are opened, three of each kind of name; of text tables the first 50,000 rows are read. Nothing is
    written, and pickles are not read.

    Args:
        root (`str` or `Path`): the folder.
        quiet (`bool`): no progress bar.

    Returns:
        `FolderInventory`.

    Raises:
        FileNotFoundError: if there is no folder.
    """
    root = Path(root)
    inventory = FolderInventory(root, *list_files(root))
    inventory.groups = open_groups(root, inventory.files, inventory.skipped, quiet)
    rated = []
    for group in inventory.groups:
        if group.tables and guess_ratings(group, set()) is not None:
            rated.append(group)
        elif group.tables:
            group.channels = _find_channels(group)
    for group in inventory.recorded:
        group.doubts += assign_roles(group.fields) + group.first.doubts
    _choose_channels(inventory.recorded)
    for group in inventory.recorded:
        group.doubts += _doubts_on_names(group)
    _find_ratings(inventory, rated)
    inventory.doubts += _doubts_on_folder(inventory)
    return inventory


def _find_channels(group):
    """The channels that the columns of a group hold: name -> axis -> column."""
    facts, channels = group.first, {}
    force, lateral = facts.measuring("force"), facts.measuring("lateral")
    along = lateral.get("") or force.get("x") or force.get("")
    if {"x", "y", "z"} <= force.keys():
        channels["force"] = {axis: force[axis] for axis in "xyz"}
    elif {"x", "z"} <= force.keys():  # of two axes; a force that is named lateral is one whichever way it slides
        channels["force"] = {axis: force[axis] for axis in "xz"}
    elif group.kind == "wav" and content_of(group.files.words) != "sound":
        channels["lateral"] = {"": facts.columns[0]}
    elif along is not None:
        channels["lateral"] = {"": along}
        rest = [column.name for column in (*force.values(), *lateral.values()) if column is not along]
        if rest:
            group.doubts.append(f"without axes of force only one column is used, not {', '.join(rest)}")
    for name in ("position", "velocity"):
        columns = facts.measuring(name)
        along = columns.get("x") or columns.get("")
        if along is not None:
            channels[name] = {"x": along} | ({"y": columns["y"]} if "y" in columns else {})
    return channels


def _choose_channels(groups):
    """Leaves each surface one force and one motion: `force` before `lateral`, `velocity` before `position`."""
    for better, other in (("force", "lateral"), ("velocity", "position")):
        known = {name for group in groups if better in group.channels for name in group.surfaces}
        for group in groups:
            if other in group.channels and known & set(group.surfaces):
                del group.channels[other]
                group.doubts.append(f"{other} is not used: there is {better}")


def _find_ratings(inventory, groups):
    """Sets the ratings, of the group with most axes and surfaces, and which of their surfaces is which recorded one."""
    surfaces = set(inventory.surfaces)
    groups = groups or [group for group in inventory.groups if group.tables and not group.channels]
    guesses = [guess for group in groups if (guess := guess_ratings(group, surfaces)) is not None]
    if not guesses:
        return
    ratings = inventory.ratings = max(guesses, key=lambda guess: (len(guess.axes), len(guess.surfaces)))
    rated = [name for name in ratings.surfaces if name not in inventory.surfaces]
    recorded = [name for name in inventory.surfaces if name not in ratings.surfaces]
    if rated and recorded:
        ask = f"{TODO}: which of {', '.join(recorded[:4])}{', ..' * (len(recorded) > 4)}"
        inventory.surface_names = {name: other or ask for name, other in pair_names(rated, recorded).items()}


def _doubts_on_names(group):
    """Yields a doubt if the pattern reads another name of a surface than was meant."""
    surface, pattern = group.field_of("surface"), Pattern(group.files.pattern)
    for name, meant in zip(group.files.names, surface.values if surface in group.files.fields else (), strict=False):
        read = (pattern.match(name) or {}).get("surface", "")
        if read != meant:
            yield f"the pattern reads the surface of {name} as {read!r}: rename the files so that names are clear"
            return


def _doubts_on_folder(inventory):
    held = inventory.held
    if not held & {"force", "lateral"}:
        yield "no force was recognised"
    if "force" in held and not held & {"position", "velocity"}:
        yield "no position or velocity was recognised: the sliding direction is unknown"
    if inventory.ratings is None:
        yield "no ratings were recognised"


def draft_layout(inventory):
    """Drafts a `layout.toml`: what was inferred with the evidence, and "TODO: ..." where nothing decides.

    Always to be filled in are the licence, the source, and which word the largest answer on each axis means.

    Args:
        inventory (`FolderInventory`): of `inspect_folder`.

    Returns:
        `str`: TOML. `load_layout` refuses it, naming the keys, until no TODO is left.
    """
    held, ratings = inventory.held, inventory.ratings
    blocks = [_head(inventory), *map(_files, inventory.recorded)]
    if not held & {"force", "lateral"}:
        missing = {
            "pattern": f"{TODO}: the files with force, such as {{surface}}/{{explorer}}_force.csv",
            "force": f"{TODO}: {{ x, y, z = columns, unit, normal_sign }}, or remove this and give lateral",
        }
        blocks.append(toml_table("[[files]]", missing))
    elif "force" in held and not held & {"position", "velocity"}:
        ask = "the files with position or velocity; or, if x is the sliding direction, give it as lateral above"
        blocks.append(toml_table("[[files]]", {"pattern": f"{TODO}: {ask}"}))
    rated = ratings.group if ratings else None
    unused = [group for group in inventory.groups if not group.channels and group is not rated]
    if unused:
        listed = [line for group in unused for line in (toml_comment(group.place), *_columns(group))]
        blocks.append("\n".join(["# Not used:", *listed]))
    if "position" in held:
        header = "[velocity]  # of the filter that makes velocity from position"
        blocks.append(toml_table(header, VelocityLayout().model_dump(), {"window": "s"}))
    if ratings is not None:
        first_line = rated.first.table.first_line
        keys = {"pattern": rated.files.pattern, **_inside(rated), **ratings.keys}
        keys |= {"header": first_line - 1} if first_line not in (None, 2) else {}
        lines = [*_columns(rated), *_checks(ratings.doubts), toml_table("[ratings]", keys, ratings.comments)]
        blocks.append("\n".join(lines))
        blocks[-1] += "\n" + toml_table("[ratings.axes]", ratings.axes)
    if inventory.surface_names:
        header = "# name in the ratings = name in the recordings: paired by numbers or spelling, check them"
        blocks.append(toml_table(f"{header}\n[surface_names]", inventory.surface_names))
    return "\n\n".join(blocks) + "\n"


def _head(inventory):
    licences = [path for path in inventory.others if "licen" in path.lower() or "readme" in path.lower()]
    see = f"; see {', '.join(licences[:2])}" if licences else ""
    facts = {
        "format": FORMAT,
        "version": VERSION,
        "source": f"{TODO}: what these data are and where they come from",
        "licence": f"{TODO}: under which licence{see}",
    }
    lines = [f"Drafted from {inventory.root.resolve().name}: check every line, fill in what holds {TODO}."]
    if inventory.others:
        endings = Counter(PurePath(path).suffix or path for path in inventory.others)
        lines.append("no tables: " + ", ".join(f"{count} {ending}" for ending, count in endings.most_common()))
    skipped = [f"not looked at: {path}: {reason}" for path, reason in inventory.skipped.items()]
    lines += skipped[:MOST_SKIPPED]
    lines += [f"not looked at: {len(skipped) - MOST_SKIPPED} more files"] * (len(skipped) > MOST_SKIPPED)
    return "\n".join([*map(toml_comment, lines), *_checks(inventory.doubts), toml_table("", facts)])


def _checks(doubts):
    return [toml_comment(f"check: {doubt}") for doubt in doubts]


def _columns(group):
    """A comment for each column: its unit, its range in the files that were opened, what it measures by its name."""
    if not group.tables:
        return ["#   holds no table, or was not opened (see above)"]
    lines = []
    for column in group.first.columns[:MOST_COLUMNS]:
        same = [other for table in group.tables for other in table.columns if other.name == column.name]
        span = f"{min(c.low for c in same):.4g} to {max(c.high for c in same):.4g}"
        words = [f"text, {column.distinct} different" if column.measures == "text" else span]
        words += [f"{column.missing} missing"] * bool(column.missing)
        words += [f"{column.measures} {column.axis}".strip()] * (column.measures not in ("text", "number"))
        lines.append(toml_comment(f"- {column.name}: {', '.join(words)}"))
    more = len(group.first.table.names) - MOST_COLUMNS
    return lines + [f"# - and {more} more columns"] * (more > 0)


def _files(group):
    """One `[[files]]`."""
    facts, comments = group.first, {}
    rows = f"first {HEAD_ROWS} rows" if not facts.complete else f"{facts.table.rows} rows"
    lines = [f"# files: {len(group.files.names)}; {rows} of {len(group.tables)} looked at"]
    lines += [toml_comment(f"{item.role}: {item}") for item in group.fields if item.role] + _columns(group)
    keys = {"pattern": group.files.pattern, **_inside(group)}
    if group.field_of("surface") is None:
        keys["pattern"] = f"{TODO}: put {{surface}} where its name stands in {group.files.pattern}"
    keys |= _clock(group, comments)
    for name, columns in group.channels.items():
        keys[name], comments[name] = _channel(group, name, columns)
    return "\n".join([*lines, *_checks(group.doubts), toml_table("[[files]]", keys, comments)])


def _inside(group):
    key = "sheet" if group.kind == "xlsx" else "inside"
    return {key: group.inside.pattern} if group.inside else {}


def _clock(group, comments):
    """`time` or `rate`."""
    facts = group.first
    time = facts.measuring("time").get("")
    rate, rate_from = group.rate
    if rate is not None:
        rate = float(f"{whole(rate):.6g}")
    if time is not None and not facts.stamps_coarse and time.high > time.low:
        comments["time"] = f"{rate:g} Hz" if rate else "the unit is unknown"
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

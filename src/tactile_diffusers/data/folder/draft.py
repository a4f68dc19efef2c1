"""Looks at anyone's folder of recordings and drafts its `layout.toml`.

Names of files become patterns, a few files of each pattern are opened, and what their columns probably are is guessed
from names, units and numbers. Every guess is reported; what cannot be guessed is marked TODO in the draft, and a layout
with a TODO is refused.
"""

from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from .clocks import SHORTEST_SHARE
from .draft_groups import FileList, TableGroup, list_files, open_groups
from .draft_names import assign_roles, content_of
from .draft_ratings import RatingsGuess, guess_ratings
from .draft_text import listing
from .layout import TODO
from .patterns import Pattern
from .rating_tables import pair_names
from .tables import read_table

#: Rows that are read of each csv file, enough to find its header.
HEADER_ROWS = 5


@dataclass
class FolderInventory:
    """What is in a folder; `str` prints it for a terminal.

    Attributes:
        root (`Path`): the folder.
        files (`FileList`): its files, and those that were not looked at with the reason.
        groups (`list[TableGroup]`): tables of one kind each.
        ratings (`RatingsGuess` or `None`): what looks like answers of raters.
        surface_names (`dict[str, str]`): name in the ratings -> name in the recordings, where they differ.
        doubts (`list[str]`): about the folder as a whole.
    """

    root: Path
    files: FileList
    groups: list[TableGroup] = field(default_factory=list)
    ratings: RatingsGuess | None = None
    surface_names: dict = field(default_factory=dict)
    doubts: list[str] = field(default_factory=list)

    @property
    def recorded(self):
        """Groups that hold a channel of recordings."""
        return [group for group in self.groups if group.channels]

    @property
    def unused(self):
        """Groups that hold neither recordings nor the ratings."""
        rated = self.ratings.group if self.ratings else None
        return [group for group in self.groups if not group.channels and group is not rated]

    @property
    def surfaces(self):
        """Names of recorded surfaces, of the kind of file that has most of them."""
        return max((group.surfaces for group in self.recorded), key=len, default=[])

    def __str__(self):
        return listing(self)


def inspect_folder(root, quiet=False):
    """Looks at a folder: names, columns, units, rates and ranges, and what they probably mean.

    At most 5000 files are listed (1000 of a folder) and 90 opened, three of each kind of name; of text tables the
    first 50,000 rows are read. Of all text tables that hold recordings the names of columns are compared. Nothing is
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
    inventory = FolderInventory(root, list_files(root))
    inventory.groups = open_groups(root, inventory.files, quiet)
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
        group.doubts += [*_doubts_on_names(group), *_doubts_on_numbers(group, inventory.recorded)]
        group.doubts += _doubts_on_headers(root, group)
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
    elif group.kind == "wav" and content_of(group.files.words) != "sound":
        channels["lateral"] = {"": facts.columns[0]}
    elif along is not None:
        channels["lateral"] = {"": along}
        rest = [column.name for column in (*force.values(), *lateral.values()) if column is not along]
        if rest:
            group.doubts.append(f"without three axes of force only one column is used, not {', '.join(rest)}")
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
    guesses = [guess_ratings(group, set(inventory.surfaces)) for group in groups]
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


def _doubts_on_numbers(group, groups):
    """Yields what looks wrong in the forces, columns, rates and lengths of a group."""
    if "force" in group.channels:
        mean = {axis: column.mean for axis, column in group.channels["force"].items()}
        largest = max(mean, key=lambda axis: abs(mean[axis]))
        if abs(mean[largest]) > abs(mean["z"]):
            name = group.channels["force"][largest].name
            values = f"({mean[largest]:.3g}), not in z ({mean['z']:.3g})"
            yield f"the mean force is largest in {name} {values}: is z the normal force?"
    rates = [table.rate for table in group.tables if table.rate]
    if rates and max(rates) > 1.01 * min(rates):
        remedy = ": preparation will refuse this; resample to one rate (`resample` = Hz)"
        remedy *= bool(group.channels.keys() & {"force", "lateral"})
        yield f"rates differ between files: {min(rates):.6g} to {max(rates):.6g} Hz{remedy}"
    longest = max((other.seconds or 0 for other in groups if set(other.surfaces) & set(group.surfaces)), default=0)
    if group.seconds and group.seconds < SHORTEST_SHARE * longest:
        yield f"lasts {group.seconds:.3g} s, others {longest:.3g} s: is the rate right?"


def _doubts_on_headers(root, group):
    """Yields a doubt if some files have other columns than the first. All csv files are read, as a batch may be odd."""
    columns = {facts.table.path: facts.table.names for facts in group.tables}
    for path in (root / name for name in group.files.names if group.kind == "csv"):
        with suppress(ValueError, OSError):  # the conversion says why
            columns[path] = columns.get(path) or read_table(path, "csv", max_rows=HEADER_ROWS).names
    usual = group.first.table.names
    odd = {path.relative_to(root).as_posix(): names for path, names in columns.items() if names and names != usual}
    if odd:
        more = f" and {len(odd) - 3} more" if len(odd) > 3 else ""
        yield (
            f"{len(odd)} of {len(group.files.names)} files have other columns: {', '.join(sorted(odd)[:3])}{more}; the "
            f"first of them has {', '.join(odd[min(odd)])}. Give them a [[files]] of their own, with `where`"
        )


def _doubts_on_folder(inventory):
    held = {name for group in inventory.recorded for name in group.channels}
    if not held & {"force", "lateral"}:
        yield "no force was recognised"
    if "force" in held and not held & {"position", "velocity"}:
        yield "no position or velocity was recognised: the sliding direction is unknown"
    if inventory.ratings is None:
        yield "no ratings were recognised"
    if inventory.files.truncated:
        yield "the folder has more files than are listed; what does not vary in the names of these may in the others"

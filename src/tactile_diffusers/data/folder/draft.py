"""Looks at anyone's folder of recordings and drafts its `layout.toml`.

Names of files become patterns, a few files of each pattern are opened, and what their columns probably are is guessed
from names, units and numbers. Every guess is reported; what cannot be guessed is marked TODO in the draft, and a layout
with a TODO is refused.
"""

from dataclasses import dataclass, field
from pathlib import Path

from .clocks import SHORTEST_SHARE
from .draft_groups import MOST_OPENED, FileList, TableGroup, list_files, open_groups
from .draft_names import assign_roles
from .draft_ratings import RatingsGuess, guess_ratings
from .draft_text import layout_text, listing
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
        items = [item for group in self.recorded if (item := group.field_of("surface")) is not None]
        return max((item.distinct for item in items), key=len, default=[])

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
    inventory.groups = open_groups(root, inventory.files.files, inventory.files.skipped, quiet)
    readable = [group for group in inventory.groups if group.tables]
    guesses = [guess for group in readable if (guess := guess_ratings(group, set())) is not None]
    for group in readable:
        if not any(guess.group is group for guess in guesses):
            _find_channels(group)
    _choose_channels(inventory.recorded)
    surfaces = set(inventory.surfaces)
    guesses = [guess_ratings(guess.group, surfaces) for guess in guesses]  # again: now the surfaces are known
    if guesses:
        inventory.ratings = max(guesses, key=lambda guess: (len(guess.axes), len(guess.surfaces)))
    others = [guess.group.place for guess in guesses if guess is not inventory.ratings]
    if others:
        inventory.ratings.doubts.append(f"more tables look like ratings and are not used: {', '.join(others)}")
    rated = inventory.ratings.surfaces if inventory.ratings else []
    _agree_on_names(inventory.recorded, rated)
    _check_names(inventory.recorded, list(inventory.files.files))
    _check_lengths(inventory.recorded)
    for group in inventory.recorded:
        if group.kind == "csv":
            _check_headers(root, group)
    left, right = ([n for n in one if n not in other] for one, other in _both_ways(rated, inventory.surfaces))
    if left and right:
        ask = f"{TODO}: which of {', '.join(right[:4])}{', ..' * (len(right) > 4)}"
        inventory.surface_names = {name: other or ask for name, other in pair_names(left, right).items()}
    _doubt_together(inventory)
    return inventory


def draft_layout(inventory):
    """Drafts a `layout.toml`: what was inferred with the evidence, and "TODO: ..." where nothing decides.

    Always to be filled in are the licence, the source, and which word the largest answer on each axis means.

    Args:
        inventory (`FolderInventory`): of `inspect_folder`.

    Returns:
        `str`: TOML. `load_layout` refuses it, naming the keys, until no TODO is left.
    """
    return layout_text(inventory)


def _both_ways(one, other):
    return (one, other), (other, one)


def _find_channels(group):
    """Sets the channels of a group from its columns, and the roles of its names; adds doubts."""
    facts = group.first
    force, lateral = facts.measuring("force"), facts.measuring("lateral")
    along, doubts = lateral.get("") or force.get("x") or force.get(""), []
    if {"x", "y", "z"} <= force.keys():
        group.channels["force"] = {axis: force[axis] for axis in "xyz"}
    elif group.kind == "wav" and "sound" not in group.words:
        group.channels["lateral"] = {"": facts.columns[0]}
    elif along is not None:
        group.channels["lateral"] = {"": along}
        rest = [column.name for column in (*force.values(), *lateral.values()) if column is not along]
        if rest:
            doubts.append(f"without three axes of force only one column is used, not {', '.join(rest)}")
    for name in ("position", "velocity"):
        columns = facts.measuring(name)
        along = columns.get("x") or columns.get("")
        if along is not None:
            group.channels[name] = {"x": along} | ({"y": columns["y"]} if "y" in columns else {})
    if not group.channels:
        return
    group.doubts += doubts + assign_roles(group.fields) + facts.doubts
    if group.field_of("surface") is None:
        group.doubts.append("no part of the names is the surface")
    if "force" in group.channels:
        mean = {axis: column.mean for axis, column in group.channels["force"].items()}
        largest = max(mean, key=lambda axis: abs(mean[axis]))
        if abs(mean[largest]) > abs(mean["z"]):
            name = group.channels["force"][largest].name
            group.doubts.append(
                f"the mean force is largest in {name} ({mean[largest]:.3g}), not in z ({mean['z']:.3g}): is z the "
                "normal force?"
            )
    if len({tuple(table.table.names) for table in group.tables}) > 1 and group.kind != "csv":
        group.doubts.append("columns differ between the files that were opened")
    rates = [table.rate for table in group.tables if table.rate]
    if rates and max(rates) > 1.01 * min(rates):
        refused = ": preparation will refuse this; resample to one rate (`resample` = Hz)"
        refused *= bool(group.channels.keys() & {"force", "lateral"})
        group.doubts.append(f"rates differ between files: {min(rates):.6g} to {max(rates):.6g} Hz{refused}")


def _choose_channels(groups):
    """Leaves each surface one force and one motion: `force` before `lateral`, `velocity` before `position`."""
    for better, other in (("force", "lateral"), ("velocity", "position")):
        known = {name for group in groups if better in group.channels for name in group.surfaces}
        for group in groups:
            if other in group.channels and known & group.surfaces:
                del group.channels[other]
                group.doubts.append(f"{other} is not used: there is {better}")


def _agree_on_names(groups, rated):
    """Makes the names of surfaces, explorers and trials agree between groups: "texture_01" or "01" everywhere."""

    def shared(item, whole, wanted):
        kept, item.whole = item.whole, whole
        count = len(wanted & set(item.values))
        item.whole = kept
        return count

    for role in ("surface", "explorer", "trial"):
        items = [item for group in groups if (item := group.field_of(role)) is not None]
        wanted = set(rated) if role == "surface" else set()
        for item in items:
            if wanted and shared(item, not item.whole, wanted) > shared(item, item.whole, wanted):
                item.whole = not item.whole
            wanted = wanted & set(item.values) or set(item.values)


def _check_names(groups, paths):
    """Adds doubts: patterns that read names otherwise than they were meant, match too much, or do not fit together."""
    sets = []
    for group in groups:
        pattern = Pattern(group.files.pattern)
        if (group.inside is not None and group.inside.fields) or "surface" not in pattern.names:
            continue
        fields = [pattern.match(name) or {} for name in group.files.names]
        names = [(one.get("surface", ""), one.get("explorer", "0"), one.get("trial", "0")) for one in fields]
        meant = group.field_of("surface").values
        wrong = [i for i, name in enumerate(names) if name[0] != meant[i]]
        if wrong:
            group.doubts.append(
                f"the pattern reads the surface of {group.files.names[wrong[0]]} as {names[wrong[0]][0]!r}: rename the "
                "files so that it can find where a name ends"
            )
        if len(set(names)) < len(names):
            group.doubts.append("several files have the same surface, explorer and trial")
        others = [path for path in paths if path not in set(group.files.names) and pattern.match(path)]
        if others:
            group.doubts.append(f"the pattern matches other files, too: {', '.join(others[:3])}; make it narrower")
        sets.append((group, set(names)))
    everything = {name for _, names in sets for name in names}
    for group, names in sets:
        if alone := sorted(everything - names):
            more = f" and {len(alone) - 1} more" * (len(alone) > 1)
            group.doubts.append(f"there is no file of {'/'.join(alone[0])}{more}")


def _check_lengths(groups):
    """Adds a doubt where the force and the motion of a recording differ in length: then a rate is wrong."""
    known = [group for group in groups if group.seconds]
    for group in known:
        longest = max(other.seconds for other in known if other is group or other.surfaces & group.surfaces)
        if group.seconds < SHORTEST_SHARE * longest:
            group.doubts.append(f"lasts {group.seconds:.3g} s, others {longest:.3g} s: is the rate right?")


def _check_headers(root, group):
    """Adds a doubt if some csv files have other columns than the first: one odd batch is seen by chance only."""
    known = {facts.table.path: facts.table.names for facts in group.tables}
    usual, odd = group.first.table.names, {}
    for name in group.files.names:
        try:
            names = known.get(root / name) or read_table(root / name, "csv", max_rows=HEADER_ROWS).names
        except (ValueError, OSError):  # the conversion says why
            continue
        if names and names != usual:
            odd[name] = names
    if odd:
        more = f" and {len(odd) - 3} more" if len(odd) > 3 else ""
        group.doubts.append(
            f"{len(odd)} of {len(group.files.names)} files have other columns: {', '.join(list(odd)[:3])}{more}; the "
            f"first of them has {', '.join(next(iter(odd.values())))}. Give them a [[files]] of their own, with `where`"
        )


def _doubt_together(inventory):
    held = {name for group in inventory.recorded for name in group.channels}
    if not held & {"force", "lateral"}:
        inventory.doubts.append("no force was recognised")
    if "force" in held and not held & {"position", "velocity"}:
        inventory.doubts.append("no position or velocity was recognised: the sliding direction is unknown")
    if inventory.ratings is None:
        inventory.doubts.append("no ratings were recognised")
    unopened = [g for g in inventory.groups if not g.tables and not set(g.files.names) & set(inventory.files.skipped)]
    if unopened:
        inventory.doubts.append(f"{len(unopened)} kinds of tables were not opened: {MOST_OPENED} files are at most")
    if inventory.files.truncated:
        inventory.doubts.append(
            "the folder has more files than are listed; what does not vary in the names of these may in the others"
        )

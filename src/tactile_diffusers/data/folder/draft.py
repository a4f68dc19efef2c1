"""Looks at anyone's folder of recordings and drafts its `layout.toml`.

Names of files become patterns, a few files of each pattern are opened, and what their columns probably are is guessed
from names, units and numbers. Every guess is told; what cannot be guessed is marked TODO in the draft, and a layout
with a TODO is refused.
"""

from dataclasses import dataclass, field
from pathlib import Path

from .draft_channels import agree_on_names, check_lengths, check_names, choose_channels, find_channels
from .draft_groups import MOST_OPENED, TableGroup, open_groups
from .draft_headers import check_headers
from .draft_listing import listing
from .draft_ratings import RatingsGuess, guess_ratings, surface_names
from .draft_text import layout_text
from .draft_walk import FileList, list_files


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
            find_channels(group)
    choose_channels(inventory.recorded)
    surfaces = _surfaces(inventory)
    guesses = [guess_ratings(guess.group, set(surfaces)) for guess in guesses]  # again: now the surfaces are known
    if guesses:
        inventory.ratings = max(guesses, key=lambda guess: (len(guess.axes), len(guess.surfaces)))
    others = [guess.group.place for guess in guesses if guess is not inventory.ratings]
    if others:
        inventory.ratings.doubts.append(f"more tables look like ratings and are not used: {', '.join(others)}")
    rated = inventory.ratings.surfaces if inventory.ratings else []
    agree_on_names(inventory.recorded, rated)
    check_names(inventory.recorded, list(inventory.files.files))
    check_lengths(inventory.recorded)
    check_headers(root, inventory.recorded)
    inventory.surface_names = surface_names(rated, _surfaces(inventory))
    _doubt_together(inventory)
    return inventory


def draft_layout(inventory):
    """Drafts a `layout.toml`: what was inferred with the evidence, and "TODO: ..." where nothing tells.

    Always to be filled in are the licence, the source, and which word the largest answer on each axis means.

    Args:
        inventory (`FolderInventory`): of `inspect_folder`.

    Returns:
        `str`: TOML. `load_layout` refuses it, naming the key, until no TODO is left.
    """
    return layout_text(inventory)


def _surfaces(inventory):
    """Names of recorded surfaces, of the kind of file that has most of them."""
    items = [item for group in inventory.recorded if (item := group.field_of("surface")) is not None]
    return max((item.distinct for item in items), key=len, default=[])


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

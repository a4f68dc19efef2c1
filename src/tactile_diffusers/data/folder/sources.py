"""Patterns of paths, and which file of a folder holds which channel of which recording."""

import difflib
import os
import re
import unicodedata
from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path

from .tables import few, paths_inside, read_table

#: Files of other programs, not of the person who recorded.
HIDDEN_PREFIXES = (".", "__", "~$")
#: Rows that are read of the first file of each kind, to see its columns before anything is converted.
GLANCE_ROWS = 100
_PARTS = re.compile(r"\{([^{}]*)\}|\*")
_FIELD = re.compile(r"[A-Za-z]\w*(\.\w+)?")


@dataclass(frozen=True)
class Pattern:
    """Matches paths written with "/" and reads the named fields.

    `{name}` stands for one or more characters without "/", as few as possible, and `*` for any number of them. A name
    that occurs twice must have the same value in both places. `{trial.speed}_{trial.force}` makes one field `trial` of
    several parts, joined by "_".

    Args:
        text (`str`): the pattern, relative.

    Raises:
        ValueError: if a field has no valid name, or the path is absolute or leaves its folder.
    """

    text: str
    fields: tuple[str, ...] = field(init=False)
    _regex: re.Pattern = field(init=False, repr=False, compare=False)

    def __post_init__(self):
        if not self.text or self.text.startswith("/") or "\\" in self.text or ".." in self.text.split("/"):
            raise ValueError("must be a relative path written with '/' and without '..'")
        fields, regex, end = {}, "", 0
        for part in _PARTS.finditer(self.text):
            regex += re.escape(self.text[end : part.start()])
            end = part.end()
            name = part.group(1)
            if name is None:
                regex += "[^/]*"
            elif not _FIELD.fullmatch(name):
                raise ValueError(f"{{{name}}} is no name for a field, write for example {{surface}}")
            else:
                group = name.replace(".", "__")
                regex += f"(?P={group})" if name in fields else f"(?P<{group}>[^/]+?)"
                fields[name] = True
        regex += re.escape(self.text[end:])
        if set("{}") & set(_PARTS.sub("", self.text)):
            raise ValueError("has a brace without its partner")
        object.__setattr__(self, "fields", tuple(fields))
        object.__setattr__(self, "_regex", re.compile(regex))

    @property
    def names(self):
        """Names of the fields, parts joined: a tuple in the order of appearance."""
        return tuple(dict.fromkeys(name.partition(".")[0] for name in self.fields))

    @property
    def literal(self):
        """Whether it matches its own text only."""
        return not _PARTS.search(self.text)

    def match(self, path, surfaces=()):
        """The fields of a path: `dict[str, str]`, or `None`; `{surface}` is one of the names `surfaces` if one fits."""
        # whatever joins the words: "Felt 2" fits "Felt_2"
        words = (re.split("[ _-]+", name) for name in sorted(surfaces, key=lambda name: (-len(name), name)))
        known = "".join("[ _-]+".join(map(re.escape, name)) + "|" for name in words)
        regex = self._regex.pattern.replace("(?P<surface>", f"(?P<surface>{known}", 1)
        found = re.fullmatch(regex, path)
        if found is None:
            return None
        values = {}
        for name in self.fields:
            value = found.group(name.replace(".", "__"))
            # macOS stores "é" as two characters: one spelling, so that names compare
            values.setdefault(name.partition(".")[0], []).append(unicodedata.normalize("NFC", value))
        return {name: "_".join(parts) for name, parts in values.items()}


@dataclass(eq=False)
class Source:
    """One table: a file, or a place inside one, with what the layout says about it."""

    files: object  # `FilesLayout` or `RatingsLayout`
    path: Path
    inside: str | None

    @property
    def where(self):
        return str(self.path) if self.inside is None else f"{self.path} [{self.inside}]"

    def table(self, **options):
        """Opens it as a `Table`, with `options` of `read_table` before those of the layout."""
        options = {name: getattr(self.files, name) for name in ("kind", "delimiter", "header")} | options
        return read_table(self.path, inside=self.inside, **options)


def files_below(root):
    """Relative paths, written with "/", of all files below a folder that are not hidden: sorted `list[str]`."""
    if not root.is_dir():
        raise FileNotFoundError(f"There is no folder {root}.")
    found = []
    for place, folders, names in os.walk(root):
        folders[:] = [name for name in folders if not name.startswith(HIDDEN_PREFIXES)]
        here = Path(place).relative_to(root)
        found += [(here / name).as_posix() for name in names if not name.startswith(HIDDEN_PREFIXES)]
    return sorted(found)


def matching_places(root, paths, entry, where, surfaces=()):
    """Tables that an entry of a layout describes: list of file, place inside or `None`, and the named fields."""
    found, pattern, inside = [], entry.pattern, entry.place
    matched = [(path, fields) for path in paths if (fields := pattern.match(path, surfaces)) is not None]
    for path, fields in matched:
        if inside is None or inside.literal:
            found.append((root / path, inside and inside.text.strip("/"), fields))
            continue
        for place in paths_inside(root / path, entry.kind):
            more = inside.match(place, surfaces)
            if more is not None and all(fields.get(name, value) == value for name, value in more.items()):
                found.append((root / path, place, fields | more))
    if not matched:
        near = difflib.get_close_matches(pattern.text, paths, n=3, cutoff=0.3) or paths[:3]
        hint = f"; the nearest are {near}" if near else ""
        raise ValueError(
            f"{where}, `pattern` = {pattern.text!r} matches none of the {len(paths)} files in {root}{hint}."
        )
    if not found:
        path = root / matched[0][0]
        places = few([place for place in paths_inside(path, entry.kind) if place], 5)
        raise ValueError(f"{where}: {inside.text!r} matches no place inside {path}, which has {places}.")
    return found


def find_recordings(root, layout, surfaces=()):
    """Joins files to recordings, names of rated `surfaces` first, and looks at the columns of each kind's first file.

    Returns:
        `tuple[dict, dict]`: (surface, explorer, trial) -> channel -> `Source`, and name -> reason of what lacks a file.

    Raises:
        FileNotFoundError: if there is no folder.
        ValueError: if a pattern matches nothing, a channel of a recording has two files, a column is missing, or no
            recording is complete.
    """
    paths = files_below(root)
    recordings, claimed = defaultdict(dict), defaultdict(set)
    for number, files in sorted(enumerate(layout.files, 1), key=lambda entry: not entry[1].where):
        where = f"{layout.path}: [[files]] {number}"
        places = _meant(matching_places(root, paths, files, where, surfaces), files, where, claimed)
        for path, inside, fields in places:
            name = fields["surface"], fields.get("explorer", "0"), fields.get("trial", "0")
            _add(recordings[name], Source(files, path, inside), name, where)
        if places:
            _check_columns(Source(files, *places[0][:2]), where)
    complete, left_out = {}, {}
    for name in sorted(recordings):
        missing = _missing(recordings[name])
        if missing:
            left_out["/".join(name)] = f"no file with {missing}"
        else:
            complete[name] = recordings[name]
    if not complete:
        name, reason = next(iter(left_out.items()))
        raise ValueError(
            f"{layout.path}: no recording in {root} has all its files; {name}, for example, has {reason}. Names found: "
            f"{few(left_out, 5)}. Let the fields of the patterns agree between the kinds of files."
        )
    return complete, left_out


def _meant(places, files, where, claimed):
    """The places that an entry means: those that fit its `where`, or those that no entry with `where` `claimed`."""
    if not files.where:
        return [place for place in places if not claimed[place[:2]] & set(files.channels)]
    meant = [
        (path, inside, fields | files.where)
        for path, inside, fields in places
        if all(fields.get(name, value) == value for name, value in files.where.items())
    ]
    if not meant:
        raise ValueError(f"{where}: no file that `pattern` matches has `where` = {files.where}.")
    for path, inside, _ in meant:
        claimed[path, inside] |= set(files.channels)
    return meant


def _add(channels, source, name, where):
    """Adds a source to the channels of a recording; force and lateral, position and velocity exclude each other."""
    rivals = {"force": "lateral", "lateral": "force", "position": "velocity", "velocity": "position"}
    for channel in source.files.channels:
        taken = channels.get(channel) or channels.get(rivals[channel])
        if taken:
            raise ValueError(
                f"{where}: recording {'/'.join(name)} has two files for its {channel}: {taken.where} and "
                f"{source.where}. Make the pattern narrower, or make what distinguishes them part of a name: "
                "{trial.speed}_{trial.repeat} joins two fields to one trial."
            )
        channels[channel] = source


def _missing(channels):
    if not channels.keys() & {"force", "lateral"}:
        return "force or lateral"
    if "force" in channels and not channels.keys() & {"position", "velocity"}:
        return "position or velocity"
    return None


def _check_columns(source, where):
    table = source.table(max_rows=GLANCE_ROWS)
    try:
        for column in source.files.columns:
            table.name(column)
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from error
    if source.files.rate is None and source.files.time is None and table.rate is None:
        raise ValueError(f"{where}: `rate` is missing, there is no `time`, and {source.where} does not tell its rate.")

"""Which channel of a recording each group of tables probably holds, and which names belong together: a guess."""

from .clocks import SHORTEST_SHARE
from .draft_names import assign_roles
from .patterns import Pattern


def find_channels(group):
    """Sets the channels of a group from its columns, and the roles of its names; adds doubts."""
    channels = _channels(group)
    if not channels:
        return
    group.channels = channels
    group.doubts += assign_roles(group.fields) + group.first.doubts
    if group.field_of("surface") is None:
        group.doubts.append("no part of the names is the surface")
    if "force" in channels:
        _doubt_normal(group)
    _doubt_tables(group)


def _channels(group):
    facts, channels = group.first, {}
    force, lateral = facts.measuring("force"), facts.measuring("lateral")
    if {"x", "y", "z"} <= force.keys():
        channels["force"] = {axis: force[axis] for axis in "xyz"}
    elif group.kind == "wav" and "sound" not in group.words:
        channels["lateral"] = {"": facts.columns[0]}
    else:
        along = lateral.get("") or force.get("x") or force.get("")
        if along is not None:
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


def _doubt_normal(group):
    mean = {axis: column.mean for axis, column in group.channels["force"].items()}
    largest = max(mean, key=lambda axis: abs(mean[axis]))
    if abs(mean[largest]) > abs(mean["z"]):
        group.doubts.append(
            f"the mean force is largest in {group.channels['force'][largest].name} ({mean[largest]:.3g}), not in z "
            f"({mean['z']:.3g}): is z the normal force?"
        )


def _doubt_tables(group):
    names = {tuple(facts.table.names) for facts in group.tables}
    if len(names) > 1 and group.kind != "csv":  # of these every file is asked
        group.doubts.append("columns differ between the files that were opened")
    rates = [facts.rate for facts in group.tables if facts.rate]
    if rates and max(rates) > 1.01 * min(rates):
        refused = ": preparation will refuse this; resample to one rate (`resample` = Hz)"
        group.doubts.append(
            f"rates differ between files: {min(rates):.6g} to {max(rates):.6g} Hz"
            + refused * bool(group.channels.keys() & {"force", "lateral"})
        )


def choose_channels(groups):
    """Leaves each surface one force and one motion: `force` before `lateral`, `velocity` before `position`."""
    for better, other in (("force", "lateral"), ("velocity", "position")):
        known = {name for group in groups if better in group.channels for name in _surfaces(group)}
        for group in groups:
            if other in group.channels and known & _surfaces(group):
                del group.channels[other]
                group.doubts.append(f"{other} is not used: there is {better}")


def _surfaces(group):
    surface = group.field_of("surface")
    return set(surface.bare) if surface is not None else set()


def agree_on_names(groups, rated):
    """Makes the names of surfaces, explorers and trials agree between groups: "texture_01" or "01" everywhere.

    Args:
        groups (`list[TableGroup]`): with channels.
        rated (`list[str]`): names of surfaces in the ratings.
    """
    for role in ("surface", "explorer", "trial"):
        items = [item for group in groups if (item := group.field_of(role)) is not None]
        wanted = set(rated) if role == "surface" else set()
        for item in items:
            if wanted:
                item.whole = max((item.whole, not item.whole), key=lambda whole: _shared(item, whole, wanted))
            wanted = wanted & set(item.values) or set(item.values)


def _shared(item, whole, wanted):
    kept, item.whole = item.whole, whole
    shared = len(wanted & set(item.values))
    item.whole = kept
    return shared


def check_lengths(groups):
    """Adds a doubt where the force and the motion of a recording differ in length: then a rate is wrong."""
    known = [group for group in groups if group.seconds]
    for group in known:
        longest = max(other.seconds for other in known if other is group or _surfaces(other) & _surfaces(group))
        if group.seconds < SHORTEST_SHARE * longest:
            group.doubts.append(f"lasts {group.seconds:.3g} s, others {longest:.3g} s: is the rate right?")


def recording_names(group):
    """(surface, explorer, trial) of each file, as the pattern reads them; `None` where a place inside matters."""
    if group.inside is not None and group.inside.fields:
        return None
    pattern = Pattern(group.files.pattern)
    if "surface" not in pattern.names:
        return None
    fields = [pattern.match(name) or {} for name in group.files.names]
    return [(one.get("surface", ""), one.get("explorer", "0"), one.get("trial", "0")) for one in fields]


def check_names(groups, paths):
    """Adds doubts: patterns that read names otherwise than they were meant, match too much, or do not fit together.

    Args:
        groups (`list[TableGroup]`): with channels.
        paths (`list[str]`): all files.
    """
    sets = []
    for group in groups:
        names = recording_names(group)
        if names is None:
            continue
        surface = group.field_of("surface")
        wrong = [i for i, name in enumerate(names) if name[0] != surface.values[i]]
        if wrong:
            group.doubts.append(
                f"the pattern reads the surface of {group.files.names[wrong[0]]} as {names[wrong[0]][0]!r}: rename the "
                "files so that it can tell where a name ends"
            )
        if len(set(names)) < len(names):
            group.doubts.append("several files have the same surface, explorer and trial")
        pattern = Pattern(group.files.pattern)
        own = set(group.files.names)
        others = [path for path in paths if path not in own and pattern.match(path)]
        if others:
            group.doubts.append(f"the pattern matches other files, too: {', '.join(others[:3])}; make it narrower")
        sets.append((group, set(names)))
    for group, names in sets:
        alone = sorted({name for _, other in sets for name in other} - names)
        if alone:
            group.doubts.append(
                f"there is no file of {'/'.join(alone[0])}" + f" and {len(alone) - 1} more" * (len(alone) > 1)
            )

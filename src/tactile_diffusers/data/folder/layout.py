"""`layout.toml`: how a folder of recordings becomes `recordings.h5`.

    format = "tactile-layout"
    version = 1
    source = "our tribometer, 2024"
    licence = "CC BY 4.0"

    [[files]]                  # one table a kind of file; files of one (surface, explorer, trial) are one recording
    pattern = "{surface}/P{explorer}_{trial}_force.csv"
    rate = 10000               # Hz
    time = { column = "t", unit = "s" }
    force = { x = "Fx", y = "Fy", z = "Fz", unit = "N", normal_sign = -1 }

    [[files]]
    pattern = "{surface}/P{explorer}_{trial}_stage.csv"
    time = { column = "t", unit = "ms" }
    offset = 0.0               # s, added to this file's time: set it from the lag that the conversion reports
    position = { x = "px", y = "py", unit = "mm" }

    [velocity]                 # of the Savitzky-Golay filter that makes velocity from position
    window = 0.05              # s
    order = 2

    [ratings]
    pattern = "ratings.csv"
    form = "long"
    rater = "participant"
    surface = "texture"
    scale = [0, 8]
    missing = ["", "NA"]
    [ratings.axes]
    roughness = { column = "rough-smooth", high = "smooth" }

    [surface_names]            # name in the ratings = name in the recordings
    "Sandpaper P80" = "12"

The classes below say what each key means. A value that holds "TODO" is still to be filled in.
Files of a batch that differ in columns or units get a [[files]] of their own, with, for example,
`where = { surface = "denim", explorer = "02" }`; entries without `where` leave them to it.
"""

import math
import tomllib
from dataclasses import dataclass, field
from pathlib import Path

from ...io.reading import reading
from .keys import Keys, refuse_todo
from .patterns import Pattern
from .rating_layout import RatingsLayout, rating_keys
from .table_layout import table_keys

FORMAT = "tactile-layout"
VERSION = 1
#: Of a line: tomllib takes the square of a key's length, minutes for 200 kB of dots.
LONGEST_LINE = 10_000
#: N per unit of force; "1" = uncalibrated counts.
FORCE_SCALES = {"N": 1.0, "mN": 1e-3, "gf": 9.80665e-3, "1": 1.0}
#: mm per unit of position, and mm/s per unit of velocity.
LENGTH_SCALES = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "um": 1e-3}
SPEED_SCALES = {"mm/s": 1.0, "cm/s": 10.0, "m/s": 1000.0}
#: s per unit of time.
TIME_SCALES = {"s": 1.0, "ms": 1e-3, "us": 1e-6}


@dataclass(frozen=True)
class TimeColumn:
    """Column (name, or index from 0) with time stamps, and s per unit of it."""

    column: str | int
    scale: float


@dataclass(frozen=True)
class Channel:
    """One measured quantity in a file.

    Attributes:
        columns (`tuple`): names or indices from 0: x, y, z of `force`, one of `lateral`, x and perhaps y of the others.
        unit (`str`): as written.
        scale (`float`): what turns a number of the file into N, mm or mm/s; for counts into counts.
        normal_sign (`int`): of `force`: 1 if pressing is positive in z, -1 if it is negative.
    """

    columns: tuple
    unit: str
    scale: float
    normal_sign: int = 1


@dataclass(frozen=True)
class FilesLayout:
    """One `[[files]]`: files of one kind. At least one of the four channels is there.

    Attributes:
        pattern (`Pattern`): relative path with `{surface}` and perhaps `{explorer}` and `{trial}` (default "0"); other
            fields and `*` are ignored.
        kind (`str`): of `tables.KINDS`; default: by the extension.
        where (`tuple[tuple[str, str], ...]`): values of surface, explorer, trial: other files of the pattern are not
            meant; a field that the pattern lacks has this value. Entries without `where` leave these files out.
        inside (`Pattern` or `None`): `inside` of mat, hdf5 and npz, `sheet` of xlsx; may hold the fields, too.
        delimiter, header: of `tables.read_table`.
        rate (`float` or `None`): Hz; default: from `time`, or what the file itself says.
        resample (`float` or `None`): whole Hz to which the force is brought, where files differ in rate; going up adds
            nothing above half of the old rate.
        time (`TimeColumn` or `None`): the time stamps.
        offset (`float`): s, added to the time of these files.
        force, lateral, position, velocity (`Channel` or `None`): what they hold.
    """

    pattern: Pattern
    kind: str
    where: tuple = ()
    inside: Pattern | None = None
    delimiter: str | None = None
    header: int | None = None
    rate: float | None = None
    resample: float | None = None
    time: TimeColumn | None = None
    offset: float = 0.0
    force: Channel | None = None
    lateral: Channel | None = None
    position: Channel | None = None
    velocity: Channel | None = None

    @property
    def channels(self):
        """Names of the channels that these files hold."""
        return tuple(name for name in ("force", "lateral", "position", "velocity") if getattr(self, name))

    @property
    def columns(self):
        """All columns that are read."""
        time = (self.time.column,) if self.time else ()
        return time + tuple(column for name in self.channels for column in getattr(self, name).columns)


@dataclass(frozen=True)
class VelocityLayout:
    """Window (s) and order of the Savitzky-Golay filter that makes velocity from position."""

    window: float = 0.05
    order: int = 2


@dataclass(frozen=True)
class Layout:
    """A whole `layout.toml`.

    Attributes:
        path (`Path`): of the file, for messages.
        source, licence (`str`): go to the attributes of recordings.h5.
        files (`tuple[FilesLayout, ...]`): at least one, at least one of them with `force` or `lateral`.
        velocity (`VelocityLayout`): of the filter.
        ratings (`RatingsLayout` or `None`): the answers.
        surface_names (`dict[str, str]`): name in the ratings -> name in the recordings.
    """

    path: Path
    source: str
    licence: str
    files: tuple[FilesLayout, ...]
    velocity: VelocityLayout = VelocityLayout()
    ratings: RatingsLayout | None = None
    surface_names: dict = field(default_factory=dict)


def load_layout(path):
    """Reads and checks a `layout.toml`.

    Args:
        path (`str` or `Path`): the file.

    Returns:
        `Layout`.

    Raises:
        FileNotFoundError: if there is no file.
        ValueError: naming file, key, value and remedy.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"There is no layout {path}.")
    with reading(path, "TOML", "Correct it."):
        text = path.read_text(encoding="utf-8-sig")
        if max(map(len, text.splitlines()), default=0) > LONGEST_LINE:
            raise ValueError(f"a line has more than {LONGEST_LINE} characters")
        content = tomllib.loads(text)
    refuse_todo(path, content)
    top = Keys(path, "", content)
    if (top.take("format", str), top.take("version", int)) != (FORMAT, VERSION):
        top.fail("format", f'must be "{FORMAT}" with version = {VERSION}: this is no layout of that version')
    layout = Layout(
        path=path,
        source=top.take("source", str),
        licence=top.take("licence", str),
        files=tuple(_files(keys) for keys in top.tables("files")),
        velocity=_velocity(top.table("velocity")),
        ratings=rating_keys(ratings) if (ratings := top.table("ratings")) else None,
        surface_names=dict(top.take("surface_names", dict, {})),
    )
    top.finish()
    _check_together(layout, top)
    return layout


def _files(keys):
    table, where = table_keys(keys), _where(keys.table("where"))
    if "surface" not in dict(where) and not any(
        "surface" in pattern.names for pattern in (table["pattern"], table["inside"]) if pattern
    ):
        text = table["pattern"].text
        keys.fail("pattern", f"= {text!r} must hold {{surface}}, unless `inside`, `sheet` or `where` does")
    time = keys.table("time")
    files = FilesLayout(
        **table,
        where=where,
        rate=_positive(keys, "rate", None),
        resample=_positive(keys, "resample", None),
        time=_time(time) if time else None,
        offset=_finite(keys, "offset", 0.0),
        force=_channel(keys.table("force"), ("x", "y", "z"), FORCE_SCALES),
        lateral=_channel(keys.table("lateral"), ("column",), FORCE_SCALES),
        position=_channel(keys.table("position"), ("x", "y"), LENGTH_SCALES),
        velocity=_channel(keys.table("velocity"), ("x", "y"), SPEED_SCALES),
    )
    if not files.channels:
        keys.fail("force", "is missing: give `force`, `lateral`, `position` or `velocity`")
    if files.resample is not None and (files.resample % 1 or not {"force", "lateral"} & set(files.channels)):
        keys.fail("resample", f"= {files.resample} must be a whole number of Hz, of files with `force` or `lateral`")
    for one, other in (("force", "lateral"), ("position", "velocity")):
        if one in files.channels and other in files.channels:
            keys.fail(one, f"and `{other}` exclude each other: remove one of them")
    keys.finish()
    return files


def _where(keys):
    if keys is None:
        return ()
    values = {name: keys.take(name, str, None) for name in ("surface", "explorer", "trial")}
    keys.finish()
    return tuple((name, value) for name, value in values.items() if value is not None)


def _positive(keys, name, default):
    value = keys.take(name, float, default)
    if value is not None and not 0 < value < math.inf:
        keys.fail(name, f"= {value} must be a positive number")
    return value


def _finite(keys, name, default):
    value = keys.take(name, float, default)
    if not math.isfinite(value):
        keys.fail(name, f"= {value} must be a finite number")
    return value


def _time(keys):
    column, unit = keys.take("column", (str, int)), keys.choice("unit", tuple(TIME_SCALES))
    keys.finish()
    return TimeColumn(column, TIME_SCALES[unit])


def _channel(keys, names, scales):
    if keys is None:
        return None
    optional = names == ("x", "y")  # a stage may move along one axis only
    columns = [keys.take(name, (str, int), *((None,) if optional and name == "y" else ())) for name in names]
    columns = tuple(column for column in columns if column is not None)
    if len(set(columns)) < len(columns):
        keys.fail(names[-1], f"= {columns[-1]!r} is the column of another axis, too")
    unit = keys.choice("unit", tuple(scales))
    sign = keys.take("normal_sign", int, 1) if names == ("x", "y", "z") else 1
    if sign not in (1, -1):
        keys.fail("normal_sign", f"= {sign} must be 1 (pressing is positive in z) or -1 (negative)")
    scale = _positive(keys, "scale", 1.0) if names == ("column",) else 1.0
    keys.finish()
    return Channel(columns, unit, scale * scales[unit], sign)


def _velocity(keys):
    if keys is None:
        return VelocityLayout()
    velocity = VelocityLayout(_positive(keys, "window", 0.05), keys.take("order", int, 2))
    if not velocity.order >= 1:
        keys.fail("order", f"= {velocity.order} must be at least 1, or there is no slope")
    keys.finish()
    return velocity


def _check_together(layout, top):
    held = {name for files in layout.files for name in files.channels}
    if not held & {"force", "lateral"}:
        top.fail("files", "hold neither `force` nor `lateral`")
    if "force" in held and not held & {"position", "velocity"}:
        top.fail(
            "files",
            "hold `force` without `position` or `velocity`: the sliding direction is unknown. If x is the "
            "sliding direction, give it as `lateral`",
        )
    units = {channel.unit for files in layout.files for channel in (files.force, files.lateral) if channel}
    if "1" in units and len(units) > 1:
        top.fail("files", f"hold forces in {sorted(units)}: keep counts and newtons in two layouts")
    for name in layout.surface_names.items():
        if not all(isinstance(text, str) for text in name):
            top.fail("surface_names", f"{name[0]!r} = {name[1]!r} must be a text")

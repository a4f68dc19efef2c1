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
    offset = 0.0               # s, added to this file's time, where its clock began apart
    position = { x = "px", y = "py", unit = "mm" }

    [velocity]                 # Savitzky-Golay filter: velocity from position
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

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PlainValidator,
    PrivateAttr,
    field_validator,
    model_validator,
)

from ...signal import RATING_AXES
from .sources import Pattern
from .tables import KINDS, TREE_KINDS, kind_of

FORMAT = "tactile-layout"
VERSION = 1
#: What a value or name holds that is still to be filled in.
TODO = "TODO"
#: s per unit of time; N per unit of force, where "1" = uncalibrated counts; mm and mm/s per unit of motion.
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
FORCE_UNITS = {"N": 1.0, "mN": 1e-3, "gf": 9.80665e-3, "1": 1.0}
LENGTH_UNITS = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "um": 1e-3}
SPEED_UNITS = {"mm/s": 1.0, "cm/s": 10.0, "m/s": 1000.0}
#: The units of each channel.
CHANNEL_UNITS = {"force": FORCE_UNITS, "lateral": FORCE_UNITS, "position": LENGTH_UNITS, "velocity": SPEED_UNITS}
#: The words at 0 and at 8 of our axes (pairs of SENS3, arXiv 2401.01818).
AXIS_WORDS = dict(zip(RATING_AXES, (("smooth", "rough"), ("flat", "bumpy"), ("sticky", "slippery")), strict=True))


def _column(value):
    if not isinstance(value, str) and (type(value) is not int or value < 0):
        raise ValueError("must be the name of a column, or its number from 0")
    return value


def _pattern(value):
    if not isinstance(value, str):
        raise ValueError("must be a text")
    return Pattern(value)


Column = Annotated[Any, PlainValidator(_column)]
PatternText = Annotated[Pattern, BeforeValidator(_pattern)]
Positive = Annotated[float, Field(gt=0)]
Pair = Field(min_length=2, max_length=2)


class _Keys(BaseModel):
    """A table of which every key is known and of the right type."""

    model_config = ConfigDict(
        extra="forbid", strict=True, frozen=True, allow_inf_nan=False, arbitrary_types_allowed=True
    )


class _Measured(_Keys):
    """Columns with a unit."""

    @model_validator(mode="after")
    def _check_columns(self):
        if len(set(self.columns)) < len(self.columns):
            raise ValueError(f"the columns {list(self.columns)} must differ")
        return self

    @property
    def columns(self):
        """Names or indices of the columns: of x, y, z; of x and perhaps y; or one."""
        named = (getattr(self, name, None) for name in ("column", "x", "y", "z"))
        return tuple(column for column in named if column is not None)

    @property
    def scale(self):
        """s, N (or counts), mm or mm/s per number of the file."""
        units = TIME_UNITS | FORCE_UNITS | LENGTH_UNITS | SPEED_UNITS
        return getattr(self, "factor", 1.0) * units[self.unit]


class TimeColumn(_Measured):
    """Time stamps."""

    column: Column
    unit: Literal[tuple(TIME_UNITS)]


class Force(_Measured):
    """Contact force, x and y along the surface; `normal_sign` is 1 if pressing is positive in z, -1 if negative.

    Without y, of a sensor of two axes, the finger moves along x.
    """

    x: Column
    y: Column | None = None
    z: Column
    unit: Literal[tuple(FORCE_UNITS)]
    normal_sign: Literal[1, -1] = 1


class Lateral(_Measured):
    """Force along the sliding direction; `scale` multiplies the numbers, such as N at full scale of a sound file."""

    column: Column
    unit: Literal[tuple(FORCE_UNITS)]
    factor: Positive = Field(1.0, alias="scale")


class Position(_Measured):
    """Position of the finger; a stage may move along x only."""

    x: Column
    y: Column | None = None
    unit: Literal[tuple(LENGTH_UNITS)]


class Velocity(Position):
    """Velocity of the finger, likewise."""

    unit: Literal[tuple(SPEED_UNITS)]


class _Tables(_Keys):
    """Which files are meant, and how their tables are stored.

    Attributes:
        pattern (`Pattern`): relative path with the fields; `*` and fields of other names are ignored.
        kind (`str`): of `tables.KINDS`; default: by the extension.
        inside, sheet (`Pattern` or `None`): place inside of mat, hdf5 and npz, or of xlsx; may hold the fields, too.
        delimiter (`str` or `None`), header (`int` or `None`): of `tables.read_table`.
    """

    pattern: PatternText
    kind: Literal[tuple(sorted(set(KINDS.values())))]
    inside: PatternText | None = None
    sheet: PatternText | None = None
    delimiter: Annotated[str, Field(min_length=1, max_length=1)] | None = None
    header: Annotated[int, Field(ge=0)] | None = None

    @model_validator(mode="before")
    @classmethod
    def _kind_by_extension(cls, content):
        if isinstance(content, dict) and isinstance(content.get("pattern"), str):
            return {"kind": kind_of(content["pattern"])} | content
        return content

    @model_validator(mode="after")
    def _check_places(self):
        for name, kinds in (("inside", TREE_KINDS), ("sheet", ("xlsx",))):
            if getattr(self, name) is not None and self.kind not in kinds:
                raise ValueError(f"`{name}` is for {', '.join(kinds)}, not for {self.kind}: remove it")
        return self

    @property
    def place(self):
        """`inside` or `sheet`."""
        return self.inside or self.sheet

    @property
    def names(self):
        """Names of the fields in the pattern and the place inside."""
        return self.pattern.names + (self.place.names if self.place else ())


class FilesLayout(_Tables):
    """One `[[files]]`: files of one kind. At least one of the four channels is there.

    Attributes:
        where (`dict[str, str]`): values of surface, explorer, trial: other files of the pattern are not meant; a field
            that the pattern lacks has this value. Entries without `where` leave these files out. `{surface}` must be
            in the pattern, in the place inside or here; `{explorer}` and `{trial}` are "0" by default.
        rate (`float` or `None`): Hz; default: from `time`, or what the file itself says.
        resample (`float` or `None`): whole Hz to which the force is brought, where files differ in rate; going up adds
            nothing above half of the old rate.
        time (`TimeColumn` or `None`): the time stamps.
        offset (`float`): s, added to the time of these files.
        force, lateral, position, velocity: what they hold.
    """

    where: dict[Literal["surface", "explorer", "trial"], str] = {}
    rate: Positive | None = None
    resample: Annotated[float, Field(gt=0, multiple_of=1)] | None = None
    time: TimeColumn | None = None
    offset: float = 0.0
    force: Force | None = None
    lateral: Lateral | None = None
    position: Position | None = None
    velocity: Velocity | None = None

    @property
    def channels(self):
        """Names of the channels that these files hold."""
        return tuple(name for name in CHANNEL_UNITS if getattr(self, name))

    @property
    def columns(self):
        """All columns that are read."""
        read = [getattr(self, name) for name in ("time", *self.channels)]
        return tuple(column for measured in read if measured for column in measured.columns)

    @model_validator(mode="after")
    def _check_channels(self):
        if "surface" not in {*self.names, *self.where}:
            raise ValueError("`pattern` must hold {surface}, unless `inside`, `sheet` or `where` does")
        if not self.channels:
            raise ValueError("give `force`, `lateral`, `position` or `velocity`")
        for pair in (("force", "lateral"), ("position", "velocity")):
            if set(pair) <= set(self.channels):
                raise ValueError("`{}` and `{}` exclude each other: remove one of them".format(*pair))
        if self.resample and not {"force", "lateral"} & set(self.channels):
            raise ValueError("`resample` is for files with `force` or `lateral`")
        return self


class VelocityLayout(_Keys):
    """Window (s) and order of the Savitzky-Golay filter that makes velocity from position."""

    window: Positive = 0.05
    order: Annotated[int, Field(ge=1)] = 2


class AxisLayout(_Keys):
    """Where the answers on an axis are, its two words, and the one that the largest answer means."""

    column: Column
    high: str
    words: Annotated[list[str], Pair]


class RatingsLayout(_Tables):
    """`[ratings]`: tables of answers; the pattern may hold `{rater}`, `{surface}` and `{axis}`.

    Attributes:
        form (`str`): "long" = one row an answer, or a set of them; "wide" = one table an axis, rows x columns.
        rater, surface: long: their columns, unless in the pattern.
        axis, answer: long with one row an answer: the columns of the axis' name and of the answer.
        rows, columns: wide: "rater" and "surface" or the other way round.
        scale (`list[float]`): the smallest and largest number used; mapped linearly to 0-8.
        missing (`list[str]`): what stands for no answer.
        axes (`dict[str, AxisLayout]`): our name -> theirs. Axes beyond `RATING_AXES` keep 8 = `high`.
    """

    form: Literal["long", "wide"]
    header: Annotated[int, Field(ge=0)] = 1
    rater: Column | None = None
    surface: Column | None = None
    axis: Column | None = None
    answer: Column | None = None
    rows: Literal["rater", "surface"] | None = None
    columns: Literal["rater", "surface"] | None = None
    scale: Annotated[list[float], Pair]
    missing: list[str] = ["", "NA", "-"]
    axes: Annotated[dict[str, AxisLayout], Field(min_length=1)]

    def is_turned(self, axis):
        """Whether the largest answer on an axis means our 0."""
        return axis in AXIS_WORDS and self.axes[axis].high == AXIS_WORDS[axis][0]

    @field_validator("axes", mode="before")
    @classmethod
    def _known_words(cls, axes):
        if not isinstance(axes, dict):
            return axes
        known = {name: {"words": list(words)} for name, words in AXIS_WORDS.items()}
        return {name: known.get(name, {}) | axis if isinstance(axis, dict) else axis for name, axis in axes.items()}

    @model_validator(mode="after")
    def _check_answers(self):
        if not self.scale[0] < self.scale[1]:
            raise ValueError("`scale` must be the smallest and the largest number, such as [0, 8]")
        for name, axis in self.axes.items():
            if axis.high not in axis.words or not set(AXIS_WORDS.get(name, axis.words)) <= set(axis.words):
                pair = AXIS_WORDS.get(name, ("the two", "words of the axis"))
                raise ValueError(f"axes.{name}: `words` must be {' and '.join(pair)}, `high` one of them")
        if self.form == "wide":
            if "axis" not in self.names:
                raise ValueError('form = "wide" needs {axis} in `pattern` or `sheet`: one table an axis. Is it "long"?')
            if {self.rows, self.columns} != {"rater", "surface"}:
                raise ValueError('`rows` and `columns` must be "rater" and "surface", or the other way round')
            return self
        needed = {name: name not in self.names for name in ("rater", "surface")}
        needed["answer"] = self.axis is not None or "axis" in self.names
        for name, is_needed in needed.items():
            if is_needed != (getattr(self, name) is not None):
                remedy = "is missing: name its column" if is_needed else "is not needed here: remove it"
                raise ValueError(f"`{name}` {remedy}")
        return self


class Layout(_Keys):
    """A whole `layout.toml`.

    Attributes:
        source, licence (`str`): go to the attributes of recordings.h5.
        files (`list[FilesLayout]`): at least one, at least one of them with `force` or `lateral`.
        velocity (`VelocityLayout`): of the filter.
        ratings (`RatingsLayout` or `None`): the answers.
        surface_names (`dict[str, str]`): name in the ratings -> name in the recordings; "" = leave them out.
        path (`Path`): the file, for messages.
    """

    format: Literal[FORMAT]
    version: Literal[VERSION]
    source: str
    licence: str
    files: Annotated[list[FilesLayout], Field(min_length=1)]
    velocity: VelocityLayout = VelocityLayout()
    ratings: RatingsLayout | None = None
    surface_names: dict[str, str] = {}
    _path: Path = PrivateAttr(Path("layout.toml"))

    @property
    def path(self):
        return self._path

    @model_validator(mode="after")
    def _check_together(self):
        held = {name for files in self.files for name in files.channels}
        if not held & {"force", "lateral"}:
            raise ValueError("the files hold neither `force` nor `lateral`")
        if "force" in held and not held & {"position", "velocity"}:
            raise ValueError(
                "the files hold `force` without `position` or `velocity`: the sliding direction is unknown. If x is "
                "the sliding direction, give it as `lateral`"
            )
        units = {channel.unit for files in self.files for channel in (files.force, files.lateral) if channel}
        if "1" in units and len(units) > 1:
            raise ValueError(f"the files hold forces in {sorted(units)}: keep counts and newtons in two layouts")
        return self

"""What tables of a layout share: strict keys, columns, patterns, and how the tables of a file are stored."""

from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, PlainValidator, model_validator

from .patterns import Pattern
from .tables import KINDS, TREE_KINDS, kind_of


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


class Keys(BaseModel):
    """A table of which every key is known and of the right type."""

    model_config = ConfigDict(
        extra="forbid", strict=True, frozen=True, allow_inf_nan=False, arbitrary_types_allowed=True
    )


class TableKeys(Keys):
    """Which files are meant, and how their tables are stored.

    Attributes:
        pattern (`Pattern`): relative path with the fields; `*` and fields of other names are ignored.
        kind (`str`): of `tables.KINDS`; default: by the extension.
        inside (`Pattern` or `None`): place inside of mat, hdf5 and npz; may hold the fields, too.
        sheet (`Pattern` or `None`): likewise of xlsx.
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

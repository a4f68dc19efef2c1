"""The store of recordings, `recordings.h5`: every source of data is converted to this one file.

File attributes: `format`, `version`, `source`, `licence`. Group `/recordings/<surface>/<explorer>/<trial>` holds
`force` (n, 3) [x, y along the surface, z normal] and `velocity` (m, 2), each with attributes `rate` (Hz) and `unit`
("N", "mm/s"); both start at the same instant. A source without normal force has `lateral` (n,) instead of `force` and
may lack `velocity`; `unit` "1" means uncalibrated. The optional group `/ratings` holds `values` (raters, surfaces,
axes) on the 0-8 scale (8 = rougher, bumpier, more slippery; NaN = missing) and the names `raters`, `surfaces`, `axes`.
"""

from dataclasses import dataclass
from numbers import Real

import h5py
import numpy as np

from ..io.hdf5 import as_strings, open_whole, plain_attributes, whole_file
from ..io.reading import check_size, reading
from ..signal.constants import LEAST_RECORDING
from .force_checks import check_forces, check_ratings

FORMAT = "tactile-recordings"
VERSION = 1
#: Units of the contact force: newtons, or "1" for uncalibrated sensor counts.
FORCE_UNITS = ("N", "1")
VELOCITY_UNIT = "mm/s"
#: Channels: number of columns (None = one row of samples) and units.
_CHANNELS = {"force": ((3,), FORCE_UNITS), "lateral": ((), FORCE_UNITS), "velocity": ((2,), (VELOCITY_UNIT,))}


@dataclass
class Recording:
    """One exploration of one surface by one explorer.

    Attributes:
        surface, explorer, trial (`str`): names.
        force (`np.ndarray` or `None`): (n, 3) float32 [x, y along the surface, z normal]; NaN = missing.
        lateral (`np.ndarray` or `None`): (n,) float32, for sources without 3-D force.
        rate (`int`): Hz, of `force` or `lateral`.
        velocity (`np.ndarray` or `None`): (m, 2) float32, mm/s.
        velocity_rate (`float` or `None`): Hz.
        unit (`str`): "N", or "1" if uncalibrated.
        notes (`tuple[str, ...]`): what is suspicious about the force, see `check_forces`.
    """

    surface: str
    explorer: str
    trial: str
    force: np.ndarray | None
    lateral: np.ndarray | None
    rate: int
    velocity: np.ndarray | None
    velocity_rate: float | None
    unit: str
    notes: tuple[str, ...] = ()

    @property
    def name(self):
        return f"{self.surface}/{self.explorer}/{self.trial}"

    @property
    def samples(self):
        return len(self.force if self.force is not None else self.lateral)


@dataclass
class RaterScores:
    """Answers of raters: `values` (raters, surfaces, axes) float32 on the 0-8 scale, NaN = missing, and the names."""

    values: np.ndarray
    raters: tuple[str, ...]
    surfaces: tuple[str, ...]
    axes: tuple[str, ...]


class RecordingsWriter:
    """Writes `recordings.h5`; the file appears under its name only when the `with` block ends without an exception.

    Args:
        path (`str` or `Path`): the final name.
        source (`str`): where the data come from.
        licence (`str`): under which licence.
        **attributes: further attributes of the file (numbers or strings), for example a seed.
    """

    def __init__(self, path, source, licence, **attributes):
        self._context = whole_file(path)
        self._attributes = dict(format=FORMAT, version=VERSION, source=source, licence=licence, **attributes)

    def __enter__(self):
        self._file = self._context.__enter__()
        self._file.attrs.update(self._attributes)
        self._file.create_group("recordings")
        return self

    def __exit__(self, *exception):
        return self._context.__exit__(*exception)

    def add_recording(
        self,
        surface,
        explorer,
        trial,
        force=None,
        force_rate=None,
        velocity=None,
        velocity_rate=None,
        lateral=None,
        lateral_rate=None,
        unit="N",
    ):
        """Adds one recording; all channels start at the same instant.

        Args:
            surface, explorer, trial (`str`): names without "/".
            force (`np.ndarray`): (n, 3) [x, y along the surface, z normal] in `unit`, with `force_rate` in Hz.
            velocity (`np.ndarray`, *optional*): (m, 2) mm/s, with `velocity_rate` in Hz.
            lateral (`np.ndarray`): (n,) in `unit` instead of `force`, with `lateral_rate` in Hz.
            unit (`str`): "N", or "1" if uncalibrated.

        Raises:
            ValueError: if not exactly one of `force` and `lateral` is passed, or a rate, shape, name or unit is wrong.
        """
        if (force is None) == (lateral is None):
            raise ValueError("Give exactly one of `force` (n, 3) and `lateral` (n,).")
        for name in (surface, explorer, trial):
            if not str(name) or "/" in str(name):
                raise ValueError(f"{name!r} cannot name a surface, explorer or trial: give a name without '/'.")
        channels = {"force": (force, force_rate, unit), "lateral": (lateral, lateral_rate, unit)}
        channels["velocity"] = (velocity, velocity_rate, VELOCITY_UNIT)
        channels = {name: channel for name, channel in channels.items() if channel[0] is not None}
        for name, (values, rate, channel_unit) in channels.items():
            if problem := _problem(name, np.shape(values), rate, channel_unit):
                raise ValueError(f"`{name}`: {problem}.")
        group = self._file["recordings"].create_group(f"{surface}/{explorer}/{trial}")
        for name, (values, rate, channel_unit) in channels.items():
            dataset = group.create_dataset(name, data=np.asarray(values, dtype=np.float32))
            dataset.attrs.update(rate=float(rate), unit=channel_unit)

    def set_attributes(self, **attributes):
        """Adds attributes to the file (numbers or strings), for example a report that is known only at the end."""
        self._file.attrs.update(attributes)

    def set_ratings(self, values, raters, surfaces, axes):
        """Stores the raters' answers.

        Args:
            values (`np.ndarray`): (raters, surfaces, axes) on the 0-8 scale, NaN = missing.
            raters, surfaces, axes (`list[str]`): names; surfaces as in `add_recording`.

        Raises:
            ValueError: if the shape does not fit the names or a value lies outside the scale.
        """
        values = np.asarray(values, dtype=np.float32)
        check_ratings(values, (len(raters), len(surfaces), len(axes)), "`values`")
        group = self._file.create_group("ratings")
        group.create_dataset("values", data=values)
        for name, strings in (("raters", raters), ("surfaces", surfaces), ("axes", axes)):
            group.create_dataset(name, data=list(strings), dtype=h5py.string_dtype())


def _problem(name, shape, rate, unit):
    """What is wrong with the shape, rate or unit of a channel, and the remedy; `None` if nothing is."""
    columns, units = _CHANNELS[name]
    if not isinstance(rate, Real) or not 0 < float(rate) < np.inf:  # a long double may be less than any float
        return f"the rate must be a positive number of Hz, got {rate!r}"
    if unit not in units:
        return f"the unit must be one of {units}, got {unit!r}: convert the numbers"
    if len(shape) != 1 + len(columns) or shape[1:] != columns:
        return f"the shape must be (samples, *{columns}), got {shape}"
    return None


class RecordingsFile:
    """Reads `recordings.h5`. Iterating yields one `Recording` after the other, so that one is in memory at a time.

    The structure of the file is checked when it is opened, values are checked when a recording is read. NaN is not an
    error: preparation bridges short gaps, excludes longer ones and reports both. An infinite value becomes NaN.

    Args:
        path (`str` or `Path`): the file.

    Attributes:
        names (`list[str]`): of the recordings, "surface/explorer/trial".
        lengths (`list[int]`): samples of each recording's force.
        surfaces (`tuple[str, ...]`): names of the surfaces.
        unit (`str`): "N", or "1" if uncalibrated.
        attributes (`dict`): of the file, as plain Python values.
        ratings (`RaterScores` or `None`): the raters' answers.

    Raises:
        FileNotFoundError: if there is no file.
        ValueError: naming file, group, problem and remedy, if the file is truncated or breaks the format.
    """

    def __init__(self, path):
        self.path = path
        self._file = open_whole(path)
        try:
            with self._reading():
                self._check_structure()
                self.ratings = self._read_ratings()
        except Exception:
            self._file.close()
            raise

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        self.close()

    def close(self):
        self._file.close()

    def __len__(self):
        return len(self.names)

    def __iter__(self):
        return (self.read(name) for name in self.names)

    def _reading(self):
        return reading(self.path, "a store of recordings", "Copy it again, or write it again from its source.")

    def _fail(self, group, problem):
        raise ValueError(f"{self.path}, {group}: {problem}.")

    def _check_structure(self):
        self.attributes = plain_attributes(self._file)
        form, version = self.attributes.get("format"), self.attributes.get("version")
        if form != FORMAT or version != VERSION:
            problem = f"format={form!r}, version={version!r} instead of {FORMAT!r}, {VERSION}"
            self._fail("/", f"{problem}. Convert the source with RecordingsWriter")
        if "source" not in self.attributes:
            self._fail("/", "it lacks the attribute `source`: add where the recordings come from")
        recordings = self._file.get("recordings")
        if not isinstance(recordings, h5py.Group) or not len(recordings):
            self._fail("/recordings", "there is no recording: add at least one with RecordingsWriter")
        self.surfaces, self.names, self.lengths, units = tuple(recordings), [], [], set()
        for surface in self._subgroups(recordings):
            for explorer in self._subgroups(surface):
                for trial in self._subgroups(explorer):
                    self._check_recording(trial)
                    force = _force_of(trial)
                    self.names.append(trial.name.removeprefix("/recordings/"))
                    self.lengths.append(len(force))
                    units.add(plain_attributes(force)["unit"])
        if len(units) > 1:
            self._fail("/recordings", f"units {sorted(units)} are mixed: keep one unit per file")
        self.unit = units.pop()

    def _subgroups(self, group):
        members = list(group.values())
        if not members or not all(isinstance(member, h5py.Group) for member in members):
            self._fail(group.name, "it is not a group of groups: arrange them as /recordings/surface/explorer/trial")
        return members

    def _check_recording(self, group):
        if ("force" in group) == ("lateral" in group):
            self._fail(group.name, f"it has {sorted(group)}: store exactly one of `force` and `lateral`")
        for name in _CHANNELS:
            if name not in group:
                continue
            dataset = group[name]
            check_size(self.path, dataset.nbytes)
            attributes = plain_attributes(dataset)
            rate = attributes.get("rate")
            if problem := _problem(name, dataset.shape, rate, attributes.get("unit")):
                self._fail(dataset.name, problem)
            if dataset.dtype.kind not in "fiu":
                self._fail(dataset.name, f"it holds {dataset.dtype}, not real numbers: store it as float32")
            if name != "velocity" and rate != int(rate):
                self._fail(dataset.name, f"the rate is {rate}: resample to a whole number of Hz")
            if len(dataset) / rate < LEAST_RECORDING:
                problem = f"it lasts {len(dataset) / rate:.3g} s, the filter needs {LEAST_RECORDING} s"
                self._fail(dataset.name, f"{problem}: leave it out, or check its rate")

    def rate(self, name):
        """Rate of the force of recording `name`, Hz."""
        return int(plain_attributes(_force_of(self._file[f"recordings/{name}"]))["rate"])

    def read(self, name):
        """Reads one recording.

        Args:
            name (`str`): "surface/explorer/trial", one of `names`.

        Returns:
            `Recording`.

        Raises:
            ValueError: if the force cannot be a finger's: see `check_forces`.
        """
        with self._reading():
            group = self._file[f"recordings/{name}"]
            dataset = _force_of(group)
            values, unit = _finite(dataset), plain_attributes(dataset)["unit"]
            velocity = _finite(group["velocity"]) if "velocity" in group else None
            return Recording(
                *name.split("/"),
                force=values if "force" in group else None,
                lateral=values if "lateral" in group else None,
                rate=self.rate(name),
                velocity=velocity,
                velocity_rate=None if velocity is None else float(plain_attributes(group["velocity"])["rate"]),
                unit=unit,
                notes=tuple(check_forces(values, f"{self.path}, {dataset.name}", unit)),
            )

    def _read_ratings(self):
        if "ratings" not in self._file:
            return None
        group = self._file["ratings"]
        if missing := sorted({"values", "raters", "surfaces", "axes"} - set(group)):
            self._fail("/ratings", f"it lacks {missing}: store them, or leave out the group")
        check_size(self.path, sum(dataset.nbytes for dataset in group.values()))
        values = group["values"][()].astype(np.float32)
        names = [as_strings(group[name]) for name in ("raters", "surfaces", "axes")]
        check_ratings(values, tuple(len(strings) for strings in names), f"{self.path}, /ratings/values:")
        if unknown := sorted(set(names[1]) - set(self.surfaces)):
            self._fail("/ratings/surfaces", f"{unknown[:3]} have no recording: use the names of the groups")
        return RaterScores(values, *names)


def _force_of(group):
    return group["force" if "force" in group else "lateral"]


def _finite(dataset):
    """Values as float32; an infinite one is missing."""
    values = dataset[()].astype(np.float32, copy=False)
    values[np.isinf(values)] = np.nan
    return values

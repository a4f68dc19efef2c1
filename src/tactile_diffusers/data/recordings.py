"""The store of recordings, `recordings.h5`: every source of data is converted to this one file.

File attributes: `format`, `version`, `source`, `licence`. Group `/recordings/<surface>/<explorer>/<trial>` holds
`force` (n, 3) [x, y along the surface, z normal] and `velocity` (m, 2), each with attributes `rate` (Hz) and `unit`
("N", "mm/s"); both start at the same instant. A source without normal force has `lateral` (n,) instead of `force` and
may lack `velocity`; `unit` "1" means uncalibrated. The optional group `/ratings` holds `values` (raters, surfaces,
axes) on the 0-8 scale (8 = rougher, bumpier, more slippery; NaN = missing) and the names `raters`, `surfaces`, `axes`.
The optional group `/truth` holds what is known of the surfaces beside the recordings, for evaluation only: names
`surfaces`, and one dataset (surfaces, ...) a fact, numbers or strings. Preparation and training never read it.
"""

from dataclasses import dataclass
from numbers import Real

import h5py
import numpy as np

from ..io.hdf5 import as_strings, open_whole, plain_attributes, whole_file
from ..io.reading import check_size, reading
from ..signal import SEGMENT_SECONDS
from .checks import check_forces, check_ratings

FORMAT = "tactile-recordings"
VERSION = 1
#: Units of the contact force: newtons, or "1" for uncalibrated sensor counts.
FORCE_UNITS = ("N", "1")
VELOCITY_UNIT = "mm/s"


@dataclass
class Recording:
    """One exploration of one surface by one explorer.

    Attributes:
        surface, explorer, trial (`str`): who and what.
        force (`np.ndarray` or `None`): (n, 3) float32 [x, y along the surface, z normal]; NaN = not measured.
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


@dataclass
class SurfaceTruth:
    """What is known of surfaces beside their recordings: `fields` name -> (surfaces, ...) numbers or strings."""

    surfaces: tuple[str, ...]
    fields: dict[str, np.ndarray]


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
            ValueError: if not exactly one of `force` and `lateral` is given, or a rate, shape, name or unit is wrong.
        """
        if (force is None) == (lateral is None):
            raise ValueError("Give exactly one of `force` (n, 3) and `lateral` (n,).")
        if unit not in FORCE_UNITS:
            raise ValueError(f"`unit` must be one of {FORCE_UNITS}, got {unit!r}: convert the force to newtons.")
        channels = [("force", force, force_rate, (3,), unit), ("lateral", lateral, lateral_rate, (), unit)]
        channels.append(("velocity", velocity, velocity_rate, (2,), VELOCITY_UNIT))
        for name in (surface, explorer, trial):
            if not str(name) or "/" in str(name):
                raise ValueError(f"{name!r} cannot name a surface, explorer or trial: give a name without '/'.")
        given = [channel for channel in channels if channel[1] is not None]
        for name, values, rate, columns, _ in given:
            if np.ndim(values) != 1 + len(columns) or np.shape(values)[1:] != columns:
                raise ValueError(f"`{name}` must have shape (samples, *{columns}), got {np.shape(values)}.")
            if rate is None or not rate > 0:
                raise ValueError(f"`{name}_rate` must be a positive number of Hz, got {rate}.")
        group = self._file["recordings"].create_group(f"{surface}/{explorer}/{trial}")
        for name, values, rate, _, channel_unit in given:
            dataset = group.create_dataset(name, data=np.asarray(values, dtype=np.float32))
            dataset.attrs.update(rate=float(rate), unit=channel_unit)

    def copy_recordings(self, source):
        """Adds all recordings of a `RecordingsFile` as they are, streamed from file to file."""
        for surface in source.surfaces:
            source._file.copy(f"recordings/{surface}", self._file["recordings"])

    def set_attributes(self, **attributes):
        """Adds attributes to the file (numbers or strings), for example a report that is known only at the end."""
        self._file.attrs.update(attributes)

    def set_ratings(self, values, raters, surfaces, axes):
        """Stores what raters answered.

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

    def set_truth(self, surfaces, fields):
        """Stores what is known of the surfaces, for evaluation only: preparation and training never read it.

        Args:
            surfaces (`list[str]`): names as in `add_recording`.
            fields (`dict[str, np.ndarray]`): name -> (surfaces, ...) numbers or (surfaces,) strings.

        Raises:
            ValueError: if a field's name is taken or its length is not that of `surfaces`.
        """
        group = self._file.create_group("truth")
        group.create_dataset("surfaces", data=list(surfaces), dtype=h5py.string_dtype())
        for name, values in fields.items():
            values = np.asarray(values)
            if not name or "/" in name or name == "surfaces":
                raise ValueError(f"{name!r} cannot name a field of the truth: give a name without '/', not 'surfaces'.")
            if values.shape[:1] != (len(surfaces),):
                raise ValueError(f"`fields[{name!r}]` has shape {values.shape}, there are {len(surfaces)} surfaces.")
            text = values.dtype.kind == "U"
            data, dtype = (values.tolist(), h5py.string_dtype()) if text else (values, None)
            group.create_dataset(name, data=data, dtype=dtype)


class RecordingsFile:
    """Reads `recordings.h5`; iterating yields one `Recording` after the other, so that one is in memory at a time.

    The structure of the whole file is checked when it is opened, values when a recording is read. A NaN in a recording
    is no error: preparation excludes it and says so. An infinite value becomes NaN.

    Args:
        path (`str` or `Path`): the file.

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
        except Exception:
            self._file.close()
            raise

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        self.close()

    def _reading(self):
        return reading(self.path, "a store of recordings", "Copy it again, or write it again from its source.")

    def close(self):
        self._file.close()

    def __len__(self):
        return len(self.names)

    def __iter__(self):
        return (self.read(name) for name in self.names)

    def _fail(self, group, problem, remedy):
        raise ValueError(f"{self.path}, {group}: {problem}. {remedy}")

    def _check_structure(self):
        attributes = plain_attributes(self._file)
        if attributes.get("format") != FORMAT or attributes.get("version") != VERSION:
            found = f"format={attributes.get('format')!r}, version={attributes.get('version')!r}"
            self._fail("/", f"{found} instead of {FORMAT!r}, {VERSION}", "Convert the source with RecordingsWriter.")
        if "source" not in attributes:
            self._fail("/", "lacks the attribute `source`", "Add where the recordings come from.")
        recordings = self._file.get("recordings")
        if not isinstance(recordings, h5py.Group) or not len(recordings):
            self._fail("/recordings", "there is no recording", "Add at least one with RecordingsWriter.")
        self.names, self.lengths, units = [], [], set()
        for surface in self._subgroups(self._file["recordings"]):
            for explorer in self._subgroups(surface):
                for trial in self._subgroups(explorer):
                    dataset = self._check_recording(trial)
                    self.names.append(trial.name.removeprefix("/recordings/"))
                    self.lengths.append(len(dataset))
                    units.add(plain_attributes(dataset)["unit"])
        if len(units) > 1:
            self._fail("/recordings", f"units {sorted(units)} are mixed", "Keep one unit per file.")
        self.unit = units.pop()
        self.surfaces = tuple(self._file["recordings"])
        self.attributes = attributes
        self.ratings = self._read_ratings()

    def _subgroups(self, group):
        members = list(group.values())
        if not members or not all(isinstance(member, h5py.Group) for member in members):
            self._fail(group.name, "is no group of groups", "Arrange recordings as /recordings/surface/explorer/trial.")
        return members

    def _check_recording(self, group):
        fields = [name for name in ("force", "lateral") if name in group]
        if len(fields) != 1:
            self._fail(group.name, f"has fields {sorted(group)}", "Store exactly one of `force` and `lateral`.")
        for name, columns in ((fields[0], (3,) if fields[0] == "force" else ()), ("velocity", (2,))):
            if name not in group:
                continue
            dataset = group[name]
            check_size(self.path, dataset.nbytes)
            units = FORCE_UNITS if name != "velocity" else (VELOCITY_UNIT,)
            attributes = plain_attributes(dataset)
            rate = attributes.get("rate")
            if not isinstance(rate, Real) or not 0 < float(rate) < np.inf:  # a long double may be less than any float
                self._fail(dataset.name, "has no positive attribute `rate`", "Add the sampling rate in Hz.")
            if (unit := attributes.get("unit")) not in units:
                self._fail(dataset.name, f"attribute `unit` is {unit!r}", f"Convert the data to one of {units}.")
            if dataset.ndim != 1 + len(columns) or dataset.shape[1:] != columns:
                self._fail(dataset.name, f"has shape {dataset.shape}", f"Store (samples, *{columns}).")
            if dataset.dtype.kind not in "fiu":
                self._fail(dataset.name, f"holds {dataset.dtype}, no real numbers", "Store it as float32.")
            seconds = len(dataset) / rate
            if seconds < SEGMENT_SECONDS:
                problem = f"lasts {seconds:.3g} s, less than one segment of {SEGMENT_SECONDS} s"
                self._fail(dataset.name, problem, "Leave it out, or check its `rate`.")
        rate = float(plain_attributes(group[fields[0]])["rate"])
        if rate != int(rate):
            self._fail(f"{group.name}/{fields[0]}", f"`rate` is {rate}", "Resample to a whole number of Hz.")
        return group[fields[0]]

    def rate(self, name):
        """Rate of the force of recording `name`, Hz."""
        group = self._file[f"recordings/{name}"]
        return int(plain_attributes(group["force" if "force" in group else "lateral"])["rate"])

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
            return self._read(name)

    def _read(self, name):
        group = self._file[f"recordings/{name}"]
        surface, explorer, trial = name.split("/")
        field = "force" if "force" in group else "lateral"
        values = _finite(group[field])
        unit = plain_attributes(group[field])["unit"]
        notes = check_forces(values, f"{self.path}, {group[field].name}", unit)
        velocity = _finite(group["velocity"]) if "velocity" in group else None
        return Recording(
            surface,
            explorer,
            trial,
            force=values if field == "force" else None,
            lateral=values if field == "lateral" else None,
            rate=self.rate(name),
            velocity=velocity,
            velocity_rate=float(plain_attributes(group["velocity"])["rate"]) if velocity is not None else None,
            unit=unit,
            notes=tuple(notes),
        )

    @property
    def truth(self):
        """`SurfaceTruth`, or `None` if the file has none.

        Raises:
            ValueError: if the surfaces have no recording, or a field has another length.
        """
        with self._reading():
            return self._read_truth()

    def _read_truth(self):
        if "truth" not in self._file:
            return None
        group = self._file["truth"]
        check_size(self.path, sum(dataset.nbytes for dataset in group.values()))
        if "surfaces" not in group:
            self._fail("/truth", "lacks 'surfaces'", "Write it with RecordingsWriter.set_truth.")
        surfaces, fields = as_strings(group["surfaces"]), {}
        unknown = sorted(set(surfaces) - set(self.surfaces))
        if unknown:
            self._fail("/truth/surfaces", f"{unknown[:3]} have no recording", "Use the names of the groups.")
        for name in sorted(group.keys() - {"surfaces"}):
            dataset = group[name]
            if dataset.shape[:1] != (len(surfaces),):
                self._fail(dataset.name, f"has shape {dataset.shape} for {len(surfaces)} surfaces", "Write it again.")
            text = h5py.check_string_dtype(dataset.dtype) is not None
            fields[name] = np.array(as_strings(dataset)) if text else dataset[()]
        return SurfaceTruth(surfaces, fields)

    def _read_ratings(self):
        if "ratings" not in self._file:
            return None
        group = self._file["ratings"]
        missing = {"values", "raters", "surfaces", "axes"} - set(group)
        if missing:
            self._fail("/ratings", f"lacks {sorted(missing)}", "Store them, or leave out the group.")
        check_size(self.path, sum(dataset.nbytes for dataset in group.values()))
        values = group["values"][()].astype(np.float32)
        names = [as_strings(group[name]) for name in ("raters", "surfaces", "axes")]
        try:
            check_ratings(values, tuple(len(strings) for strings in names), f"{self.path}, /ratings/values:")
        except ValueError:
            self._file.close()
            raise
        unknown = sorted(set(names[1]) - set(self.surfaces))
        if unknown:
            self._fail("/ratings/surfaces", f"{unknown[:3]} have no recording", "Use the names of the groups.")
        return RaterScores(values, *names)


def _finite(dataset):
    """Values as float32; an infinite one is missing."""
    values = dataset[()].astype(np.float32, copy=False)
    values[np.isinf(values)] = np.nan
    return values

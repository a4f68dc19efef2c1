"""Many generated textures in one folder: shards in HDF5, a manifest, and a reader that sees them as one array.

`manifest.json` holds `settings` (all that the textures depend on), `about` (where they come from) and `shards`, a list
of {"file", "first", "count"}. A shard holds, row by row, `textures` (count, samples) float32 in N,
`level` and `friction_coefficient` (count,) float32, `ratings` (count, axes) float32 z-scores, NaN = not specified, and
`seed` (count,) int64; its attributes repeat the settings. A shard is whole or absent.
"""

import json
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from ..io.files import clear_left_behind, write_text
from ..io.hdf5 import check_sizes, open_whole, whole_file
from ..io.reading import read_json, reading

FORMAT, VERSION = "tactile-generated", 1
MANIFEST = "manifest.json"
UNITS = {"textures": "N", "level": "natural log of the RMS in N", "friction_coefficient": "1", "ratings": "z-score"}


def plan_shards(total, size):
    """Shards of `size` textures, the last one perhaps smaller: a list of {"file", "first", "count"}."""
    return [
        {"file": f"textures-{number:05d}.h5", "first": first, "count": min(size, total - first)}
        for number, first in enumerate(range(0, total, size))
    ]


def open_folder(folder, settings, about):
    """Creates the folder of a data set, or checks that the one there has the same settings, and cleans it.

    Args:
        folder (`str` or `Path`): created if absent; no other call may be writing to it.
        settings (`dict`): JSON values, with `num_textures` and `textures_per_shard`.
        about (`dict`): JSON values that need not agree.

    Returns:
        `list[dict]`: the shards that are still missing.

    Raises:
        ValueError: if the folder holds something else, or textures of other settings.
    """
    folder = Path(folder)
    if not (folder / MANIFEST).is_file():
        if folder.is_dir() and any(path.suffix != ".tmp" for path in folder.iterdir()):
            raise ValueError(f"The folder {folder} is not empty and holds no generated textures: give another one.")
        folder.mkdir(parents=True, exist_ok=True)
        shards = plan_shards(settings["num_textures"], settings["textures_per_shard"])
        manifest = {"format": FORMAT, "version": VERSION, "settings": settings, "about": about, "shards": shards}
        write_text(folder / MANIFEST, json.dumps(manifest, indent=1) + "\n")
    manifest = _read_manifest(folder)
    stored = manifest["settings"]
    differing = [name for name in {**stored, **settings} if stored.get(name) != settings.get(name)]
    if differing:
        words = "; ".join(f"{name} {stored.get(name)}, not {settings.get(name)}" for name in differing)
        raise ValueError(
            f"The folder {folder} holds textures of other settings ({words}). Finish them with those settings, or give "
            "another folder."
        )
    for shard in manifest["shards"]:
        clear_left_behind(folder / shard["file"])
    return [shard for shard in manifest["shards"] if not _is_whole(folder / shard["file"], shard["count"])]


def _read_manifest(folder):
    path = folder / MANIFEST
    if not path.is_file():
        raise FileNotFoundError(f"There is no {path}: {folder} holds no generated textures.")
    with reading(path, "a manifest of generated textures", "Copy it again, or generate the textures again."):
        manifest = read_json(path, "JSON")
        if (manifest["format"], manifest["version"]) != (FORMAT, VERSION):
            raise ValueError(f"{path} has format {manifest['format']} {manifest['version']}, not {FORMAT} {VERSION}.")
        settings = manifest["settings"]
        sizes, num_shards = (settings["num_textures"], settings["textures_per_shard"]), len(manifest["shards"])
        # counted before they are planned: a damaged file may hold any number
        if num_shards != -(-sizes[0] // sizes[1]) or manifest["shards"] != plan_shards(*sizes):
            raise ValueError(f"its {num_shards} shards do not hold the {sizes[0]} textures")
        if not (isinstance(manifest["about"], dict) and 0 < settings["sampling_rate"] < float("inf")):
            raise ValueError("`about` is no object, or `sampling_rate` not above 0")
    return manifest


def _is_whole(path, count):
    """Whether a shard is done: not if a power cut truncated it."""
    try:
        with reading(path, "a shard"), open_whole(path) as file:
            return len(file["textures"]) == count
    except (FileNotFoundError, ValueError):
        return False


def write_shard(path, count, attributes, batches):
    """Writes one shard under a temporary name; refuses batches that hold fewer or more than `count` rows.

    Args:
        path (`str` or `Path`): in the folder of `open_folder`.
        count (`int`): rows.
        attributes (`dict`): settings; `None` is stored as the word "none".
        batches (iterable of `dict[str, np.ndarray]`): rows of every column, in order.
    """
    done = 0
    with whole_file(path) as file:
        file.attrs.update({"format": FORMAT, "version": VERSION})
        file.attrs.update({name: "none" if value is None else value for name, value in attributes.items()})
        for columns in batches:
            size = len(columns["textures"])
            for name, values in columns.items():
                if name not in file:
                    file.create_dataset(name, (count, *values.shape[1:]), values.dtype)
                    file[name].attrs["unit"] = UNITS.get(name, "")
                if done + size <= count:
                    file[name][done : done + size] = values
            done += size
        if done != count:
            raise ValueError(f"`batches` hold {done} rows, not {count}.")


class GeneratedTextures:
    """Generated textures as one array of all shards, (textures, samples) float32 in N; only rows asked for are read.

    `data[5]`, `data[10:20]`, `data[[3, 1, 3]]` are NumPy arrays; what belongs to the textures is
    `data.column("level")`, `"friction_coefficient"`, `"ratings"` (textures, axes) or `"seed"`.

    Args:
        folder (`str` or `Path`): that `examples/generate_dataset.py` wrote.

    Attributes:
        settings, about (`dict`): of the manifest.
        shape (`tuple[int, int]`), dtype (`np.dtype`): of the array.
        sampling_rate (`int`): Hz.

    Raises:
        FileNotFoundError: if there is no manifest.
        ValueError: if the manifest is damaged, or shards are missing.
    """

    dtype = np.dtype(np.float32)

    def __init__(self, folder):
        self.folder = Path(folder)
        manifest = _read_manifest(self.folder)
        self.settings, self.about, self._shards = manifest["settings"], manifest["about"], manifest["shards"]
        missing = [shard["file"] for shard in self._shards if not (self.folder / shard["file"]).is_file()]
        if missing:
            raise ValueError(
                f"{len(missing)} of {len(self._shards)} shards are missing in {self.folder}, {missing[0]} for one: run "
                "the command that began them again, and it goes on."
            )
        self.sampling_rate = self.settings["sampling_rate"]
        with self._open(self._shards[0]) as file:
            self.shape, self._names = (self.settings["num_textures"], file["textures"].shape[1]), sorted(file)

    @contextmanager
    def _open(self, shard):
        path = self.folder / shard["file"]
        with reading(path, "a shard of generated textures", "Delete it and generate it again."):
            with open_whole(path) as file:
                check_sizes(file)
                if len(file["textures"]) != shard["count"]:
                    raise ValueError(f"it holds {len(file['textures'])} textures, not {shard['count']}")
                yield file

    def __len__(self):
        return self.shape[0]

    def __getitem__(self, index):
        rows = np.arange(len(self))[index]
        found = np.empty((rows.size, self.shape[1]), self.dtype)
        numbers = rows.ravel() // self.settings["textures_per_shard"]
        for number in np.unique(numbers):
            shard, places = self._shards[number], np.flatnonzero(numbers == number)
            within, back = np.unique(rows.ravel()[places] - shard["first"], return_inverse=True)
            with self._open(shard) as file:
                # one slice is far quicker than a list of rows
                low, high = within[0], within[-1] + 1
                whole = len(within) == high - low
                found[places] = (file["textures"][low:high] if whole else file["textures"][within])[back]
                if not np.isfinite(found[places]).all():
                    raise ValueError("some textures are no numbers")
        return found.reshape(*rows.shape, self.shape[1])

    def column(self, name):
        """What belongs to each texture, in memory: (textures, ...); refuses an unknown name."""
        if name not in self._names:
            first = self.folder / self._shards[0]["file"]
            raise ValueError(f"`name` must be a column of {first}, one of {self._names}, got {name!r}.")
        parts = []
        for shard in self._shards:
            with self._open(shard) as file:
                parts.append(file[name][()])
                if len(parts[-1]) != shard["count"]:
                    raise ValueError(f"`{name}` has {len(parts[-1])} rows, not {shard['count']}")
        return np.concatenate(parts)


#: Opens a folder of generated textures.
read_generated = GeneratedTextures

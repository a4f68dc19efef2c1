"""Many generated textures in one folder: a data set in Parquet, as `datasets.load_dataset` reads it.

A shard, `data/train-00000-of-00391.parquet`, has a texture in each row: `texture`, a list of float32 in N; a column for
each axis of the ratings, float32 z-scores, null = not specified; `level` and `friction_coefficient`, float32; `seed`,
int64. Its metadata `tactile_diffusers` is JSON: `units` of the columns, `settings` (all that the textures depend on)
and `about` (where they come from). A shard is whole or absent. The card, README.md, is written last.
"""

import json
from pathlib import Path

import numpy as np

from ..io.files import atomic_path, clear_left_behind
from ..io.parquet import import_pyarrow, open_parquet
from ..io.reading import reading

CARD = "README.md"
#: The key of our metadata in a shard.
KEY = "tactile_diffusers"
UNITS = {"texture": "N", "level": "natural log of the RMS in N", "friction_coefficient": "1"}


def find_shards(folder):
    """Paths of the shards in a folder, in order; none if it holds no generated textures."""
    return sorted(Path(folder).glob("data/train-*.parquet"))


def plan_shards(total, size):
    """Yields shards of `size` textures, the last one perhaps smaller: {"file", "first", "count"}."""
    number = -(-total // size)
    for place in range(number):
        file, first = f"data/train-{place:05d}-of-{number:05d}.parquet", place * size
        yield {"file": file, "first": first, "count": min(size, total - first)}


def open_folder(folder, settings):
    """Creates the folder of a data set, or checks that the one there has the same settings, and cleans it.

    Args:
        folder (`str` or `Path`): created if absent; no other call may be writing to it.
        settings (`dict`): JSON values, with `num_textures` and `textures_per_shard`.

    Returns:
        `list[dict]`: the shards that are still missing, of `plan_shards`.

    Raises:
        ValueError: if the folder holds something else, or textures of other settings.
    """
    folder, whole = Path(folder), {}
    for path in find_shards(folder):
        try:
            with _reading(path), open_parquet(path) as file:
                whole[path] = _facts(file)["settings"]
        except ValueError:  # truncated by a power cut: it is made again
            continue
    if not whole and any(path.is_file() and path.suffix != ".tmp" for path in folder.rglob("*")):
        raise ValueError(f"The folder {folder} is not empty and holds no generated textures: give another one.")
    for stored in whole.values():
        differing = [name for name in {**stored, **settings} if stored.get(name) != settings.get(name)]
        if differing:
            words = "; ".join(f"{name} {stored.get(name)}, not {settings.get(name)}" for name in differing)
            raise ValueError(
                f"The folder {folder} holds textures of other settings ({words}). Finish them with those settings, or "
                "give another folder."
            )
    (folder / "data").mkdir(parents=True, exist_ok=True)
    shards = list(plan_shards(settings["num_textures"], settings["textures_per_shard"]))
    for file in (CARD, *(shard["file"] for shard in shards)):
        clear_left_behind(folder / file)
    return [shard for shard in shards if folder / shard["file"] not in whole]


def write_shard(path, count, settings, about, batches):
    """Writes one shard under a temporary name; refuses batches that hold fewer or more than `count` rows.

    Args:
        path (`str` or `Path`): in the folder of `open_folder`.
        count (`int`): rows, which are in memory until they are written.
        settings (`dict`): of `open_folder`.
        about (`dict`): JSON values that need not agree between shards, with `rating_axes`.
        batches (iterable of `dict[str, np.ndarray]`): rows of every column, in order; NaN is written as null.
    """
    pa = import_pyarrow(path)
    table = pa.concat_tables([_table(pa, columns) for columns in batches])
    if len(table) != count:
        raise ValueError(f"`batches` hold {len(table)} rows, not {count}.")
    facts = {"units": UNITS | dict.fromkeys(about["rating_axes"], "z-score"), "settings": settings, "about": about}
    with atomic_path(path) as temporary:
        pa.parquet.write_table(
            table.replace_schema_metadata({KEY: json.dumps(facts)}),
            temporary,
            compression="zstd",
            use_dictionary=False,  # hardly any number comes twice
            use_byte_stream_split=["texture.list.element"],  # a fifth smaller: exponents of a waveform are alike
            write_page_checksum=True,
        )


def _table(pa, columns):
    """A `pyarrow.Table` of arrays (rows,), and (rows, samples) as lists."""
    arrays = {}
    for name, values in columns.items():
        arrays[name] = pa.array(np.ravel(values), from_pandas=values.ndim == 1)
        if values.ndim == 2:
            offsets = np.arange(len(values) + 1) * values.shape[1]
            arrays[name] = pa.ListArray.from_arrays(offsets, arrays[name])
    return pa.table(arrays)


def _reading(path):
    return reading(path, "a shard of generated textures", "Delete it and generate it again.")


def _facts(file):
    """What the metadata of an open shard say."""
    return json.loads((file.schema_arrow.metadata or {})[KEY.encode()])


class GeneratedTextures:
    """Generated textures as one array of all shards, (textures, samples) float32 in N; only shards asked for are read.

    `data[5]`, `data[10:20]`, `data[[3, 1, 3]]` are NumPy arrays; what belongs to the textures is
    `data.column("level")`, `"friction_coefficient"`, `"seed"`, an axis of the ratings, or all of them as `"ratings"`
    (textures, axes). The shard that was read last is kept in memory.

    Args:
        folder (`str` or `Path`): that `examples/generate_dataset.py` wrote.

    Attributes:
        settings, about (`dict`): of the first shard.
        shape (`tuple[int, int]`), dtype (`np.dtype`): of the array.
        sampling_rate (`int`): Hz.

    Raises:
        FileNotFoundError: if there are no shards.
        ValueError: if pyarrow is missing, or shards are missing or damaged.
    """

    dtype, shape = np.dtype(np.float32), None

    def __init__(self, folder):
        self.folder, self._shards = Path(folder), []
        first = next(iter(find_shards(folder)), None)
        if first is None:
            raise FileNotFoundError(f"There is no {self.folder}/data/train-*.parquet: no generated textures.")
        with _reading(first):
            with open_parquet(first) as file:
                facts = _facts(file)
            self.settings, self.about = facts["settings"], facts["about"]
            self.sampling_rate, number = self.settings["sampling_rate"], self.settings["num_textures"]
            self._axes = list(self.about["rating_axes"])
            for shard in plan_shards(number, self.settings["textures_per_shard"]):
                # a damaged file may plan any number: the first that is missing ends the search
                if not (self.folder / shard["file"]).is_file():
                    raise ValueError(
                        f"The shard {self.folder / shard['file']} is missing: run the command that began it again, and "
                        "it goes on."
                    )
                self._shards.append(shard)
            self._kept = (0, self._read(self._shards[0], "texture"))
        self.shape = (number, self._kept[1].shape[1])

    def _read(self, shard, name):
        """A column of one shard: (rows,), textures (rows, samples)."""
        path = self.folder / shard["file"]
        with _reading(path):
            with open_parquet(path) as file:
                if _facts(file)["settings"] != self.settings:
                    raise ValueError("its settings are not those of the first shard")
                values = file.read([name])[name].to_numpy()
            if len(values) != shard["count"]:
                raise ValueError(f"it holds {len(values)} textures, not {shard['count']}")
            if name == "texture":
                values = np.stack(values)
                if self.shape and values.shape[1] != self.shape[1]:
                    raise ValueError(f"its textures have {values.shape[1]} samples, others {self.shape[1]}")
                if not np.isfinite(values).all():
                    raise ValueError("some textures are no numbers")
        return values

    def __len__(self):
        return self.shape[0]

    def __getitem__(self, index):
        rows = np.arange(len(self))[index]
        found = np.empty((rows.size, self.shape[1]), self.dtype)
        numbers, within = np.divmod(rows.ravel(), self.settings["textures_per_shard"])
        for number in np.unique(numbers):
            if self._kept[0] != number:  # rows one after the other unpack each shard once
                self._kept = (number, self._read(self._shards[number], "texture"))
            found[numbers == number] = self._kept[1][within[numbers == number]]
        return found.reshape(*rows.shape, self.shape[1])

    def column(self, name):
        """What belongs to each texture, in memory: (textures,), ratings (textures, axes); refuses an unknown name."""
        if name == "ratings":
            return np.stack([self.column(axis) for axis in self._axes], axis=1)
        names = [*self._axes, "level", "friction_coefficient", "seed"]
        if name not in names:
            raise ValueError(f"`name` must be 'ratings' or one of {names}, got {name!r}.")
        return np.concatenate([self._read(shard, name) for shard in self._shards])


#: Opens a folder of generated textures.
read_generated = GeneratedTextures

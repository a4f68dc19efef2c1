"""Many generated textures in one folder, which `examples/generate_dataset.py` wrote: a data set in Parquet.

A shard, `data/train-00000-of-00391.parquet`, has a texture in each row: `texture`, a list of float32 in N; a column for
each axis of the ratings, float32 z-scores, null = not specified; `level` and `friction_coefficient`, float32; `seed`,
int64. Its metadata `tactile_diffusers` is JSON: `units` of the columns, `settings` (all that the textures depend on)
and `about` (where they come from). A shard is whole or absent. The card, README.md, is written last.
"""

import json
from pathlib import Path

import numpy as np

from ..io.reading import open_parquet, reading

#: The key of our metadata in a shard.
KEY = "tactile_diffusers"


def find_shards(folder):
    """Paths of the shards in a folder, in order; none if it holds no generated textures."""
    return sorted(Path(folder).glob("data/train-*.parquet"))


def plan_shards(total, size):
    """Yields shards of `size` textures, the last one perhaps smaller: {"file", "first", "count"}."""
    number = -(-total // size)
    for place in range(number):
        file, first = f"data/train-{place:05d}-of-{number:05d}.parquet", place * size
        yield {"file": file, "first": first, "count": min(size, total - first)}


def reading_shard(path):
    """A context that refuses a damaged shard by name."""
    return reading(path, "a shard of generated textures", "Delete it and generate it again.")


def facts_of(file):
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
        with reading_shard(first):
            with open_parquet(first) as file:
                facts = facts_of(file)
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
        with reading_shard(path):
            with open_parquet(path) as file:
                if facts_of(file)["settings"] != self.settings:
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

"""Writing generated textures: shards in Parquet, as `tactile_diffusers.export.generated` reads them."""

import json
from pathlib import Path

import numpy as np

from tactile_diffusers.export.generated import KEY, facts_of, find_shards, plan_shards, reading_shard
from tactile_diffusers.io.files import atomic_path, clear_left_behind
from tactile_diffusers.io.reading import import_pyarrow, open_parquet

CARD = "README.md"
UNITS = {"texture": "N", "level": "natural log of the RMS in N", "friction_coefficient": "1"}


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
            with reading_shard(path), open_parquet(path) as file:
                whole[path] = facts_of(file)["settings"]
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

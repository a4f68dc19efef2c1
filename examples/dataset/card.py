"""The card of generated textures: README.md with the YAML that the Hub and `datasets.load_dataset` read."""

from pathlib import Path

from tactile_diffusers.export.generated import find_shards
from tactile_diffusers.io.files import write_text
from tactile_diffusers.io.reading import open_parquet, reading

from .shards import CARD

TAGS = ["tactile", "haptics", "texture", "friction", "synthetic"]
_LICENCE = ("license", "license_name", "license_link")
_TEXT = """\
---
{yaml}
---

# {name}

{num_textures} textures: the lateral force on a sliding finger in newtons, at {sampling_rate} Hz. They were generated
from ratings, not recorded, with tactile_diffusers and the checkpoint {checkpoint}.

```python
from datasets import load_dataset

textures = load_dataset("{name}", split="train").with_format("numpy")
print(textures[0]["texture"])  # N, at {sampling_rate} Hz
```

Each row has its `texture`, the ratings it was generated from ({axes}; z-scores, null = not specified), its
`level` (natural log of the RMS in newtons), its `friction_coefficient`, and the `seed` of its noise.

## How they were made

Each file repeats this in its metadata, under `tactile_diffusers`.

| | |
|---|---|
{rows}
"""


def licence_of(checkpoint):
    """What the card of a checkpoint says of its licence: a dict with `license`, `license_name` or neither.

    Raises:
        ValueError: if the card is damaged.
    """
    from huggingface_hub import metadata_load

    card = Path(checkpoint) / CARD
    if not card.is_file():
        return {}
    with reading(card, "the card of a checkpoint"):
        found = metadata_load(card) or {}
    return {name: found[name] for name in _LICENCE if found.get(name)}


def write_card(folder, settings, about):
    """Writes the card of a finished data set, unless the folder has one: somebody may have added to it.

    Args:
        folder (`str` or `Path`): of the data set.
        settings, about (`dict`): as for `write_shard`.
    """
    from huggingface_hub import DatasetCardData

    card = Path(folder).resolve() / CARD
    if card.exists():
        return
    facts, size = settings | about, 0
    for path in find_shards(folder):
        with open_parquet(path) as file:
            size += sum(file.metadata.row_group(number).total_byte_size for number in range(file.num_row_groups))
    split = {"name": "train", "num_examples": settings["num_textures"], "num_bytes": size}
    yaml = DatasetCardData(
        pretty_name=card.parent.name,
        tags=TAGS,
        configs=[{"config_name": "default", "data_files": [{"split": "train", "path": "data/train-*.parquet"}]}],
        dataset_info={"splits": [split]},  # so that `load_dataset` refuses a folder that lacks some
        **{name: facts.pop(name) for name in _LICENCE if name in facts},
    )
    axes = ", ".join(f"`{axis}`" for axis in facts.pop("rating_axes"))
    rows = "\n".join(f"| {name} | {'none' if value is None else value} |" for name, value in facts.items())
    write_text(card, _TEXT.format(yaml=yaml.to_yaml(), name=card.parent.name, axes=axes, rows=rows, **facts))

"""Checks that metrics share: finite arrays of the right shape."""

import numpy as np


def check_textures(name, textures, rank=None):
    """Textures (..., samples), of `rank` axes if given, as an array of their own dtype.

    A ValueError if they are empty, of another rank, or hold NaN, infinity or what is no real number.
    """
    textures = np.asarray(textures)
    if textures.dtype.kind not in "fiu":
        raise ValueError(f"`{name}` must hold real numbers, got dtype {textures.dtype}. Convert it to float32.")
    if textures.size == 0 or textures.ndim == 0 or (rank is not None and textures.ndim != rank):
        wanted = "(..., samples)" if rank is None else f"{rank} axes"
        raise ValueError(f"`{name}` must have the shape {wanted} and not be empty, got {textures.shape}.")
    bad = ~np.isfinite(textures)
    if bad.any():
        raise ValueError(
            f"`{name}` must be finite, got {textures[bad][0]} at index {np.argwhere(bad)[0].tolist()} "
            f"({bad.sum()} such values in all). Leave those textures out."
        )
    return textures


def check_pair(texture, reference):
    """Two arrays of textures as float64; a ValueError if one is not finite or their shapes differ."""
    texture, reference = check_textures("texture", texture), check_textures("reference", reference)
    if texture.shape != reference.shape:
        raise ValueError(
            f"`texture` and `reference` must have the same shape, got {texture.shape} and {reference.shape}. "
            "Bring both to one sampling rate and length first."
        )
    return texture.astype(np.float64), reference.astype(np.float64)


def check_sets(**sets):
    """Two named sets (n, features), (m, features) as float64; a ValueError if they are not finite or do not fit."""
    checked = {name: check_textures(name, values, rank=2).astype(np.float64) for name, values in sets.items()}
    (first, a), (second, b) = checked.items()
    if a.shape[1] != b.shape[1]:
        raise ValueError(f"`{first}` and `{second}` must have the same features, got {a.shape[1]} and {b.shape[1]}.")
    return a, b


def in_blocks(rows, size=256):
    """Blocks of some hundred rows, which bounds the memory of what is computed from them."""
    return (rows[start : start + size] for start in range(0, len(rows), size))

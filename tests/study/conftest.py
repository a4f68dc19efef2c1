"""A key of a study without textures: what trials, simulated participants and the analysis need."""

import numpy as np
import pandas
import pytest
from study.folder import KEY_COLUMNS
from study.stimuli import blind_ids

from tactile_diffusers.signal import RATING_AXES

CONDITIONS = ("reference", "other_take", "generated", "reconstructed", "mean_spectrum")


def _make_key(surfaces=6, conditions=CONDITIONS, seed=0, axes=RATING_AXES):
    rng = np.random.default_rng(seed)
    columns = [f"asked_{axis}" for axis in axes]
    asked = rng.uniform(-1.5, 1.5, (surfaces, len(axes)))
    rows = [
        {"surface": f"surface{s}", "condition": c, **dict(zip(columns, asked[s], strict=True))}
        for c in conditions
        for s in range(surfaces)
    ]
    key = pandas.DataFrame(rows).reindex(columns=[*KEY_COLUMNS, *columns])
    ids = blind_ids(2 * len(key), rng)
    originals, copies = key.assign(id=ids[: len(key)], copy_of=""), key.assign(id=ids[len(key) :])
    return pandas.concat([originals, copies.assign(copy_of=ids[: len(key)])], ignore_index=True)


@pytest.fixture(scope="session")
def make_key():
    return _make_key


@pytest.fixture
def key():
    return _make_key()

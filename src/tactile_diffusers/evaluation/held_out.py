"""Held-out segments: whether a checkpoint can be measured on them."""

import numpy as np


def check_unseen(held_out, train):
    """Refuses held-out segments of surfaces that training has too: every section supposes unseen surfaces.

    Raises:
        ValueError: if the two views of a data set share a surface, as where only explorers or raters are held out.
    """
    shared = np.intersect1d(held_out.surface_ids, train.surface_ids)
    if len(shared):
        raise ValueError(
            f"{held_out.path} has {len(shared)} surfaces of the split {held_out.split!r} in training too, first "
            f"{held_out.surfaces[shared[0]]!r}: nothing would be unseen. Hold out surfaces when preparing the data."
        )


def check_fit(pipe, dataset, name="checkpoint"):
    """Refuses a checkpoint and data that cannot be compared; `name` is what the message calls the checkpoint.

    Raises:
        ValueError: if their bands, rates or lengths differ.
    """
    extractor = pipe.feature_extractor
    band = tuple(float(edge) for edge in extractor.band)
    if band != tuple(dataset.band):
        raise ValueError(
            f"The {name}'s band is {band} Hz, `data` was prepared with {tuple(dataset.band)} Hz. Prepare the data "
            f"again with the {name}'s band (`--band` of examples/prepare_data.py), or train on this data."
        )
    if dataset.sampling_rate > extractor.delivery_rate:
        raise ValueError(
            f"`data` has a sampling rate of {dataset.sampling_rate} Hz, the {name} delivers only "
            f"{extractor.delivery_rate} Hz: there is nothing to compare above {extractor.delivery_rate / 2:g} Hz. "
            f"Resample the recordings to the {name}'s rate."
        )
    seconds = pipe.lctg.config.segment_samples / extractor.sampling_rate
    if abs(seconds - dataset.segment_samples / dataset.sampling_rate) > 1 / extractor.sampling_rate:
        raise ValueError(
            f"The {name} was trained on segments of {seconds:g} s, `data` holds segments of "
            f"{dataset.segment_samples / dataset.sampling_rate:g} s. Prepare the data again with `--segment-seconds`."
        )

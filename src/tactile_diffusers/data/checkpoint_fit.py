"""Whether a checkpoint and a prepared data set fit each other."""


def check_fit(pipe, dataset, name="checkpoint"):
    """A ValueError if bands, rates or lengths of checkpoint and data differ; `name` is the checkpoint's in it."""
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
            f"{extractor.delivery_rate} Hz. Resample the recordings to the {name}'s rate."
        )
    seconds = pipe.lctg.config.segment_samples / extractor.sampling_rate
    # a sample of the coarser rate: of the two, or of the recordings
    rate = min(extractor.sampling_rate, dataset.attributes["sampling_rate"])
    if abs(seconds - dataset.segment_samples / dataset.sampling_rate) * rate > 1 + 1e-6:
        raise ValueError(
            f"The {name} was trained on segments of {seconds:g} s, `data` holds segments of "
            f"{dataset.segment_samples / dataset.sampling_rate:g} s. Prepare the data again with `--segment_seconds`."
        )

"""What a batch of LCTG's trainings holds."""

import torch


def make_collate(extractor, sampling_rate):
    """A function that turns items of a `PreparedDataset` into whitened waveforms and their features.

    Args:
        extractor (`TactileFeatureExtractor`): the pipeline's.
        sampling_rate (`int`): of the items, Hz.

    Returns:
        `Callable`: list of `{"texture": (samples,)}` -> `{"waveform": (batch, samples), "input_features": (batch,
        channels, frames)}`, float32.
    """

    def collate(items):
        waveform, _ = extractor.normalize(torch.stack([item["texture"] for item in items]), sampling_rate)
        return {
            "waveform": torch.from_numpy(waveform),
            "input_features": torch.from_numpy(extractor.features(waveform)),
        }

    return collate

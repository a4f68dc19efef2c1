"""What validation during the training of a decoder measures: reconstructions of held-out textures."""

import numpy as np
import torch

from ..pipelines import TactileTexturePipeline
from ..schedulers import VDDIMScheduler
from ..signal import nine_band_error_db, resample


class Reconstructions:
    """Held-out textures, encoded and decoded with a fixed seed.

    Args:
        dataset (`PreparedDataset`): of the split "validation", at its native rate.
        extractor (`TactileFeatureExtractor`), scheduler (`VDDIMScheduler`): the pipeline's.
        count (`int`): textures.
        batch_size (`int`): decoded at once.

    Attributes:
        references (`np.ndarray`): (count, samples) the textures, in N, at `rate`.
        rate (`int`): Hz, at which textures are delivered.
    """

    def __init__(self, dataset, extractor, scheduler, count, batch_size):
        count = min(count, len(dataset))
        self.textures = dataset.textures(np.sort(np.random.default_rng(0).permutation(len(dataset))[:count]))
        self.sampling_rate, self.rate, self.batch_size = dataset.sampling_rate, extractor.delivery_rate, batch_size
        self.references = resample(self.textures, dataset.sampling_rate, self.rate)
        self.extractor, self.scheduler = extractor, scheduler

    def decode(self, model, steps, base_only=False):
        """Textures (count, samples), in N, that a decoder makes of the latents in so many steps.

        Args:
            model (`LCTGModel`): encodes and decodes.
            steps (`int`): of the solver.
            base_only (`bool`): from the base layer alone, which is what DALE generates.
        """
        scheduler = VDDIMScheduler.from_config(self.scheduler.config)
        pipe = TactileTexturePipeline(lctg=model, scheduler=scheduler, feature_extractor=self.extractor)
        pipe.set_progress_bar_config(disable=True)
        decoded = []
        for start in range(0, len(self.textures), self.batch_size):
            encoded = pipe.encode(self.textures[start : start + self.batch_size], self.sampling_rate)
            latents = encoded.latents
            if base_only:
                latents = model.pad_detail(latents[:, : model.base_channels])
            generator = torch.Generator("cpu").manual_seed(start)
            out = pipe.decode(latents, encoded.level, num_inference_steps=steps, generator=generator)
            decoded.append(out.textures[:, : self.references.shape[-1]])
        return np.concatenate(decoded)

    def nine_band_db(self, decoded):
        """Mean nine-band error of decoded textures, dB."""
        return nine_band_error_db(decoded, self.references, self.rate).mean()

    def snr_db(self, decoded):
        """Mean signal-to-noise ratio of decoded textures, dB; silence has 0 dB."""
        error = np.square(decoded - self.references).mean(-1)
        return (10 * np.log10(np.square(self.references).mean(-1) / error)).mean()

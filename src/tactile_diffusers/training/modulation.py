"""Measuring how much modulation a decoder leaves out, for `LCTGModel`'s `modulation_gains`."""

import numpy as np
import torch
from tqdm.auto import tqdm

#: Training textures that it takes: enough that another set gives the same factors to a hundredth or two.
MODULATION_TEXTURES = 256
#: Corrections: gains of bands overlap, so each falls a little short.
ROUNDS = 3
#: Bounds of the factors: beyond them a band is empty rather than flat.
LIMITS = (0.5, 2.0)


def fit_modulation_gains(pipe, dale, textures, sampling_rate, seed=0, quiet=False, batch_size=64):
    """Gives LCTG's config the `modulation_gains` with which decoded textures are modulated as deeply as recordings.

    A diffusion decoder that is told no details makes the modulation of the upper bands a little too shallow, of every
    texture alike, and more so in few steps: by 10 to 40 % in log power at 2-6 Hz. Their ratio restores it.

    Args:
        pipe (`TactileTexturePipeline`): whose `lctg` gets it.
        dale (`DALEModel`): gives the base layer the form in which it is generated (`pack`, `unpack`).
        textures (`np.ndarray`): (n, samples), N, of training surfaces.
        sampling_rate (`int`): Hz.
        seed (`int`): of the decoder's noise.
        quiet (`bool`): no progress bar.
        batch_size (`int`): textures decoded at once.

    Returns:
        `list[float]` or `None`: (level_bands + 1,), each within `LIMITS`; `None` without `level_bands`.
    """
    extractor, lctg = pipe.feature_extractor, pipe.lctg
    if not lctg.config.level_bands:
        return None
    batches = [textures[start : start + batch_size] for start in range(0, len(textures), batch_size)]
    recorded = sum(_power(extractor, rows, sampling_rate) for rows in batches)
    modulation_gain = np.ones(lctg.level_channels)
    with tqdm(total=ROUNDS * len(batches), disable=quiet, desc="modulation") as bar:
        for _ in range(ROUNDS):
            lctg.register_to_config(modulation_gains=[round(float(value), 4) for value in modulation_gain])
            generator, made = torch.Generator().manual_seed(seed), 0.0
            for rows in batches:
                given = pipe.encode(rows, sampling_rate)
                state = dale.pack(given.latents[:, : lctg.base_channels], given.level, torch.ones_like(given.level))
                base = lctg.pad_detail(dale.unpack(state)[0])
                out = pipe.decode(base, given.level, generator=generator)
                made = made + _power(extractor, out.textures, out.sampling_rate)
                bar.update()
            ratio = np.sqrt(np.divide(recorded, made, out=np.ones_like(made), where=(recorded > 0) & (made > 0)))
            modulation_gain = np.clip(modulation_gain * ratio, *LIMITS)
    lctg.register_to_config(modulation_gains=[round(float(value), 4) for value in modulation_gain])
    return lctg.config.modulation_gains


def _power(extractor, textures, sampling_rate):
    """Sum of squares of the fast modulation of each band."""
    waveform, _ = extractor.normalize(textures, sampling_rate)
    return np.square(extractor.fast_modulation(waveform)).sum(axis=(0, 2))

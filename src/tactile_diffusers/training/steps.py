"""The training steps of LCTG and DALE, with their losses, as in the paper (sections 2.2 and 2.3).

| in the paper | here |
|---|---|
| times and noise drawn for a batch | `BatchNoise`, `noisy_batch` |
| v-objective diffusion loss | `velocity_loss` (LCTG), `state_losses` (DALE) |
| optional frequency-aware loss | `frequency_aware_loss` |
| auxiliary conditioning loss | `rating_loss`, on a frozen `RatingEstimator` |
| LCTG, encoder and decoder together | `LCTGTrainingStep` |
| DALE, on latents of the frozen encoder | `DALETrainingStep` |

All losses are computed in float32.
"""

import torch
import torch.nn.functional as F
from torch import nn


class BatchNoise:
    """Random numbers of a batch, the same however the batch is spread over processes.

    Numbers are drawn for all rows of the global batch, and each process keeps its own. So two processes with batches of
    8 train on the noise and the times that one process draws for a batch of 16.

    Args:
        generator (`torch.Generator`): in the same state in every process.
        device (`torch.device`): of the numbers; they are drawn on the generator's.
        share (`tuple[int, int]`, *optional*, defaults to `(0, 1)`): index of this process, and number of processes.
    """

    def __init__(self, generator, device, share=(0, 1)):
        self.generator, self.device = generator, device
        self.index, self.processes = share

    def _rows(self, function, rows, *rest):
        whole = function((rows * self.processes, *rest), generator=self.generator, device=self.generator.device)
        return whole[self.index * rows : (self.index + 1) * rows].to(self.device)

    def normal(self, *shape):
        """Normal numbers (rows, ...) float32, where `rows` are this process's."""
        return self._rows(torch.randn, *shape)

    def uniform(self, *shape):
        """Uniform numbers in [0, 1) (rows, ...) float32, where `rows` are this process's."""
        return self._rows(torch.rand, *shape)

    def stratified(self, rows):
        """Uniform numbers (rows,) float32, stratified: one in each of as many parts of [0, 1) as the batch has rows."""
        first = self.index * rows
        places = torch.arange(first, first + rows, device=self.device) + self.uniform(rows)
        return places / (rows * self.processes)


def noisy_batch(scheduler, clean, random):
    """Adds noise to a batch at random times.

    phi is uniform in [0, pi/2) and stratified over the batch, which makes the loss less noisy from step to step.

    Args:
        scheduler (`VDDIMScheduler`): the model's.
        clean (`torch.Tensor`): (batch, ...).
        random (`BatchNoise`): of this batch.

    Returns:
        `tuple[torch.Tensor, torch.Tensor, torch.Tensor]`: noisy batch (batch, ...), timesteps (batch,), and the
            velocity (batch, ...) that the model has to predict.
    """
    noise = random.normal(*clean.shape)
    timesteps = random.stratified(len(clean)) * scheduler.config.num_train_timesteps - 1
    return scheduler.add_noise(clean, noise, timesteps), timesteps, scheduler.get_velocity(clean, noise, timesteps)


def clean_weight(scheduler, timesteps):
    """cos² phi, (batch,): how much a loss on the predicted clean state counts. Far from the data it is hardly known."""
    return scheduler.angle(timesteps).cos().square()


def velocity_loss(predicted, target, frequency_weights=None):
    """Mean squared error of the velocity, per row: (batch, ...) -> (batch,) (v-objective, arXiv 2202.00512).

    Args:
        predicted, target (`torch.Tensor`): (batch, ...); time last if there are weights.
        frequency_weights (`torch.Tensor`, *optional*): (samples // 2 + 1,), see `octave_weights`. Weights move the
            network's effort between frequencies, not its optimum: the best velocity is the same for any of them.
    """
    if frequency_weights is None:
        return F.mse_loss(predicted.float(), target.float(), reduction="none").flatten(1).mean(1)
    spectrum = torch.fft.rfft(predicted.float() - target.float(), norm="ortho")
    return ((spectrum.real.square() + spectrum.imag.square()) * frequency_weights).flatten(1).mean(1)


def octave_weights(samples, sampling_rate, band, exponent):
    """Weights proportional to frequency ** -exponent, constant outside the band, of mean one.

    A whitened texture has equal power in every hertz, so its lowest band of nine holds 1 % of the loss and the highest
    a third. With exponent 1 every octave counts the same, as it does for touch.

    Args:
        samples (`int`): of the waveform.
        sampling_rate (`float`): Hz.
        band (`tuple[float, float]`): Hz.
        exponent (`float`): 0 = flat.

    Returns:
        `torch.Tensor`: (samples // 2 + 1,) float32.
    """
    frequencies = torch.arange(samples // 2 + 1) * (sampling_rate / samples)
    weights = frequencies.clamp(*band) ** -exponent
    return weights / weights.mean()


def frequency_aware_loss(predicted, target, window_lengths=(64, 256, 1024)):
    """The paper's optional frequency-aware loss (section 2.2), per row: spectra of predicted and clean waveforms.

    Mean absolute difference of log magnitudes over several window lengths (the multi-resolution form of Yamamoto et
    al. 2020, Parallel WaveGAN). Long windows resolve low frequencies, short ones resolve events.

    Args:
        predicted, target (`torch.Tensor`): (batch, samples), unit RMS.
        window_lengths (`tuple[int, ...]`): samples; windows longer than the signal are left out.

    Returns:
        `torch.Tensor`: (batch,).
    """
    losses = []
    for length in window_lengths:
        if length > predicted.shape[-1]:
            continue
        window = torch.hann_window(length, device=predicted.device)
        magnitudes = []
        for waveform in (predicted, target):
            spectrum = torch.stft(waveform.float(), length, length // 4, window=window, return_complex=True)
            # unit-RMS white noise has magnitude about 1 after the division; 0.05 keeps silence out of the logarithm
            magnitudes.append(torch.log(spectrum.abs() / window.square().sum().sqrt() + 0.05))
        losses.append((magnitudes[0] - magnitudes[1]).abs().mean(dim=2).mean(dim=1))
    return torch.stack(losses).mean(0)


def rating_loss(estimated, requested):
    """Mean squared difference of ratings over the specified axes, per row.

    Args:
        estimated (`torch.Tensor`): (batch, axes), z-scores from a `RatingEstimator`.
        requested (`torch.Tensor`): (batch, axes), z-scores; NaN = not specified, left out.

    Returns:
        `torch.Tensor`: (batch,); 0 where nothing was specified.
    """
    specified = ~torch.isnan(requested)
    difference = torch.where(specified, estimated - torch.nan_to_num(requested), torch.zeros_like(estimated))
    return difference.square().sum(-1) / specified.sum(-1).clamp_min(1)


def state_losses(dale, difference, knows_friction, weight):
    """Mean squared error of DALE's velocity: of what varies over the texture, and of the numbers of the whole texture.

    Args:
        dale (`DALEModel`): splits a state into these parts.
        difference (`torch.Tensor`): (batch, in_channels, frames), velocity minus its target.
        knows_friction (`torch.Tensor`): (batch,) bool; an unknown friction coefficient is left out.
        weight (`torch.Tensor`): (batch,), how much each texture counts.

    Returns:
        `tuple[torch.Tensor, torch.Tensor]`: two scalars.
    """
    squares = dale.pool_state(difference.float()).square() * weight[:, None, None]
    learned, departures, scalars = squares.split(dale.channel_groups, dim=1)
    known = torch.ones_like(scalars[..., 0])
    known[:, -1] = knows_friction
    return sum(part.mean() for part in (learned, departures) if part.numel()), (scalars.mean(-1) * known).mean()


def drop_detail(latents, base_channels, probability, random):
    """Latents (batch, channels, frames) of which some rows lose their detail layer, as generated latents do."""
    kept = random.uniform(len(latents), 1, 1) >= probability
    return torch.cat([latents[:, :base_channels], latents[:, base_channels:] * kept], dim=1)


class LCTGTrainingStep(nn.Module):
    """Loss of LCTG on a batch: the v-objective with noise on the latents, and the frequency-aware loss if asked for.

    `forward(batch, random)` takes `{"waveform": (batch, samples), "input_features": (batch, channels, frames)}` and a
    `BatchNoise`; it returns the loss and a dict of scalars to log.

    Args:
        model (`LCTGModel`): is trained.
        scheduler (`VDDIMScheduler`): of the decoder.
        extractor (`TactileFeatureExtractor`): made the batch.
        octave_exponent (`float`): the velocity loss is weighted by frequency ** -exponent; 0 = flat, as in the paper.
        spectral_loss_weight (`float`): of the frequency-aware loss; 0 = off.
        latent_penalty (`float`): of the mean square of the learned latents; 0 = off. Against the noise on the latents a
            bounded channel saturates; where power costs, it comes near to a Gaussian.
        detail_dropout (`float`): share of textures without detail layer.
    """

    def __init__(
        self,
        model,
        scheduler,
        extractor,
        octave_exponent=1.0,
        spectral_loss_weight=0.0,
        latent_penalty=0.0,
        detail_dropout=0.5,
    ):
        super().__init__()
        self.model, self.scheduler = model, scheduler
        self.octave_exponent, self.spectral_loss_weight = octave_exponent, spectral_loss_weight
        self.latent_penalty, self.detail_dropout = latent_penalty, detail_dropout
        self.rate_and_band = (extractor.sampling_rate, extractor.band)

    def forward(self, batch, random):
        clean, features = batch["waveform"][:, None], batch["input_features"]
        latents = self.model.encode(features)
        decoder_latents = self.noisy_latents(latents, random)
        noisy, timesteps, target = noisy_batch(self.scheduler, clean, random)
        velocity = self.model(noisy, timesteps, decoder_latents, return_dict=False)[0]
        weights = None
        if self.octave_exponent:
            weights = octave_weights(clean.shape[-1], *self.rate_and_band, self.octave_exponent).to(clean.device)
        loss = velocity_loss(velocity, target, weights).mean()
        scalars = {"velocity": loss.detach()}
        if self.spectral_loss_weight:
            predicted = self.scheduler.get_original_sample(velocity.float(), noisy, timesteps)
            spectral = frequency_aware_loss(predicted[:, 0], clean[:, 0])
            # far from the data the prediction is an average, which has no texture's spectrum
            spectral = (spectral * clean_weight(self.scheduler, timesteps).to(clean.device)).mean()
            loss = loss + self.spectral_loss_weight * spectral
            scalars["spectral"] = spectral.detach()
        if self.latent_penalty:
            power = latents[:, self.model.passed_channels : self.model.base_channels].square().mean()
            loss = loss + self.latent_penalty * power
            scalars["latent_power"] = power.detach()
        return loss, scalars

    def noisy_latents(self, latents, random):
        """Latents with noise, and in some rows without their detail layer."""
        latents = latents + self.model.config.latent_noise * random.normal(*latents.shape)
        if self.model.config.detail_channels:
            latents = drop_detail(latents, self.model.base_channels, self.detail_dropout, random)
        return latents


def drawn_ratings(batch, random, condition_dropout=0.4, unconditional=0.1, rating_jitter=0.3):
    """Ratings (batch, axes) of one rater, or pooled ones with jitter; dropped axes are NaN.

    Args:
        batch (`dict`): "ratings" and "ratings_error" of `dale_data.training_states`. Of several raters' ratings (batch,
            raters, axes), those of one who rated its surface are drawn for each texture.
        random (`BatchNoise`): of this batch.
        condition_dropout, unconditional, rating_jitter (`float`): of `DALETrainingStep`.
    """
    ratings = batch["ratings"]
    if ratings.ndim == 3:
        rated = (~ratings.isnan()).any(-1).cumsum(1)  # of raters that did not rate the texture's surface, none is drawn
        place = (random.uniform(len(ratings)) * rated[:, -1]).long()
        rater = (rated <= place[:, None]).sum(1).clamp(max=ratings.shape[1] - 1)
        ratings = ratings[torch.arange(len(ratings), device=ratings.device), rater]
    else:
        ratings = ratings + rating_jitter * batch["ratings_error"] * random.normal(*ratings.shape)
    dropped = random.uniform(*ratings.shape) < condition_dropout
    dropped = dropped | (random.uniform(len(ratings), 1) < unconditional)
    return ratings.masked_fill(dropped, torch.nan)


class DALETrainingStep(nn.Module):
    """Loss of DALE on a batch: the v-objective in latent space with dropped ratings, and the auxiliary rating loss.

    `forward(batch, random)` takes rows of `dale_data.training_states` and a `BatchNoise`; it returns the loss and a
    dict of scalars to log.

    Args:
        model (`DALEModel`): is trained.
        scheduler (`VDDIMScheduler`): DALE's.
        rating_estimator (`RatingEstimator` or `None`): frozen, on the same device; needed for the auxiliary loss.
        condition_dropout (`float`): probability of dropping each axis of the ratings.
        unconditional (`float`): probability of dropping all axes.
        rating_jitter (`float`): standard deviation of noise on pooled ratings, in standard errors of their mean.
        scalar_weight (`float`): loss weight of the numbers that a whole texture has one of.
        conditioning_weight (`float`): of the auxiliary rating loss; 0 = off.
    """

    def __init__(
        self,
        model,
        scheduler,
        rating_estimator,
        condition_dropout=0.4,
        unconditional=0.1,
        rating_jitter=0.3,
        scalar_weight=3.0,
        conditioning_weight=0.1,
    ):
        super().__init__()
        self.model, self.scheduler = model, scheduler
        self.rating_estimator = [rating_estimator]  # in a list: it is not trained, averaged or saved
        self.condition_dropout, self.unconditional, self.rating_jitter = condition_dropout, unconditional, rating_jitter
        self.scalar_weight, self.conditioning_weight = scalar_weight, conditioning_weight

    def forward(self, batch, random):
        clean, knows_friction, weight = batch["state"], batch["knows_friction"], batch["weight"]
        ratings = drawn_ratings(batch, random, self.condition_dropout, self.unconditional, self.rating_jitter)
        noisy, timesteps, target = noisy_batch(self.scheduler, clean, random)
        velocity = self.model(noisy, timesteps, ratings, return_dict=False)[0].float()
        latent_loss, scalar_loss = state_losses(self.model, velocity - target, knows_friction, weight)
        loss = latent_loss + self.scalar_weight * scalar_loss
        scalars = {"velocity": latent_loss.detach(), "scalars": scalar_loss.detach()}
        if self.conditioning_weight:
            predicted = self.model.pool_state(self.scheduler.get_original_sample(velocity, noisy, timesteps))
            estimated = self.rating_estimator[0](predicted, knows_friction)
            conditioning = clean_weight(self.scheduler, timesteps) * weight * rating_loss(estimated, ratings)
            conditioning = conditioning.mean()
            loss = loss + self.conditioning_weight * conditioning
            scalars["conditioning"] = conditioning.detach()
        return loss, scalars

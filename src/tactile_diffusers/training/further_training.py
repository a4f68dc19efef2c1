"""Further training on a lab's surfaces: of the fields of a DALE of one step, and of the decoder where it knows less.

Fields are what varies over a texture. How well a decoder knows the textures of a lab is measured first.
"""

import copy
from dataclasses import dataclass

import numpy as np
import torch
from tqdm.auto import tqdm

from ..signal import nine_band_error_db, resample
from ..signal.waveform_shape import waveform_shape
from .batches import make_collate
from .loop import Trainer
from .one_step import DecoderStep, LatentStep
from .record import surfaces_of
from .steps import BatchNoise

#: Of the training of fields.
BATCH, LEARNING_RATE, BETAS = 32, 2e-4, (0.9, 0.99)
#: With fewer it can lose more than the two that are left out show: with five, the kernel distance doubled.
LEAST_FOR_FIELDS = 20
#: Textures of left-out surfaces by which the training of fields is judged: of more, so many to nearly twice as many.
JUDGED = 256
#: Textures at most by which the decoder is judged.
DECODED = 32
#: By how much worse than its own textures it may give a lab's back: factor of the bands' error, and shift of the shapes
#: of waveforms in standard deviations over textures.
BANDS_FACTOR, SHAPE_SHIFT = 2.0, 0.5
#: Share of the surfaces, and at least how many, that a training leaves out; with fewer than so many there is none.
LEFT_OUT, LEAST_LEFT_OUT, LEAST_SURFACES = 0.1, 2, 5
#: Share of textures that are decoded without detail layer, as generated ones are.
DETAIL_DROPOUT = 0.7


def train_fields(dale, scheduler, states, left_out, updates, seed, quiet=True):
    """Trains the U-Net of a DALE further and keeps that if it helps surfaces that are left out.

    The network of scalars stays: what ratings do to level, spectrum and friction is recalibrated in closed form, which
    few surfaces tell better. A minute or two; it is not resumed, a second time gives the same weights.

    Args:
        dale (`DALEModel`): of one step; is changed.
        scheduler (`VDDIMScheduler`): DALE's.
        states (`dict[str, torch.Tensor]`): of `training_states`.
        left_out (`np.ndarray`): (n,) bool, textures of the surfaces that judge.
        updates (`int`): of its weights.
        seed (`int`): of batches and noise.
        quiet (`bool`): no progress bar.

    Returns:
        `str`: what it did to surfaces left out, a sentence.
    """
    device, left_out = next(dale.parameters()).device, torch.from_numpy(left_out)
    judges = left_out.nonzero()[:, 0][:: max(1, int(left_out.sum()) // JUDGED)]
    held_out = {name: values[judges].to(device) for name, values in states.items()}
    states = {name: values[~left_out].to(device) for name, values in states.items()}
    given, step = copy.deepcopy(dale.state_dict()), LatentStep(dale, scheduler, states["state"])

    @torch.no_grad()
    def judge():
        return float(step(held_out, BatchNoise(torch.Generator().manual_seed(seed), device))[0])

    before = judge()
    weights = [value for name, value in dale.named_parameters() if not name.startswith("scalar_network")]
    generator = torch.Generator(device).manual_seed(seed)

    def loss():
        rows = torch.randint(len(states["state"]), (BATCH,), generator=generator, device=device)
        return step({name: values[rows] for name, values in states.items()}, BatchNoise(generator, device))[0]

    dale.train()
    descend(weights, loss, updates, LEARNING_RATE, "fields", quiet)
    dale.eval()
    after = judge()
    text = f"DALE's U-Net, what varies over a texture, was trained for {updates} updates: its energy score on surfaces "
    text += f"left out went from {before:.3f} to {after:.3f}"
    if after < before:
        return f"{text}."
    dale.load_state_dict(given)
    return f"{text}, so it stays as it is."


def descend(weights, loss, updates, learning_rate, desc, quiet=False):
    """So many updates of the weights (a list) down `loss()`, each of a batch of its own, in one cycle of the rate."""
    optimizer = torch.optim.AdamW(weights, lr=learning_rate, betas=BETAS, weight_decay=0.0)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, learning_rate, updates)
    for _ in tqdm(range(updates), disable=quiet, desc=desc):
        found = loss()
        optimizer.zero_grad()
        found.backward()
        torch.nn.utils.clip_grad_norm_(weights, 1.0)
        optimizer.step()
        schedule.step()


@dataclass(frozen=True)
class DecoderFit:
    """Errors of the decoder from base layers: of nine bands, dB, and of the shape of waveforms, standard deviations.

    `own_bands` and `own_shift` are those of the textures that the pipeline generates itself.
    """

    bands: float
    shift: float
    own_bands: float
    own_shift: float

    @property
    def knows(self):
        """Whether the decoder knows the lab's textures as well as its own."""
        return self.bands <= BANDS_FACTOR * self.own_bands and self.shift <= self.own_shift + SHAPE_SHIFT

    def words(self):
        """A sentence."""
        text = (
            f"From their base layer the decoder (LCTG) gives nine bands back within {self.bands:.2f} dB and shifts the "
            f"shape of waveforms by {self.shift:.1f} standard deviations; of its own textures, {self.own_bands:.2f} dB "
            f"and {self.own_shift:.1f}"
        )
        return f"{text}." if self.knows else f"{text}: it knows yours less well."


def judge_decoder(pipe, dataset, seed):
    """The `DecoderFit` of a pipeline's decoder to a data set."""
    rows = np.linspace(0, len(dataset) - 1, min(DECODED, len(dataset))).round().astype(int)
    own = decoder_errors(pipe, dataset.textures(rows), dataset.sampling_rate, seed)
    ratings = np.full((len(rows), len(pipe.dale.config.rating_axes)), np.nan)
    made = pipe(ratings, generator=torch.Generator().manual_seed(seed))
    return DecoderFit(*own, *decoder_errors(pipe, made.textures, made.sampling_rate, seed))


def decoder_errors(pipe, textures, sampling_rate, seed):
    """Textures (n, samples), encoded and decoded from their base layer: nine-band error, dB, and largest shift of a
    statistic of `waveform_shape` in its standard deviations over textures."""
    encoded = pipe.encode(textures, sampling_rate)
    latents = pipe.lctg.pad_detail(encoded.latents[:, : pipe.lctg.base_channels])
    out = pipe.decode(latents, encoded.level, generator=torch.Generator().manual_seed(seed))
    wanted = resample(textures, sampling_rate, out.sampling_rate)
    samples = min(wanted.shape[-1], out.textures.shape[-1])
    made, wanted = out.textures[:, :samples], wanted[:, :samples]
    shapes, theirs = waveform_shape(made), waveform_shape(wanted)
    shifts = [abs(shapes[k].mean() - v.mean()) / max(v.std(), 1e-6) for k, v in theirs.items()]
    return float(nine_band_error_db(made, wanted, out.sampling_rate).mean()), float(max(shifts))


def train_decoder(pipe, dataset, args, accelerator):
    """Trains `lctg_distilled` further on a lab's textures and keeps it if that helps surfaces that are left out.

    Its encoder stays, so latents, DALE and the teacher `lctg` stay as they are.

    Args:
        pipe (`TactileTexturePipeline`): with an `lctg_distilled`, which is replaced.
        dataset (`PreparedDataset`): at the pipeline's working rate, of `LEAST_SURFACES` or more.
        args (`argparse.Namespace`): of the training.
        accelerator (`Accelerator`): of it.

    Returns:
        `str`: what it did to surfaces left out, a sentence.
    """
    out = left_out(dataset, args.seed)
    collate = make_collate(pipe.feature_extractor, dataset.sampling_rate)
    student = copy.deepcopy(pipe.lctg_distilled)
    step = DecoderStep(student, pipe.scheduler, pipe.feature_extractor, DETAIL_DROPOUT)
    validate = make_validation(step, collate, dataset, np.flatnonzero(out))
    before = validate(student.eval())["energy"]
    kept = torch.utils.data.Subset(dataset, np.flatnonzero(~out).tolist())
    args.train_batch_size = min(args.train_batch_size, len(kept) // accelerator.num_processes)
    student = Trainer(accelerator, args, step, "lctg", kept, collate, validate, surfaces_of(dataset)).run()
    after = validate(student)["energy"]
    text = f"trained for {args.max_train_steps} updates: its energy score on surfaces left out went from {before:.3f} "
    if after >= before:
        return f"The decoder was {text}to {after:.3f}, so it stays as it is."
    pipe.register_modules(lctg_distilled=student)
    return f"The decoder of one step was {text}to {after:.3f}. Calls of more steps take the teacher, which stays."


def left_out(dataset, seed):
    """Which segments of a data set are of surfaces that judge a training: (n,) bool."""
    ids = np.random.default_rng(seed).permutation(np.unique(dataset.surface_ids))
    return np.isin(dataset.surface_ids, ids[: max(LEAST_LEFT_OUT, round(LEFT_OUT * len(ids)))])


def make_validation(step, collate, dataset, rows):
    """`validate(model)`: energy score of the decoder on so many rows of a data set, with the same noise each time."""
    rows = rows[np.linspace(0, len(rows) - 1, min(DECODED, len(rows))).round().astype(int)]
    batch = collate([dataset[int(row)] for row in rows])

    @torch.no_grad()
    def validate(model):
        device = next(model.parameters()).device
        random = BatchNoise(torch.Generator().manual_seed(0), device)
        return {"energy": float(step({name: value.to(device) for name, value in batch.items()}, random)[0])}

    return validate

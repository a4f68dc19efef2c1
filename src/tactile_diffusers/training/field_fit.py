"""Further training of what varies over a texture, the fields of a DALE of one step, on a lab's surfaces."""

import copy

import torch
from tqdm.auto import tqdm

from .latent_step import LatentStep
from .steps import BatchNoise

BATCH, LEARNING_RATE, BETAS = 32, 2e-4, (0.9, 0.99)
#: With fewer it can lose more than the two that are left out show: with five, the kernel distance doubled.
LEAST_SURFACES = 20
#: Textures of left-out surfaces at most by which the training is judged.
JUDGED = 256


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
        return float(step(held_out, BatchNoise(torch.Generator(device).manual_seed(seed), device))[0])

    before = judge()
    weights = [value for name, value in dale.named_parameters() if not name.startswith("scalar_network")]
    optimizer = torch.optim.AdamW(weights, lr=LEARNING_RATE, betas=BETAS, weight_decay=0.0)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, LEARNING_RATE, updates)
    generator = torch.Generator(device).manual_seed(seed)
    dale.train()
    for _ in tqdm(range(updates), disable=quiet, desc="fields"):
        rows = torch.randint(len(states["state"]), (BATCH,), generator=generator, device=device)
        loss = step({name: values[rows] for name, values in states.items()}, BatchNoise(generator, device))[0]
        optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(weights, 1.0)
        optimizer.step()
        schedule.step()
    dale.eval()
    after = judge()
    text = f"DALE's U-Net, what varies over a texture, was trained for {updates} updates: its energy score on surfaces "
    text += f"left out went from {before:.3f} to {after:.3f}"
    if after < before:
        return f"{text}."
    dale.load_state_dict(given)
    return f"{text}, so it stays as it is."

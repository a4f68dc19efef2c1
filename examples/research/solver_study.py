"""Speed against error of solvers: analytic velocities, for which the truth is known, and trained models."""

import time

import numpy as np
import torch
from diffusers import DDIMScheduler, DPMSolverMultistepScheduler
from scipy import signal
from solvers import RULES, run

from tactile_diffusers.evaluation.metrics.errors import rmse
from tactile_diffusers.evaluation.metrics.statistics import leaf, number
from tactile_diffusers.schedulers import VDDIMScheduler
from tactile_diffusers.schedulers.scheduling_v_ddim import SPACINGS, spaced_angles
from tactile_diffusers.signal import band_levels_db, nine_band_error_db, resample, rms

#: Steps of every comparison (issue: speed against error).
STEPS = (1, 2, 3, 4, 5, 6, 8, 10, 15, 20, 25, 50, 100)
#: Standard deviations of single Gaussian components; whitened textures lie between 0.3 and 3.
COMPONENTS = (1e-3, 3e-3, 0.01, 0.03, 0.1, 0.2, 0.3, 0.5, 1.0, 2.0, 3.0, 5.0, 8.0)
#: Steps of a reference trajectory.
REFERENCE_STEPS = 1000
# a mixture of four Gaussians of unit variance in all: modes, weights, standard deviations
_MODES = np.array([-1.2, -0.3, 0.4, 1.3])
_WEIGHTS = np.array([0.2, 0.3, 0.3, 0.2])
_SPREADS = np.array([0.15, 0.25, 0.2, 0.1])
_SAMPLES, _FINE = 5000, 4000


def component_levels(rule, steps, spacing="uniform", spreads=COMPONENTS):
    """Level error in dB of single Gaussian components, whose exact path ends at s times the noise: (components,)."""
    s = np.asarray(spreads, dtype=np.float64)

    def velocity(x, phi):
        cos, sin = np.cos(phi), np.sin(phi)
        return x * (1 - s**2) * sin * cos / ((s * cos) ** 2 + sin**2)

    made = run(RULES[rule], spaced_angles(steps, spacing), velocity, np.ones_like(s))
    return 20 * np.log10(np.maximum(np.abs(made), 1e-30) / s)


def mixture_velocity():
    """The exact velocity of a one-dimensional Gaussian mixture of zero mean and unit variance."""
    mean = (_WEIGHTS * _MODES).sum()
    scale = np.sqrt((_WEIGHTS * (_SPREADS**2 + _MODES**2)).sum() - mean**2)
    modes, spreads = (_MODES - mean) / scale, _SPREADS / scale

    def velocity(x, phi):
        cos, sin = np.cos(phi), np.sin(phi)
        variance = (spreads * cos) ** 2 + sin**2
        offset = x[:, None] - cos * modes
        logs = np.log(_WEIGHTS) - 0.5 * np.log(variance) - 0.5 * offset**2 / variance
        weights = np.exp(logs - logs.max(1, keepdims=True))
        weights /= weights.sum(1, keepdims=True)
        data = (weights * (modes + spreads**2 * cos / variance * offset)).sum(1)
        return (cos * x - data) / sin

    return velocity


def mixture_errors(rules=tuple(RULES), spacings=SPACINGS, steps=(*STEPS, 40, 80, 160), seed=0):
    """Errors on the mixture: rule -> spacing -> steps -> {"rms", "median"}; and observed orders of the median."""
    velocity, noise = mixture_velocity(), np.random.default_rng(seed).standard_normal(_SAMPLES)
    truth = run(RULES["rotation_2"], spaced_angles(_FINE, "both_ends"), velocity, noise)
    errors, orders = {}, {}
    for rule in rules:
        errors[rule], orders[rule] = {}, {}
        for spacing in spacings:
            found = {}
            for count in sorted(steps):
                error = np.abs(run(RULES[rule], spaced_angles(count, spacing), velocity, noise) - truth)
                found[str(count)] = {"rms": float(np.sqrt((error**2).mean())), "median": float(np.median(error))}
            errors[rule][spacing] = found
            if {"20", "160"} <= set(found):
                orders[rule][spacing] = float(np.log2(found["20"]["median"] / found["160"]["median"]) / 3)
    return errors, orders


def texture_deviations(pipe, textures, sampling_rate, whitened):
    """Standard deviations of a texture's components, in units in which the diffused waveform has RMS 1.

    A stationary texture is a correlated Gaussian whose independent components are its frequencies: 64 bands between 0
    and half the working rate, those inside of the texture band kept.

    Args:
        pipe (`TactileTexturePipeline`): its feature extractor whitens.
        textures (`np.ndarray`): (n, samples), N.
        sampling_rate (`int`): Hz.
        whitened (`bool`): by the pre-emphasis of the checkpoint, or not at all.

    Returns:
        `np.ndarray`: (n, components).
    """
    extractor = pipe.feature_extractor
    if whitened:
        waves = np.asarray(extractor.normalize(textures, sampling_rate)[0], dtype=np.float64)
    else:
        waves = resample(textures, sampling_rate, extractor.sampling_rate)
    waves = waves / rms(waves)[:, None]
    frequencies, density = signal.welch(waves, fs=extractor.sampling_rate, nperseg=128, axis=-1)
    inside = (frequencies >= extractor.band[0]) & (frequencies <= extractor.band[1])
    return np.sqrt(density[:, inside] * extractor.sampling_rate / 2)


def spectrum_levels(deviations, steps=STEPS, rules=tuple(RULES), spacings=SPACINGS):
    """Level errors over all components of textures: rule -> spacing -> steps -> {"lowest", "highest", "mean"} dB."""
    kinds = {"lowest": np.min, "highest": np.max, "mean": lambda levels: np.abs(levels).mean()}
    return {
        rule: {
            spacing: {
                str(count): {
                    kind: float(of(component_levels(rule, count, spacing, deviations))) for kind, of in kinds.items()
                }
                for count in steps
            }
            for spacing in spacings
        }
        for rule in rules
    }


class TrainedStage:
    """LCTG or DALE as a velocity, with fixed noise and conditions.

    Args:
        pipe (`TactileTexturePipeline`): the checkpoint.
        stage (`str`): "lctg" or "dale".
        real (`np.ndarray`): (n, samples) held-out textures, which LCTG reconstructs.
        ratings (`np.ndarray`): (n, 3) of DALE.
        sampling_rate (`int`): of `real`, Hz.
        seed (`int`): of the noise.
    """

    def __init__(self, pipe, stage, real, ratings, sampling_rate, seed=0):
        self.pipe, self.stage, generator = pipe, stage, torch.Generator("cpu").manual_seed(seed)
        if stage == "lctg":
            self.made = pipe.encode(real, sampling_rate)
            samples = self.made.latents.shape[-1] * pipe.lctg.config.latent_hop
            self.noise = torch.randn(len(real), 1, samples, generator=generator)
        else:
            self.ratings = torch.as_tensor(ratings, dtype=torch.float32)
            shape = (len(ratings), pipe.dale.config.in_channels, pipe.dale.config.latent_frames)
            self.noise = torch.randn(shape, generator=generator)

    @torch.no_grad()
    def velocity(self, x, timestep, rows=slice(None)):
        """v of some rows at a timestep of the scheduler, for a state of any precision."""
        if self.stage == "lctg":
            v = self.pipe.lctg(x.float(), timestep, self.made.latents[rows], return_dict=False)[0]
        else:
            v = self.pipe.dale(x.float(), timestep, self.ratings[rows], return_dict=False)[0]
        return v.to(x.dtype)

    def solve(self, scheduler, steps, batch=8, seconds=None):
        """The stage's result: a tensor of the noise's shape, float64; the state is float64 throughout.

        `seconds`: a list to which the seconds per segment of each batch are added.
        """
        parts = []
        for start in range(0, len(self.noise), batch):
            rows, begun = slice(start, start + batch), time.perf_counter()
            scheduler.set_timesteps(steps)
            x = self.noise[rows].double()
            for t in scheduler.timesteps:
                x = scheduler.step(self.velocity(scheduler.scale_model_input(x, t), t, rows), t, x).prev_sample
            parts.append(x)
            if seconds is not None:
                seconds.append((time.perf_counter() - begun) / len(x))
        return torch.cat(parts)

    def textures(self, x, samples):
        """Textures in N of LCTG's results."""
        restored = self.pipe.lctg.restored(self.made.latents)
        return self.pipe.feature_extractor.denormalize(x[:, 0].float(), self.made.level, samples, **restored)


def schedulers(order_2_spacings=("uniform", "both_ends")):
    """Name -> scheduler of the trained comparison: ours, and diffusers' on exactly the same schedule."""
    ours = VDDIMScheduler()
    exact = {"trained_betas": ours.betas.tolist()}
    made = {"order 1, uniform": ours}
    for spacing in order_2_spacings:
        made[f"order 2, {spacing}"] = VDDIMScheduler(multistep_order=2, spacing=spacing)
    made["diffusers DDIM"] = DDIMScheduler.from_config(ours.config, set_alpha_to_one=True, **exact)
    made["diffusers DPM-Solver++ 2M"] = DPMSolverMultistepScheduler.from_config(
        ours.config, algorithm_type="dpmsolver++", solver_order=2, final_sigmas_type="zero", **exact
    )
    return made


def trained_errors(stage, real=None, sampling_rate=None, reference=None, steps=STEPS, quiet=True):
    """Solver error against steps, and what it does to textures.

    Args:
        stage (`TrainedStage`): LCTG or DALE.
        real, sampling_rate, reference: of LCTG: textures, their rate, and the `Reference` of KTD.
        steps (`Sequence[int]`): to compare.
        quiet (`bool`): no progress bar.

    Returns:
        `dict`: scheduler -> steps -> leaves "solver_rms", "seconds" (per segment, of the fastest batch: others may work
        on the machine) and, for LCTG, "nine_band_db", "rmse_n", "ktd" and
        "bands_db" (nine leaves, signed, against the reference trajectory).
    """
    from tqdm.auto import tqdm

    made, groups = schedulers(), np.arange(len(stage.noise))
    truth = stage.solve(VDDIMScheduler(multistep_order=2, spacing="both_ends"), REFERENCE_STEPS)
    if stage.stage == "lctg":
        true_bands = band_levels_db(stage.textures(truth, real.shape[-1]), sampling_rate)
    found = {name: {} for name in made}
    for name, count in tqdm([(n, c) for n in made for c in steps], disable=quiet, desc=f"solvers on {stage.stage}"):
        seconds = []
        x = stage.solve(made[name], count, seconds=seconds)
        error = (x - truth).square().mean((1, 2)).sqrt().numpy()
        entry = {"solver_rms": leaf(error), "seconds": number(min(seconds), len(seconds))}
        if stage.stage == "lctg":
            textures = stage.textures(x, real.shape[-1])
            bands = band_levels_db(textures, sampling_rate) - true_bands
            entry |= {
                "nine_band_db": leaf(nine_band_error_db(textures, real, sampling_rate)),
                "rmse_n": leaf(rmse(textures, real)),
                "bands_db": [leaf(band) for band in bands.T],
                "ktd": reference.distances(reference.embed(textures), groups)["ktd"],
            }
        found[name][str(count)] = entry
    return found


def trained_rules(stage, steps=(3, 4, 5, 10), rules=tuple(RULES), spacings=SPACINGS, quiet=True):
    """Solver error on a trained model of all that was tried: rule -> spacing -> steps -> leaf (RMS over the state)."""
    from tqdm.auto import tqdm

    truth = stage.solve(VDDIMScheduler(multistep_order=2, spacing="both_ends"), REFERENCE_STEPS)
    length = stage.pipe.lctg.config.num_train_timesteps

    def velocity(x, phi):
        return stage.velocity(x, phi / (np.pi / 2) * length - 1)

    found = {rule: {spacing: {} for spacing in spacings} for rule in rules}
    cases = [(rule, spacing, count) for rule in rules for spacing in spacings for count in steps]
    for rule, spacing, count in tqdm(cases, disable=quiet, desc=f"rules on {stage.stage}"):
        x = run(RULES[rule], spaced_angles(count, spacing), velocity, stage.noise.double())
        found[rule][spacing][str(count)] = leaf((x - truth).square().mean((1, 2)).sqrt().numpy())
    return found


def settled_at(by_steps, metric):
    """The fewest steps from which on a metric stays within its own noise of the best, None where it does not apply.

    Noise: the standard error of the mean over surfaces, a quarter of the width of the best's 95 % interval.
    """
    leaves = sorted((int(count), entry[metric]) for count, entry in by_steps.items() if entry[metric]["interval"])
    if not leaves:
        return None
    best = min((leaf for _, leaf in leaves), key=lambda leaf: leaf["mean"])
    limit = best["mean"] + (best["interval"][1] - best["interval"][0]) / 4
    far = [index for index, (_, leaf) in enumerate(leaves) if leaf["mean"] > limit]
    return leaves[far[-1] + 1 if far else 0][0] if not far or far[-1] + 1 < len(leaves) else None

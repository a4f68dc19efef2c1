"""Adapts a pretrained pipeline to the few surfaces of a lab: recalibration in closed form, then a short training.

How much it helps is measured on surfaces that are left out, and said in words.
"""

from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path

import numpy as np
import torch
from sklearn.linear_model import Ridge

from ..data.checkpoint_fit import check_fit
from ..data.ratings import check_axes
from .card import finish
from .dale_data import encode_dataset, mean_and_std, training_states
from .decoder_words import decoder_words
from .energy import StateViews, energy_score
from .energy_step import LatentStep
from .launch import make_accelerator, training_parser
from .loop import Trainer
from .new_axes import add_axes, carried_words
from .recalibration import TAKES, Surfaces, generate_surfaces, recalibrate, scalars_of, spectra_db
from .record import read_log, surfaces_of, write_record
from .steps import DALETrainingStep
from .verdict import Errors, verdict_of

#: Fewer surfaces are recalibrated only (examples/results/adaptation.md).
FINE_TUNED_FROM = 20
#: Parts that are left out in turn, and the share of surfaces that the trial of the training leaves out.
FOLDS, LEFT_OUT = 10, 0.2
#: Where the trial writes, inside the output folder.
TRIAL = "trial"
#: Real textures at most by which a validation judges.
JUDGED = 128
DEFAULTS = {
    "train_batch_size": 64,
    "learning_rate": 2e-4,
    "lr_warmup_steps": 20,
    "max_train_steps": 200,
    "adam_weight_decay": 0.0,
    "ema_decay": 0.99,
    "checkpointing_steps": 50,
    "validation_steps": 50,
    "report_to": "none",
}


def adaptation_parser(description, **defaults):
    """The parser of `examples/adapt.py`: the arguments of all trainings, and when DALE is trained."""
    parser = training_parser(description, **DEFAULTS | defaults)
    help = f"train DALE after its recalibration; auto = from {FINE_TUNED_FROM} surfaces on"
    parser.add_argument("--fine_tuning", choices=["auto", "yes", "no"], default="auto", help=help)
    return parser


def adapt(pipe, dataset, output_dir, args=None, **options):
    """Adapts a pipeline to a lab's surfaces and writes it, with its card, into a folder.

    Args:
        pipe (`TactileTexturePipeline`): pretrained; its DALE is changed.
        dataset (`PreparedDataset`): a few surfaces, two at least, at the pipeline's working rate.
        output_dir (`str` or `Path`): of the adapted pipeline, checkpoints and logs.
        args (`argparse.Namespace`, *optional*): of `adaptation_parser`; defaults to its defaults.
        options: of the parser, in place of those in `args`.

    Returns:
        `tuple[TactileTexturePipeline, str]`: the adapted pipeline, and the verdict.

    Raises:
        ValueError: before any work, if there is nothing to adapt to, or the data do not fit the pipeline.
    """
    check_adaptable(pipe, dataset)
    if args is None:
        words = ["--train_data_dir", str(dataset.path), "--output_dir", str(output_dir)]
        args = adaptation_parser("").parse_args(words)
        args.quiet = True
    vars(args).update(output_dir=str(output_dir), **options)
    accelerator = make_accelerator(args)
    say = accelerator.print
    lab = Lab.read(pipe, dataset, args)
    lines = [*lab.what_is_adapted(), decoder_words(pipe, dataset, args.seed)]
    say(*lines, sep="\n")
    judged = judge_recalibration(lab)
    say(judged["zero-shot"].words("As it is, the given checkpoint"))
    trains = args.fine_tuning == "yes" or (args.fine_tuning == "auto" and len(lab.real) >= FINE_TUNED_FROM)
    updates, trial = run_trial(lab, args) if trains else (0, None)
    everything = np.arange(len(lab.real))
    lab.recalibrate(pipe.dale, everything)
    args.max_train_steps = updates
    if updates:
        pipe.register_modules(dale=_trainer(lab, pipe.dale, everything, args, accelerator, None).run())
    elif accelerator.is_main_process:
        write_record(args, accelerator, len(dataset), 0, surfaces_of(dataset))
    verdict = verdict_of(judged, updates, trial, trains)
    say(verdict)
    if accelerator.is_main_process:
        note = "\n\n".join([*lines, verdict])
        finish(args, pipe.save_pretrained, pipe, dataset, note=note, base=_name(args, pipe))
    return pipe, verdict


def _name(args, pipe):
    """What to call the given checkpoint: its Hub id, or the name of its folder."""
    given = str(getattr(args, "pretrained_model_name_or_path", None) or "")
    given = given or str(getattr(pipe.config, "_name_or_path", None) or "a pipeline")
    return Path(given).name if Path(given).is_dir() else given


def check_adaptable(pipe, dataset):
    """Raises a `ValueError` if the pipeline has no DALE, or the data do not fit it or hold a single surface."""
    if pipe.dale is None:
        raise ValueError(
            "The checkpoint has no DALE: it reconstructs, it has no mapping from ratings to adapt. Give a whole "
            "pipeline, or train one with examples/train_dale.py."
        )
    check_fit(pipe, dataset)
    surfaces = np.unique(dataset.surface_ids)
    if len(surfaces) < 2:
        raise ValueError(
            f"{dataset.path} holds a single surface, {dataset.surfaces[surfaces[0]]!r}: what differs between a world "
            "and one of its surfaces cannot be told apart. Record two surfaces or more, ten if you can."
        )
    check_axes(
        (*pipe.dale.config.rating_axes, *(a for a in dataset.rating_axes if a not in pipe.dale.config.rating_axes))
    )


# --- the lab


@dataclass(frozen=True, eq=False)
class Lab:
    """A lab's surfaces, what the pretrained DALE generates from their ratings, and how it is sampled."""

    pipe: object
    dataset: object
    latents: torch.Tensor
    real: Surfaces
    generated: Surfaces
    pretrained: dict
    new_axes: list

    @classmethod
    def read(cls, pipe, dataset, args):
        """Encodes the recordings and generates as many textures again, 32 of each surface."""
        new_axes = []
        if set(dataset.rating_axes) - set(pipe.dale.config.rating_axes):
            new_axes = add_axes(pipe.dale, dataset.set_axes().ratings, np.unique(dataset.surface_ids))
        dataset.set_axes(pipe.dale.config.rating_axes)
        latents = encode_dataset(pipe, dataset, args.quiet)
        real = _packed(pipe.dale, dataset, latents)
        steps = pipe.resolve_steps()[1]
        generated = generate_surfaces(pipe.dale.eval(), pipe.dale_scheduler, real.ratings, TAKES, steps, args.seed)
        # without diffusers' note on which entries were defaults once: it would make them defaults again
        config = {name: value for name, value in pipe.dale.config.items() if name != "_use_default_values"}
        pretrained = {"state": pipe.dale.state_dict(), "config": config}
        pretrained["state"] = {name: value.clone() for name, value in pretrained["state"].items()}
        return cls(pipe, dataset, latents, real, generated, pretrained, new_axes)

    @cached_property
    def real_db(self):
        """Mean spectra of the surfaces, dB: (n, bands)."""
        return self.real.mean(spectra_db(self.pipe.dale, scalars_of(self.pipe.dale, self.real)))

    @cached_property
    def given_errors(self):
        """Errors of the given checkpoint, dB: (n,)."""
        dale = self.pipe.dale
        return np.abs(self.generated.mean(spectra_db(dale, scalars_of(dale, self.generated))) - self.real_db).mean(1)

    def copy_of_dale(self):
        """The pretrained DALE, another object."""
        dale = type(self.pipe.dale).from_config(self.pretrained["config"])
        dale.load_state_dict(self.pretrained["state"])
        return dale

    def recalibrate(self, dale, chosen):
        """Recalibrates a pretrained DALE on the chosen surfaces, and tells it the scale and the speed of the lab."""
        chosen = np.asarray(chosen)
        recalibrate(dale, self.real.keep(chosen), self.generated.keep(chosen)).apply(dale)
        statistics, ratings = dict(dale.config.rating_statistics or {}), self.dataset.ratings
        for name, values in (("mean", ratings.raw_mean), ("std", ratings.raw_scale)):
            if statistics and np.isfinite(values).all():
                statistics[name] = np.asarray(values, float).tolist()
        speed = mean_and_std(self.dataset.speeds)[0] or dale.config.reference_speed
        dale.register_to_config(rating_statistics=statistics, reference_speed=speed)

    def rows(self, dale, chosen):
        """Training rows of the chosen surfaces, as `training_states` makes them, and which they are."""
        states = training_states(dale, self.dataset, self.latents)
        kept = np.flatnonzero(np.isin(self.real.owners, np.asarray(chosen)))
        return {name: values[kept] for name, values in states.items()}

    def what_is_adapted(self):
        """Lines on surfaces and ratings, and on what they leave as it is."""
        names = [self.dataset.surfaces[number] for number in np.unique(self.dataset.surface_ids)]
        shown = ", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "")
        lines = [
            f"Adapted to {len(names)} surfaces, {len(self.real.owners)} segments of {self.dataset.source}: {shown}."
        ]
        axes = list(self.pipe.dale.config.rating_axes)
        still = [axis for axis, values in zip(axes, self.real.ratings.T, strict=True) if not _differ(values)]
        if len(still) == len(axes):
            lines.append(
                "No ratings that differ: the distribution of textures is adapted, the sliders stay as they are."
            )
        elif still:
            lines.append(f"No ratings that differ on {', '.join(still)}: these sliders stay as they are.")
        scalars = self.real.mean(scalars_of(self.pipe.dale, self.real))
        for axis in self.new_axes:
            lines.append(carried_words(axis, self.real.ratings[:, axes.index(axis)], scalars))
        if not self.real.knows_friction.any():
            lines.append("The friction coefficient of the recordings is unknown: that of textures stays as it is.")
        if self.dataset.unit != "N":
            lines.append(
                f"The recordings have the unit {self.dataset.unit!r}: so have adapted textures, in place of N."
            )
        if self.pipe.rating_estimator is not None:
            lines.append("The rating estimator stays as it is.")
        return lines


def _differ(values):
    values = values[np.isfinite(values)]
    return len(values) > 1 and np.ptp(values) > 1e-6


def _packed(dale, dataset, latents):
    ids, owners = np.unique(dataset.surface_ids, return_inverse=True)
    states = training_states(dale, dataset, latents)
    ratings = np.array(dataset.ratings.mean[ids], dtype=np.float64)
    for column in ratings.T:
        if not _differ(column):
            column[:] = np.nan  # the same for all says nothing
    return Surfaces(states["state"], owners, ratings, states["knows_friction"].numpy())


# --- the judgement of surfaces that are left out


def judge_recalibration(lab):
    """Errors with each surface left out: `{"zero-shot", "recalibrated", "ridge", "mean spectrum": Errors}`."""
    dale, count, ratings, real = lab.pipe.dale, len(lab.real), lab.real.ratings, lab.real_db
    made = scalars_of(dale, lab.generated)
    made_ratings = ratings[lab.generated.owners]
    found = {name: np.empty_like(real) for name in ("recalibrated", "ridge", "mean spectrum")}
    parts = np.random.default_rng(0).permutation(count) % min(FOLDS, count)
    filled = np.nan_to_num(ratings)
    for part in np.unique(parts):
        out, kept = np.flatnonzero(parts == part), np.flatnonzero(parts != part)
        change = recalibrate(dale, lab.real.keep(kept), lab.generated.keep(kept))
        found["recalibrated"][out] = lab.generated.mean(spectra_db(dale, change.moved(made, made_ratings)))[out]
        found["ridge"][out] = Ridge(1.0).fit(filled[kept], real[kept]).predict(filled[out])
        found["mean spectrum"][out] = real[kept].mean(0)
    errors = {"zero-shot": lab.given_errors} | {name: np.abs(v - real).mean(1) for name, v in found.items()}
    return {name: Errors(own, lab.given_errors) for name, own in errors.items()}


# --- further training


def run_trial(lab, args):
    """A training without a fifth of the surfaces: the number of updates that they ask for, and their errors."""
    order = np.random.default_rng(args.seed).permutation(len(lab.real))
    count = max(2, round(LEFT_OUT * len(order)))
    out, kept = np.sort(order[:count]), np.sort(order[count:])
    folder = Path(args.output_dir) / TRIAL
    dale = lab.copy_of_dale()
    lab.recalibrate(dale, kept)
    settings = type(args)(**vars(args) | {"output_dir": str(folder)})
    validate = make_validation(lab, dale, out)
    first = validate(dale.eval())
    trainer = _trainer(lab, dale, kept, settings, make_accelerator(settings), validate)
    trainer.run()
    scores = {0: first} | {
        entry["step"]: {key.split("/")[1]: value for key, value in entry.items() if key.startswith("validation/")}
        for entry in read_log(folder)
        if "validation/energy" in entry
    }
    best = best_step(scores)
    errors = np.array([scores[best][f"surface_{number}_db"] for number in range(len(out))])
    return best, Errors(errors, lab.given_errors[out])


def best_step(scores):
    """The number of updates with the least energy score; `scores` are those of `make_validation`, by step."""
    return min(scores, key=lambda step: scores[step]["energy"])


def _trainer(lab, dale, chosen, args, accelerator, validate):
    """The `Trainer` of DALE on the chosen surfaces; of one step it learns from energy scores."""
    rows = lab.rows(dale, chosen)
    dale.train()
    if dale.scalar_network is None:
        step = DALETrainingStep(dale, lab.pipe.dale_scheduler, None, conditioning_weight=0.0)
    else:  # its scalars are recalibrated only
        dale.scalar_network.requires_grad_(False)
        step = LatentStep(dale, lab.pipe.dale_scheduler, rows["state"])
    rows = torch.utils.data.StackDataset(**rows)
    return Trainer(accelerator, args, step, "dale", rows, validate=validate, surfaces=surfaces_of(lab.dataset))


def make_validation(lab, dale, out):
    """Energy score of DALE's states and errors of mean spectra, on surfaces left out, with the same noise each time."""
    rows = lab.rows(dale, out)
    chosen = np.linspace(0, len(rows["state"]) - 1, min(JUDGED, len(rows["state"]))).round().astype(int)
    states, ratings = rows["state"][chosen], rows["ratings"][chosen].double().numpy()
    views = StateViews(dale, rows["state"])
    real, scheduler, steps = lab.real.keep(out), lab.pipe.dale_scheduler, lab.pipe.resolve_steps()[1]

    def validate(model):
        make = partial(generate_surfaces, model, scheduler, steps=steps)
        views.dale = model
        first, second = (views(make(ratings, 1, seed=seed).states) for seed in (0, 1))
        found = {"energy": float(energy_score(first, second, views(states)))}
        made = make(real.ratings, TAKES, seed=2)
        errors = np.abs(made.mean(spectra_db(model, scalars_of(model, made))) - lab.real_db[out]).mean(1)
        return found | {f"surface_{number}_db": error for number, error in enumerate(errors)}

    return validate

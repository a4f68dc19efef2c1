"""Adapts a pretrained pipeline to the few surfaces of a lab.

DALE is recalibrated in closed form; with enough surfaces, what it makes vary over a texture is trained further, and so
is a decoder that knows the lab's textures less well than its own. How much that helps is measured on surfaces that are
left out, and said in words.
"""

from argparse import Namespace
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy import stats
from sklearn.linear_model import Ridge

from ..data.dataset import check_fit
from ..data.ratings import check_axes
from .card import finish
from .checkpoints import clear_run
from .dale_data import encode_dataset, mean_and_std, training_states
from .further_training import LEAST_FOR_FIELDS, LEAST_SURFACES, judge_decoder, left_out, train_decoder, train_fields
from .launch import make_accelerator, training_parser
from .new_axes import add_axes, carried_words, differ
from .recalibration import TAKES, Surfaces, generate_trusting, recalibrate, scalars_of, spectra_db
from .record import surfaces_of, write_record

#: Parts that are left out in turn.
FOLDS = 10
#: Of the decoder's training; that of DALE's fields takes as many updates.
DEFAULTS = {
    "train_batch_size": 8,
    "learning_rate": 5e-4,
    "lr_scheduler": "cosine",
    "lr_warmup_steps": 20,
    "max_train_steps": 300,
    "adam_beta1": 0.9,
    "adam_beta2": 0.99,
    "adam_weight_decay": 0.0,
    "use_ema": False,  # an average over so few updates lags behind
    "checkpointing_steps": 100,
    "validation_steps": 100,
    "report_to": "none",
}
#: Below, an interval over surfaces says nothing.
TOO_FEW = 8


def adaptation_parser(description, **defaults):
    """The parser of `examples/adapt.py`: the arguments of all trainings, and when networks are trained."""
    parser = training_parser(description, **DEFAULTS | defaults)
    help = f"train networks of one step further: DALE's U-Net from {LEAST_FOR_FIELDS} surfaces on, the decoder from "
    help += f"{LEAST_SURFACES} on; auto = the decoder only if it knows your textures less well than its own"
    parser.add_argument("--fine_tuning", choices=["auto", "yes", "no"], default="auto", help=help)
    return parser


def adapt(pipe, dataset, output_dir, args=None, **options):
    """Adapts a pipeline to a lab's surfaces and writes it, with its card, into a folder.

    Args:
        pipe (`TactileTexturePipeline`): pretrained; its DALE is changed.
        dataset (`PreparedDataset`): a few surfaces, two at least, at the pipeline's working rate: of a file,
            `PreparedDataset(path, "train", "filtered", pipe.feature_extractor.sampling_rate)`.
        output_dir (`str` or `Path`): of the adapted pipeline, checkpoints and logs.
        args (`argparse.Namespace`, *optional*): of `adaptation_parser`; defaults to its defaults.
        options: of the parser, in place of those in `args`, which stays as it is.

    Returns:
        `tuple[TactileTexturePipeline, str]`: the adapted pipeline, and the verdict.

    Raises:
        ValueError: before any work, if there is nothing to adapt to, the data do not fit the pipeline, or an option is
            unknown or out of range.
    """
    check_adaptable(pipe, dataset)
    args = _with_options(args, dataset, output_dir, options)
    accelerator, given_device = make_accelerator(args), pipe.device
    pipe.to(accelerator.device)
    say, updates = accelerator.print, 0
    lab = Lab.read(pipe, dataset, args)
    decoder = judge_decoder(pipe, dataset, args.seed)
    lines = [*lab.what_is_adapted(), decoder.words()]
    say(*lines, sep="\n")
    judged = judge_recalibration(lab)
    say(judged["zero-shot"].words("As it is, the given checkpoint"))
    ridge, mean = (judged[name].own.mean() for name in ("ridge", "mean spectrum"))
    verdict = judged["recalibrated"].against("Recalibrated, it") + " A ridge regression on the same surfaces is off by "
    verdict += f"{ridge:.2f} dB, their mean spectrum by {mean:.2f} dB." + lab.recalibrate(pipe.dale)
    if args.fine_tuning != "no" and pipe.dale.config.distilled_steps == 1 and len(lab.real) >= LEAST_FOR_FIELDS:
        verdict += " " + lab.train_fields(args, accelerator)
        updates = args.max_train_steps
    if trains_decoder(pipe, lab, decoder, args.fine_tuning):
        verdict += " " + train_decoder(pipe, dataset, args, accelerator)
    else:
        verdict += " The decoder stays as it is"
        verdict += "." if decoder.knows else "; examples/train_lctg.py, with your recordings, may help."
        if accelerator.is_main_process:
            if not args.resume_from_checkpoint:
                clear_run(args.output_dir)
            write_record(args, accelerator, len(dataset), updates, surfaces_of(dataset))
    pipe.to(given_device)
    say(verdict)
    if accelerator.is_main_process:
        note = "\n\n".join([*lines, verdict])
        finish(args, pipe.save_pretrained, pipe, dataset, note=note, base=_name(args, pipe))
    return pipe, verdict


def _with_options(args, dataset, output_dir, options):
    """A copy of the arguments, with options in place of some; these are refused by name as on the command line."""

    def refuse(message):
        raise ValueError(f"`adapt`: {message}")

    parser = adaptation_parser("")
    parser.error = refuse
    words = ["--train_data_dir", str(dataset.path), "--output_dir", str(output_dir)]
    defaults = vars(parser.parse_args(words))
    # flags, and None for what has no default, are no words
    plain = {k: v for k, v in options.items() if isinstance(v, bool | None) and type(defaults.get(k, 0)) is type(v)}
    words += [f"--{name}={value}" for name, value in options.items() if name not in plain]
    checked = vars(parser.parse_args(words)) | plain
    given = defaults | {"quiet": True} if args is None else vars(args)
    return Namespace(**given | {name: checked[name] for name in ("output_dir", *options)})


def trains_decoder(pipe, lab, decoder, wanted):
    """Whether the decoder is trained further: as wanted ("yes", "no"), or where it helps ("auto")."""
    possible = pipe.lctg_distilled is not None and len(lab.real) >= LEAST_SURFACES
    return possible and (wanted == "yes" or (wanted == "auto" and not decoder.knows))


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
    """A lab's surfaces, and what the pretrained DALE generates from shares of their ratings."""

    pipe: object
    dataset: object
    latents: object
    real: Surfaces
    generated: dict
    new_axes: list

    @classmethod
    def read(cls, pipe, dataset, args):
        """Encodes the recordings and generates 32 textures of each surface, for each share of its ratings."""
        new_axes = []
        if set(dataset.rating_axes) - set(pipe.dale.config.rating_axes):
            new_axes = add_axes(pipe.dale, dataset.set_axes().ratings, np.unique(dataset.surface_ids))
        dataset.set_axes(pipe.dale.config.rating_axes)
        latents = encode_dataset(pipe, dataset, args.quiet)
        real = _packed(pipe.dale, dataset, latents)
        steps = pipe.resolve_steps()[1]
        generated = generate_trusting(pipe.dale.eval(), pipe.dale_scheduler, real.ratings, TAKES, steps, args.seed)
        return cls(pipe, dataset, latents, real, generated, new_axes)

    @cached_property
    def real_db(self):
        """Mean spectra of the surfaces, dB: (n, bands)."""
        return self.real.mean(spectra_db(self.pipe.dale, scalars_of(self.pipe.dale, self.real)))

    @cached_property
    def given_errors(self):
        """Errors of the given checkpoint, dB: (n,)."""
        dale, given = self.pipe.dale, self.generated[1.0]
        return np.abs(given.mean(spectra_db(dale, scalars_of(dale, given))) - self.real_db).mean(1)

    def recalibrate(self, dale):
        """Recalibrates the pretrained DALE, and tells it the scale and the speed of the lab; says what changed."""
        change = recalibrate(dale, self.real, self.generated)
        change.apply(dale)
        statistics, ratings = dict(dale.config.rating_statistics or {}), self.dataset.ratings
        for name, values in (("mean", ratings.raw_mean), ("std", ratings.raw_scale)):
            if statistics and np.isfinite(values).all():
                statistics[name] = np.asarray(values, float).tolist()
        speed = mean_and_std(self.dataset.speeds)[0] or dale.config.reference_speed
        dale.register_to_config(rating_statistics=statistics, reference_speed=speed)
        return change.words()

    def train_fields(self, args, accelerator):
        """Trains the recalibrated DALE's U-Net; says what that did."""
        dale, out = self.pipe.dale, left_out(self.dataset, args.seed)
        states = training_states(dale, self.dataset, self.latents)
        updates, quiet = args.max_train_steps, args.quiet or not accelerator.is_main_process
        return train_fields(dale, self.pipe.dale_scheduler, states, out, updates, args.seed, quiet)

    def what_is_adapted(self):
        """Lines on surfaces and ratings, and on what they leave as it is."""
        names = [self.dataset.surfaces[number] for number in np.unique(self.dataset.surface_ids)]
        shown = ", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "")
        lines = [
            f"Adapted to {len(names)} surfaces, {len(self.real.owners)} segments of {self.dataset.source}: {shown}."
        ]
        axes = list(self.pipe.dale.config.rating_axes)
        still = [axis for axis, values in zip(axes, self.real.ratings.T, strict=True) if not differ(values)]
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


def _packed(dale, dataset, latents):
    ids, owners = np.unique(dataset.surface_ids, return_inverse=True)
    states = training_states(dale, dataset, latents)
    ratings = np.array(dataset.ratings.mean[ids], dtype=np.float64)
    for column in ratings.T:
        if not differ(column):
            column[:] = np.nan  # the same for all says nothing
    return Surfaces(states["state"], owners, ratings, states["knows_friction"].numpy())


# --- the judgement of surfaces that are left out


def judge_recalibration(lab):
    """Errors with each surface left out: `{"zero-shot", "recalibrated", "ridge", "mean spectrum": Errors}`."""
    dale, count, ratings, real = lab.pipe.dale, len(lab.real), lab.real.ratings, lab.real_db
    found = {name: np.empty_like(real) for name in ("recalibrated", "ridge", "mean spectrum")}
    parts = np.random.default_rng(0).permutation(count) % min(FOLDS, count)
    filled = np.nan_to_num(ratings)
    for part in np.unique(parts):
        out, kept = np.flatnonzero(parts == part), np.flatnonzero(parts != part)
        change = recalibrate(dale, lab.real.keep(kept), {t: made.keep(kept) for t, made in lab.generated.items()})
        made = lab.generated[change.trust].keep(out)
        moved = change.moved(scalars_of(dale, made), made.ratings[made.owners])
        found["recalibrated"][out] = made.mean(spectra_db(dale, moved))
        found["ridge"][out] = Ridge(1.0).fit(filled[kept], real[kept]).predict(filled[out])
        found["mean spectrum"][out] = real[kept].mean(0)
    errors = {"zero-shot": lab.given_errors} | {name: np.abs(v - real).mean(1) for name, v in found.items()}
    return {name: Errors(own, lab.given_errors) for name, own in errors.items()}


@dataclass(frozen=True)
class Errors:
    """Errors of the mean spectra of n surfaces from their ratings, dB, of a method and of the given checkpoint."""

    own: np.ndarray
    given: np.ndarray

    def words(self, name):
        """The mean error, with its interval where there are enough surfaces."""
        interval = "" if len(self.own) < TOO_FEW else " [{:.2f}, {:.2f}]".format(*_interval(self.own))
        return (
            f"{name}: mean spectra of {len(self.own)} surfaces from their ratings are off by {self.own.mean():.2f} dB"
            f"{interval}."
        )

    def against(self, name):
        """A sentence on whether it is better than the given checkpoint, and whether one can tell."""
        gain, count = self.given - self.own, len(self.own)
        word, won = ("better", gain > 0) if gain.mean() >= 0 else ("worse", gain < 0)
        text = f"{name} is {word} than the given checkpoint on {won.sum()} of {count} surfaces left out"
        text += f" ({self.own.mean():.2f} against {self.given.mean():.2f} dB)"
        if count < TOO_FEW:
            return f"{text}; too few to say more."
        low, high = _interval(gain)
        if low > 0:
            return f"{text}: by {gain.mean():.2f} dB [{low:.2f}, {high:.2f}]."
        told = "it is worse" if high < 0 else "no difference that can be told"
        return f"{text}: {told} ({low:.2f} to {high:.2f} dB)."


def _interval(values):
    """95 % interval of the mean of values (n,), by Student's t."""
    reach = stats.t.ppf(0.975, len(values) - 1) * values.std(ddof=1) / len(values) ** 0.5
    return values.mean() - reach, values.mean() + reach

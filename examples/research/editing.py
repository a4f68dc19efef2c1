"""`python editing.py`: what edits of recordings reach and keep, seams of what is filled, and the time of an edit."""

import sys
import time
from pathlib import Path

import matplotlib
import numpy as np
import torch
from study_context import run_study

from tactile_diffusers import TactileTextureEditPipeline
from tactile_diffusers.data import PreparedDataset
from tactile_diffusers.evaluation.judge import Judge, response_matrix
from tactile_diffusers.evaluation.metrics.embedding import SCALE_FLOORS, tactile_features
from tactile_diffusers.evaluation.metrics.statistics import leaf
from tactile_diffusers.evaluation.truth import LEAST_EFFECTIVE_SIZE, recorded_truth
from tactile_diffusers.pipelines.pipeline_tactile_texture_edit import VARIATION
from tactile_diffusers.signal import RATING_AXES, level, resample

sys.path.append(str(Path(__file__).parents[1]))  # examples, for `report`

from report.held_out import open_held_out
from report.sampling import noise_seeds
from report.second_judge import tell_apart
from report.sections.second_judge import share
from report.tables import markdown_table, text

from tactile_diffusers.evaluation.metrics.rating_effects import texture_measures

#: What is asked for, z-scores.
CHANGES = (-0.7, 0.7)
STRENGTHS = (0.0, 0.2, 0.4, 0.6, 0.8, 0.95, 1.0)
#: The strength at which changes and leaks are judged axis by axis.
JUDGED = 0.8
#: Recordings of the curve over strength.
FEW = 40
#: Envelopes are compared at this rate, Hz.
ENVELOPE_RATE = 100
#: Times that takes are told apart, each with other folds of surfaces.
ROUNDS = 5
#: Gap, and window around its first edge, a loop's seam or the beginning of a continuation, s.
GAP_S, WINDOW_S = (0.7, 0.9), 0.8192
#: Pairs of a generation and an edit that are timed in turn.
TIMED = 25


def main(argv=None):
    """Writes editing.json, editing.md and editing.png."""
    description = "What edits of recordings reach and keep, seams of what is filled, and the time of an edit."
    return run_study("editing", description, study, markdown, argv)


def study(context):
    """The figures as leaves: "control", "strength", "variations", "seams" and "time"."""
    edits = Edits(context)
    result = {"control": edits.control(), "strength": edits.strengths(), "variations": edits.variations()}
    result |= {
        "seams": edits.seams(),
        "time": edits.time(),
        "recordings": len(edits.rows),
        "few": FEW,
        "judged": JUDGED,
    }
    _plot(result["strength"], context.output / "editing.png")
    return result


class Edits:
    """Edits of held-out recordings, one of each surface, whose own ratings are known."""

    def __init__(self, context):
        self.context, self.data = context, context.data
        self.pipe = TactileTextureEditPipeline.from_pipe(context.pipe)
        self.rate, dataset = self.data.rate, self.data.dataset
        first = np.unique(self.data.surfaces, return_index=True)[1]
        self.rows, self.others = self.data.rows[first], self.data.other_rows[first]
        self.ratings = self.data.ratings[first]
        self.textures, self.frictions = dataset.textures(self.rows), dataset.friction_coefficients[self.rows]
        training = self.data.training
        friction = np.log(training.friction_coefficients)
        self.judge = Judge.fit(self.data.reference.points, friction, training.ratings, training.surface_ids)
        #: from changes of the judge's estimates to changes of ratings, as they go together on real held-out surfaces
        self.match = np.linalg.inv(self._response(dataset.path))
        self.truth = recorded_truth(PreparedDataset(dataset.path, "all"), self._measures)
        self.before = {}
        self.spread = {name: values.std(0) for name, values in self.truth.measures.items()}

    def _response(self, path):
        """The judge's response to the ratings of both held-out splits: of one alone, chance moves entries by 0.2."""
        estimates, ratings = [], []
        for split in ("validation", "test"):
            held = open_held_out(path, split, self.data.per_surface, self.context.seed)
            points, frictions = self.data.reference.embed(held.real), np.log(held.frictions)
            estimates.append(self.judge.predict(points, frictions))
            ratings.append(held.ratings)
        return response_matrix(np.concatenate(estimates), np.concatenate(ratings))

    def edit(self, asked, strength, count=None, **options):
        """Textures and friction coefficients of edits by (3,) differences; below 0, of the baseline."""
        made = []
        for start in range(0, len(self.rows[:count]), 20):
            rows = slice(start, min(start + 20, len(self.rows[:count])))
            common = {"source_ratings": self.ratings[rows], "friction_coefficient": self.frictions[rows]}
            common["generator"] = generators(noise_seeds(self.context.seed, len(self.rows))[rows])
            if strength < 0:
                made.append(self._difference_added(asked, rows, common["generator"]))
                continue
            asked_of = {"ratings": list(asked), "rating_scale": "difference", "strength": strength}
            made.append(self.pipe(self.textures[rows], self.rate, **asked_of, **common, **options))
        textures = np.concatenate([resample(out.textures, out.sampling_rate, self.rate) for out in made])
        return textures, np.concatenate([out.friction_coefficient for out in made])

    def _difference_added(self, asked, rows, own_generators):
        """The baseline: the difference of two generations from one seed, added to the recording's latents."""
        pipe, seeds = self.context.pipe, [generator.initial_seed() for generator in own_generators]
        own = pipe.encode(self.textures[rows], self.rate)
        before, after = (
            pipe(ratings, generator=generators(seeds), output_type="latent")
            for ratings in (self.ratings[rows], self.ratings[rows] + asked)
        )
        friction = torch.tensor(self.frictions[rows]) * after.friction_coefficient / before.friction_coefficient
        latents = own.latents + after.latents - before.latents
        return pipe.decode(latents, own.level + after.level - before.level, friction, None, generators(seeds))

    def control(self):
        """Axis -> leaves of the change that is reached at `JUDGED`, as shares of what was asked for, and of leaks."""
        found = {}
        for strength, slug in ((JUDGED, "edit"), (-1, "baseline")):
            for axis in range(len(RATING_AXES)):
                changes, shares, _ = zip(*(self._changes(axis, asked, strength) for asked in CHANGES), strict=True)
                changes, own = np.concatenate(changes), np.tile(np.arange(len(self.rows)), len(CHANGES))
                others = [leaf(changes[:, k], own) for k in range(3) if k != axis]
                entry = {"leak": max(others, key=lambda other: abs(other["mean"]))}
                entry |= {"judge": leaf(changes[:, axis], own), "truth": leaf(np.concatenate(shares), own)}
                found[f"{slug}, {RATING_AXES[axis]}"] = entry
        return found

    def _changes(self, axis, asked, strength, count=None):
        """Changes of ratings (n, 3) by the judge, and (n,) by measures, as shares of what was asked for; textures.

        By measures NaN, where too few real surfaces have such ratings.
        """
        difference = np.eye(len(RATING_AXES))[axis] * asked
        if count not in self.before:  # nothing is asked for
            self.before[count] = self.edit(np.zeros(3), 0.0, count)
        before, after = self.before[count], self.edit(difference, strength, count)
        estimates = [self.judge.predict(self.data.reference.embed(t), np.log(f)) for t, f in (before, after)]
        moved = (estimates[1] - estimates[0]) @ self.match.T / asked
        ours = [self._measures(textures, level(textures), frictions) for textures, frictions in (before, after)]
        kept, vectors, real = [], [], []
        for row, source in enumerate(self.ratings[:count]):
            target = source + difference
            if min(map(self.truth.effective_size, (source, target))) < LEAST_EFFECTIVE_SIZE:
                continue
            ends = [self.truth.mean_rating(request)[axis] for request in (source, target)]
            scale = asked / (ends[1] - ends[0])  # surfaces that count lie nearer to the middle than the request
            kept.append(row)
            vectors.append(self._vector({name: ours[1][name][row] - ours[0][name][row] for name in self.spread}))
            means = {name: self.truth.mean(name, target) - self.truth.mean(name, source) for name in self.spread}
            real.append(scale * self._vector(means))
        mean, shares = np.mean(real, 0), np.full(len(moved), np.nan)
        shares[kept] = np.array(vectors) @ mean / (mean @ mean)
        return moved, shares, after[0]

    def _vector(self, changes):
        return np.concatenate([np.atleast_1d(changes[name] / self.spread[name]) for name in sorted(changes)])

    def _measures(self, textures, levels, frictions):
        return texture_measures(textures, levels, frictions, self.rate, self.data.edges)

    def strengths(self):
        """Strength -> leaves over recordings and all asked changes; "baseline" beside them."""
        own, found = self.textures[:FEW], {}
        for strength in (*STRENGTHS, -1):
            entry = {"judge": [], "truth": [], "bands": [], "envelope": [], "waveform": []}
            for axis in range(len(RATING_AXES)):
                for asked in CHANGES:
                    moved, shares, textures = self._changes(axis, asked, strength, FEW)
                    entry["truth"].append(shares)
                    entry["judge"].append(moved[:, axis])
                    error = self._shape(textures) - self._shape(own)
                    entry["bands"].append(np.abs(error - error.mean(0)).mean(1))  # the mean is what was asked for
                    entry["envelope"].append(_correlation(_envelope(textures, self.rate), _envelope(own, self.rate)))
                    entry["waveform"].append(_correlation(textures, own))
            name = "baseline" if strength < 0 else str(strength)
            recordings = np.tile(np.arange(len(own)), len(entry["judge"]))
            found[name] = {key: leaf(np.concatenate(values), recordings) for key, values in entry.items()}
        return found

    def _shape(self, textures):
        return self._measures(textures, level(textures), np.ones(len(textures)))["shape_db"]

    def variations(self):
        """Nine-band differences, dB, of variations and of real takes to the recording: leaves."""
        textures, _ = self.edit(np.zeros(3), VARIATION)
        real = self.data.dataset.textures(self.others)
        own = self._shape(self.textures)
        return {
            "variations": leaf(np.abs(self._shape(textures) - own).mean(1)),
            "another take": leaf(np.abs(self._shape(real) - own).mean(1)),
        }

    def seams(self):
        """What is filled -> leaves: how often a judge tells windows over its seams from real ones."""
        dataset, needed = self.data.dataset, 4
        rows, ids = self.data.unseen_rows(needed), dataset.surface_ids
        own = [rows[ids[rows] == s] for s in np.unique(ids[rows]) if np.count_nonzero(ids[rows] == s) == needed]
        rng = self.context.rng("seams")  # takes come in the order of time and fingers
        own = [rng.permutation(rows) for rows in own]
        takes = dataset.textures(np.concatenate(own)).reshape(len(own), needed, -1).astype(np.float32)
        samples, size = takes.shape[-1], round(WINDOW_S * self.rate)
        middle = slice((samples - size) // 2, (samples + size) // 2)
        names, real = np.arange(len(own)), self._features(takes[:, :2], middle)
        placed = {"another take": ({}, middle, None)}
        placed["gap of 0.2 s"] = ({"mask": [GAP_S]}, middle, [GAP_S])
        start = samples - size // 2
        placed["continuation"] = ({"continue_s": size / 2 / self.rate}, slice(start, start + size), [])
        seam = [(0, 0.1), (samples / self.rate - 0.1, samples / self.rate)]
        placed["loop"] = ({"loop": True}, None, seam)
        found = {}
        for name, (options, window, gaps) in placed.items():
            made = takes[:, 2:] if gaps is None else self._filled(takes[:, 2:], options)
            entry = {}
            if gaps is not None:
                kept = np.ones(samples, bool)
                for gap in gaps:
                    kept[slice(*np.rint(np.array(gap) * self.rate).astype(int))] = False
                entry["same"] = bool(np.array_equal(made[..., :samples][..., kept], takes[:, 2:][..., kept]))
            if window is None:
                made, window = np.roll(made, samples // 2, axis=-1), middle
            made = self._features(made, window)
            rounds = [tell_apart(real, made, names, SCALE_FLOORS, seed=seed)[0] for seed in range(ROUNDS)]
            found[name] = entry | {"auc": share(np.array(rounds))}
        return found

    def _filled(self, takes, options):
        ratings = np.nan  # estimated
        rows = takes.reshape(-1, takes.shape[-1])
        generator = generators(noise_seeds(self.context.seed + 1, len(rows)))
        out = self.pipe(rows, self.rate, source_ratings=[ratings] * 3, generator=generator, **options)
        return out.textures.reshape(*takes.shape[:2], -1)

    def _features(self, takes, window):
        cut = takes[..., window]
        return tactile_features(cut.reshape(-1, cut.shape[-1]), self.rate).reshape(*cut.shape[:2], -1)

    def time(self):
        """Median time of an edit over that of a generation, in turn, and the least and largest ratio."""
        ratios, texture = [], self.textures[0]
        for _ in range(TIMED):
            start = time.perf_counter()
            self.context.pipe([[0.5, 0.0, 0.0]])
            between = time.perf_counter()
            self.pipe(texture, self.rate, {"roughness": 0.5}, rating_scale="difference")
            ratios.append((time.perf_counter() - between) / (between - start))
        return {"ratio": float(np.median(ratios)), "low": float(min(ratios)), "high": float(max(ratios))}


def generators(seeds):
    """One generator for each seed."""
    return [torch.Generator("cpu").manual_seed(int(seed)) for seed in seeds]


def _envelope(textures, rate):
    """Log RMS over windows of 10 ms: (n, windows)."""
    step = rate // ENVELOPE_RATE
    pieces = textures[:, : textures.shape[-1] // step * step].reshape(len(textures), -1, step)
    return np.log(np.sqrt(np.square(pieces).mean(-1)) + 1e-9)


def _correlation(a, b):
    a, b = (values - values.mean(-1, keepdims=True) for values in (a, b))
    return (a * b).sum(-1) / np.sqrt(np.square(a).sum(-1) * np.square(b).sum(-1))


def markdown(result):
    """The figures as tables."""
    control = {"judge": "reached, by the judge", "truth": "reached, by measures", "leak": "largest leak"}
    strength = {"judge": control["judge"], "truth": control["truth"], "bands": "nine bands not asked for, dB"}
    strength |= {"envelope": "correlation of envelopes", "waveform": "correlation of waveforms"}
    rows = {f"strength {name}": entry for name, entry in result["strength"].items() if name != "baseline"}
    rows["difference of two generations added"] = result["strength"]["baseline"]
    seams = {name: entry | {"same": _SAME[entry.get("same")]} for name, entry in result["seams"].items()}
    takes = {name: {"bands": value} for name, value in result["variations"].items()}
    control_rows = {name: entry | {"n": entry["truth"]["n"]} for name, entry in result["control"].items()}
    ratio, few, asked = result["time"], result["few"], CHANGES[-1]
    parts = [
        "# All figures of [Editing](../editing.md)",
        f"Held-out recordings of {result['recordings']} surfaces, whose ratings are known, asked to move by ±{asked} "
        "on one axis at a time. Shares of what was asked for, as real surfaces of such ratings differ: by the judge, "
        "whose estimates are matched to real surfaces, and by level, friction and nine bands. The leak is the larger "
        f"one into another axis. 95 % intervals are over recordings; by measures, edits count whose ratings and target "
        "enough real surfaces have (n). At a strength of {JUDGED}; the baseline adds the "
        "difference of two generations from one seed to the recording's latents.",
        markdown_table(control_rows, labels=control | {"n": ("n, by measures", 0)}, interval=True),
        f"Over strength ({few} recordings, all axes and both signs); 0 is the reconstruction, 1 a fresh take. Of the "
        "nine bands, what recordings change by together is taken for what was asked for. Envelopes are RMS over 10 ms.",
        markdown_table(rows, labels=strength),
        "![over strength](editing.png)",
        f"Variations (strength {VARIATION}) and real takes, beside the recording: mean difference of nine bands, dB.",
        markdown_table(takes, labels={"bands": "nine bands, dB"}, interval=True),
        f"Seams: how often the second judge tells a window of {WINDOW_S} s, with the seam in its middle, from a real "
        "take (0.5 = never), and whether all samples that were not to change are the same.",
        markdown_table(seams, labels={"auc": "told apart", "same": "the rest bit for bit"}, interval=True),
        f"An edit takes {text(ratio['ratio'])} times as long as a generation, ratings estimated (median of {TIMED} "
        f"pairs in turn; {text(ratio['low'])} to {text(ratio['high'])}).",
        "    python examples/research/editing.py --data prepared.h5 --output editing",
    ]
    return "\n\n".join(parts)


_SAME = {None: "–", True: "yes", False: "no"}


def _plot(strengths, path):
    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(7, 4), layout="constrained")
    for key, label in (("judge", "change reached"), ("envelope", "envelope"), ("waveform", "waveform")):
        axes.plot(STRENGTHS, [strengths[str(s)][key]["mean"] for s in STRENGTHS], "o-", label=label)
    axes.set(xlabel="strength", ylabel="share of the change asked for, or correlation", ylim=(-0.1, 1.2))
    bands = axes.twinx()
    bands.plot(STRENGTHS, [strengths[str(s)]["bands"]["mean"] for s in STRENGTHS], "s--k", label="nine bands")
    bands.set(ylabel="nine-band difference not asked for / dB", ylim=(0, None))
    figure.legend(loc="outside upper center", ncols=4)
    figure.savefig(path, dpi=150)


if __name__ == "__main__":
    sys.exit(main())

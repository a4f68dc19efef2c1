"""Stimuli: real, generated and baseline textures of held-out surfaces, at one level, under blind ids."""

from dataclasses import dataclass

import numpy as np
import pandas
from report.baselines import SLUGS, BaselineRequest, TrainingTextures, default_baselines
from report.held_out import check_unseen
from report.sampling import generate, noise_seeds, reconstruct

from tactile_diffusers.data import PreparedDataset
from tactile_diffusers.data.dataset import check_fit
from tactile_diffusers.export import write_npz, write_wav
from tactile_diffusers.signal import RATING_AXES, rms
from tactile_diffusers.signal.checks import check_number, check_seed

REFERENCE, OTHER_TAKE, GENERATED, RECONSTRUCTED = "reference", "other_take", "generated", "reconstructed"
#: Baselines that can be felt and need no more than the data: silence has no level to match, and `decimated` belongs to
#: one latent.
BASELINES = tuple(slug for slug in SLUGS if slug not in ("silence", "other_take", "decimated"))
LEVELS = ("matched", "natural")
#: Columns of the key and what they hold; after them `asked_<axis>`, the request, of each axis of the checkpoint.
KEY_COLUMNS = {
    "id": "blind id: the name of the files in stimuli/",
    "surface": "held-out surface",
    "condition": "what the texture is",
    "copy_of": "id of the same texture; a copy is only played as X of ABX, so that no trial list reveals the answer",
    "rms_n": "level of the file, RMS in N",
    "peak_n": "largest force of the file, N",
    "recording": "of a real take: surface, explorer and trial; the takes are of one explorer where one has two",
    "gain_db": "applied to the texture as recorded or generated, the study's attenuation included",
    "friction_coefficient": "written to the file; empty = unknown",
    "reference_speed": "finger speed of the recording or of the model, mm/s; empty = unknown",
    "seed": "of the noise of a generated or reconstructed texture, or of the study for others",
}
_ASKED = "asked_"
#: Letters of blind ids: without vowels they form no words, without l and digits they are not misread.
_LETTERS, _LETTERS_PER_ID = list("bcdfghjkmnpqrstvwxz"), 6
#: Segments of each training surface that baselines learn from, and of each held-out one that takes are chosen among.
_TRAINING_SEGMENTS, _CANDIDATES = 4, 4


@dataclass(frozen=True)
class StimulusSettings:
    """Settings of the stimuli.

    With the level "matched" every texture of a surface has the RMS and friction coefficient of the surface's reference
    take; "natural": as recorded or generated. Textures that peak above `full_scale` attenuate all alike.
    """

    surfaces: int = 6  # held-out ones, 2 or more, spread over the ratings
    baselines: tuple = ("mean_spectrum", "knn_blend")  # of `BASELINES`
    level: str = "matched"  # of `LEVELS`
    full_scale: float | None = None  # the largest force that the device renders, N; None = the largest peak
    seed: int = 0  # of every choice, noise, id and order

    def __post_init__(self):
        if self.surfaces < 2:
            raise ValueError(f"`surfaces` must be at least 2, got {self.surfaces}: similarity needs another surface.")
        unknown = [slug for slug in self.baselines if slug not in BASELINES]
        if unknown or len(set(self.baselines)) < len(self.baselines):
            raise ValueError(f"`baselines` must be different ones of {BASELINES}, got {self.baselines}.")
        if self.level not in LEVELS:
            raise ValueError(f"`level` must be one of {LEVELS}, got {self.level!r}.")
        if self.full_scale is not None:
            check_number("full_scale", self.full_scale, "N", above=0)
        check_seed(self.seed)


@dataclass(frozen=True)
class Stimuli:
    """Textures under blind ids."""

    key: pandas.DataFrame  # columns `KEY_COLUMNS`; `id` and `copy_of` tell what is what
    textures: np.ndarray  # (rows of the key, samples) float64, N, as they are played
    sampling_rate: int  # Hz
    full_scale: float  # N at full scale of every file
    attenuation_db: float  # 0 or more, of all textures alike
    speed: float  # mm/s at which fingers should slide: mean of the takes used; NaN = unknown


def axes_of(key):
    """The rating axes of a study, in the order of the key's columns: tuple of names."""
    return tuple(column.removeprefix(_ASKED) for column in key if column.startswith(_ASKED))


def asked(key):
    """The requests of a key, z-scores: (rows, axes)."""
    return key[[_ASKED + axis for axis in axes_of(key)]].to_numpy()


def make_stimuli(pipe, data, settings, quiet=True):
    """Makes every texture of a study: `Stimuli`.

    Args:
        pipe (`TactileTexturePipeline`): with a DALE.
        data (`str` or `Path`): a prepared data set; its split "test" is used, baselines learn from "train".
        settings (`StimulusSettings`): what is made.
        quiet (`bool`): no progress bars.

    Raises:
        ValueError: if the checkpoint cannot generate or does not fit the data, the data are not in newtons, surfaces
            are not held out, or too few of them have all ratings and two segments that share no sample.
    """
    if pipe.dale is None:
        raise ValueError("The checkpoint has no DALE and cannot generate from ratings. Give one that has.")
    held_out, train = PreparedDataset(data, "test"), PreparedDataset(data, "train")
    if held_out.unit != "N":
        raise ValueError(f"`data` must be in N to state levels, its unit is {held_out.unit!r}. Calibrate recordings.")
    check_fit(pipe, held_out)
    for dataset in (held_out, train):
        dataset.set_axes(pipe.dale.config.rating_axes)
    check_unseen(held_out, train)
    rows, others = choose_takes(held_out, settings.surfaces, settings.seed)
    sets, facts = _all_textures(pipe, held_out, train, rows, others, settings, quiet)
    return _blinded(held_out, rows, sets, facts, settings)


def choose_takes(dataset, surfaces, seed):
    """Chooses surfaces whose ratings lie far apart, and two takes of each that share no sample: indices (surfaces,) of
    each.

    The first surface is the one farthest from the middle, each further one the farthest from those chosen. Takes are by
    one explorer where one has two, because fingers differ.

    Raises:
        ValueError: if there are too few surfaces with every rating and two such takes.
    """
    rows = np.random.default_rng([seed, 0]).permutation(dataset.non_overlapping(_CANDIDATES, seed))
    surface_ids = dataset.surface_ids[rows]
    takes = {surface: _two_takes(dataset, rows[surface_ids == surface]) for surface in np.unique(surface_ids)}
    rated = np.isfinite(dataset.ratings.mean).all(-1)
    usable = np.array([surface for surface, own in takes.items() if len(own) == 2 and rated[surface]], dtype=np.int64)
    if len(usable) < surfaces:
        raise ValueError(
            f"`surfaces` must be at most {len(usable)}, got {surfaces}: so many of the split {dataset.split!r} of "
            f"{dataset.path} have every rating and two segments that share no sample. Ask for fewer, or hold out more."
        )
    ratings = dataset.ratings.mean[usable].astype(np.float64)
    distance = np.linalg.norm(ratings - ratings.mean(0), axis=-1)
    chosen = []
    for _ in range(surfaces):
        chosen.append(int(np.argmax(distance)))
        from_last = np.linalg.norm(ratings - ratings[chosen[-1]], axis=-1)
        distance = from_last if len(chosen) == 1 else np.minimum(distance, from_last)
        distance[chosen] = -1
    pairs = np.array([takes[surface] for surface in usable[np.sort(chosen)]])
    return pairs[:, 0], pairs[:, 1]


def _two_takes(dataset, rows):
    """Two of these segments, by one explorer if possible; fewer if there are not as many."""
    explorers = np.array([dataset.recordings[recording].split("/")[1] for recording in dataset.recording_ids[rows]])
    for explorer in explorers:
        if (explorers == explorer).sum() >= 2:
            return rows[explorers == explorer][:2]
    return rows[:2]


def _all_textures(pipe, held_out, train, rows, others, settings, quiet):
    """Textures of each condition, (surfaces, samples), and columns of the key about them, (surfaces,)."""
    rate, samples, steps = held_out.sampling_rate, held_out.segment_samples, pipe.resolve_steps()[0]
    ratings = held_out.ratings.mean[held_out.surface_ids[rows]]
    real, count = held_out.textures(rows), len(rows)
    seeds = noise_seeds([settings.seed, 1], count)
    generated = generate(pipe, ratings, seeds, rate, samples, steps, quiet=quiet)
    sets = {
        REFERENCE: real,
        OTHER_TAKE: held_out.textures(others),
        GENERATED: generated.textures,
        RECONSTRUCTED: reconstruct(pipe, real, rate, steps, [settings.seed, 2], quiet=quiet),
    }
    request = BaselineRequest(ratings, real, sets[OTHER_TAKE])
    sets |= _baseline_textures(train, request, settings)
    own, other = _about(held_out, rows, settings.seed), _about(held_out, others, settings.seed)
    facts = {condition: own | {"recording": ""} for condition in sets} | {REFERENCE: own, OTHER_TAKE: other}
    facts[GENERATED] |= {"seed": seeds, "reference_speed": pipe.dale.config.reference_speed or np.nan}
    facts[RECONSTRUCTED] |= {"seed": noise_seeds([settings.seed, 2], count)}
    if settings.level == "matched":
        facts[OTHER_TAKE] |= {"friction_coefficient": own["friction_coefficient"]}
    else:
        facts[GENERATED] |= {"friction_coefficient": _known(generated.friction_coefficients)}
    return sets, facts


def _about(dataset, rows, seed):
    """Columns of the key about recorded segments."""
    return {
        "recording": [dataset.recordings[recording] for recording in dataset.recording_ids[rows]],
        "friction_coefficient": _known(dataset.friction_coefficients[rows]),
        "reference_speed": _known(dataset.speeds[rows]),
        "seed": seed,
    }


def _known(values):
    """float64, NaN for what is not above zero: no coefficient or speed of a sliding finger."""
    values = np.asarray(values, dtype=np.float64)
    return np.where(values > 0, values, np.nan)


def _baseline_textures(train, request, settings):
    """What each baseline answers: slug -> (surfaces, samples)."""
    rows = train.non_overlapping(_TRAINING_SEGMENTS, settings.seed)
    surfaces = train.surface_ids[rows]
    frictions = _known(train.friction_coefficients[rows])
    ratings = train.ratings.mean[surfaces]
    training = TrainingTextures(train.textures(rows), ratings, frictions, surfaces, train.sampling_rate, train.band)
    available = default_baselines(1, 1)  # numbers of `decimated`, which is not among `BASELINES`
    return {
        slug: available[slug].fit(training).sample(request, np.random.default_rng([settings.seed, *slug.encode()]))
        for slug in settings.baselines
    }


def _blinded(held_out, rows, sets, facts, settings):
    """`Stimuli` from textures: levels, the common scale, and two ids for each texture."""
    key, textures = [], []
    for condition, takes in sets.items():
        levelled, gains_db = _levelled(condition, takes, sets[REFERENCE], settings.level)
        textures.append(levelled)
        surfaces = [held_out.surfaces[surface] for surface in held_out.surface_ids[rows]]
        entry = {"surface": surfaces, "condition": condition, "gain_db": gains_db, **facts[condition]}
        key.append(pandas.DataFrame(entry))
    key, textures = pandas.concat(key, ignore_index=True), np.concatenate(textures)
    columns = [_ASKED + axis for axis in held_out.ratings.axes]
    requests = held_out.ratings.mean[held_out.surface_ids[rows]].astype(np.float64)
    key[columns] = np.tile(requests, (len(sets), 1))

    peak = np.abs(textures).max()
    full_scale = float(peak if settings.full_scale is None else settings.full_scale)
    attenuation_db = float(max(0.0, 20 * np.log10(peak / full_scale)))
    textures *= min(1.0, full_scale / peak)
    key["gain_db"] -= attenuation_db
    key["rms_n"], key["peak_n"] = rms(textures), np.abs(textures).max(-1)

    ids = blind_ids(2 * len(key), np.random.default_rng([settings.seed, 3]))
    originals = key.assign(id=ids[: len(key)], copy_of="")
    copies = key.assign(id=ids[len(key) :], copy_of=ids[: len(key)])
    key = pandas.concat([originals, copies], ignore_index=True)[[*KEY_COLUMNS, *columns]]
    speed = float(key.loc[key["recording"] != "", "reference_speed"].mean())
    return Stimuli(key, np.tile(textures, (2, 1)), held_out.sampling_rate, full_scale, attenuation_db, speed)


def _levelled(condition, textures, reference, level):
    """Textures (n, samples) float64 at their level, and the gains in dB that brought them there, (n,)."""
    if not (rms(textures) > 0).all():
        raise ValueError(f"A texture {condition!r} is silent and has no level. Leave this condition out.")
    gains = rms(reference) / rms(textures) if level == "matched" else np.ones(len(textures))
    return gains[:, None] * textures.astype(np.float64), 20 * np.log10(gains)


def blind_ids(count, rng):
    """(count,) different random ids of six consonants each."""
    found = {}
    while len(found) < count:
        found["".join(rng.choice(_LETTERS, _LETTERS_PER_ID))] = None
    return list(found)


def write_stimuli(folder, stimuli):
    """Writes each texture as `<id>.wav` with its sidecar and as `<id>.npz` to an existing folder.

    All files have one scale, so that a player that ignores sidecars keeps the levels. They hold nothing that would
    reveal a condition: no ratings, the seed 0, one reference speed, and they are written in the order of their ids.
    """
    nothing = [np.nan] * len(RATING_AXES)
    for row in np.argsort(stimuli.key["id"].to_numpy()):
        name, texture = stimuli.key["id"][row], stimuli.textures[row]
        common = {
            "sampling_rate": stimuli.sampling_rate,
            "friction_coefficient": stimuli.key["friction_coefficient"][row],
            "ratings": nothing,
            "seed": 0,
        }
        write_wav(folder / f"{name}.wav", texture, full_scale=stimuli.full_scale, **common)
        write_npz(folder / f"{name}.npz", texture, reference_speed=stimuli.speed, **common)

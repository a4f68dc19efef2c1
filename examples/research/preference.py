"""How many comparisons a preference search takes, with simulated people of known taste: `python
examples/research/preference.py --output examples/results`.

A person likes one point best, and of two textures the one that feels nearer to it. What is felt is the asked rating
with the noise of one trial of a virtual rater (`tactile_diffusers.virtual.raters`), drawn anew each time; differences
below a threshold are answered "neither". Beside the search: random pairs with the same model, and sliders, one after
the other on a grid, where each setting is compared with the best so far. No textures are made, but for the last row,
in which people compare and judge what the rating estimator reads from the generated textures themselves.
"""

import argparse
import json
import sys
from pathlib import Path

import numpy as np

from tactile_diffusers.cli.program import add_checkpoint_argument, load_pipeline
from tactile_diffusers.io.files import write_text
from tactile_diffusers.models import RatingStatistics
from tactile_diffusers.search import PreferenceSearch
from tactile_diffusers.signal import DEVICE_RATE, nine_band_error_db
from tactile_diffusers.virtual.raters import TRIAL_NOISE

sys.path.append(str(Path(__file__).parents[1]))  # examples, for `report`

from report.figures import figure_panels

#: Where the search is asked for its best, comparisons.
ASKED = (1, 2, 3, 5, 7, 10, 12, 15, 18, 21, 25, 30)
#: z-scores: a difference of distances below is answered "neither"; near is within, per axis.
THRESHOLD, NEAR = 0.25, 0.3
#: Of directions, in standard deviations of their noise: noise of a trial, and weight beside a rating.
DIRECTION_NOISE, DIRECTION_WEIGHT = 0.6, 0.5
RANKED, SETTINGS = 2000, 5
WAYS = {"search": "preference search", "random": "random pairs, same model", "sliders": "sliders on a grid"}


class Person:
    """Likes one point; answers with noise."""

    def __init__(self, search, rng, feel=None):
        space, statistics = search.space, RatingStatistics.from_config(search.space.pipe.dale.config)
        self.axes, self.rng, self.feel = len(space.axes), rng, feel
        count = space.directions
        self.noise = np.append(TRIAL_NOISE, np.full(count, DIRECTION_NOISE))
        self.weight = np.append(np.ones(self.axes), np.full(count, DIRECTION_WEIGHT))

        def draw(number):
            ratings = rng.multivariate_normal(statistics.centre, statistics.covariance, number)
            points = np.hstack([ratings, rng.standard_normal((number, count))])
            return np.clip(points, space.low, space.high)

        self.taste, self.others = draw(1)[0], draw(RANKED if feel is None else 100)
        if feel is not None:
            self.taste, self.others = feel(self.taste[None])[0], feel(self.others)

    def distance(self, felt):
        return np.linalg.norm(self.weight * (felt - self.taste), axis=-1)

    def answer(self, first, second):
        felt = np.stack([first, second]) if self.feel is None else self.feel(np.stack([first, second]))
        near, far = self.distance(felt + self.noise * self.rng.standard_normal(felt.shape))
        return "neither" if abs(near - far) < THRESHOLD else "first" if near < far else "second"

    def judge(self, point):
        """RMS over the ratings of how far a point lies from the taste; share of random points that lie farther."""
        felt = point if self.feel is None else self.feel(point[None])[0]
        away = float(np.sqrt(np.square(felt - self.taste)[: self.axes].mean()))
        return away, float((self.distance(self.others) > self.distance(felt)).mean())


def searched(search, person, way, rng):
    """(len(ASKED), 2): what `Person.judge` says of the best point after each number of comparisons."""
    found, space = [], search.space
    for number in range(1, ASKED[-1] + 1):
        pair = search.next_pair() if way == "search" else space.draw(2, rng)
        search.answer(person.answer(*pair), *pair)
        if number in ASKED:
            found.append(person.judge(search.best_point()[0]))
    return np.array(found)


def slid(search, person):
    """The same of sliders: each is tried at evenly spaced settings, the others as they are."""
    space, found, number = search.space, [], 0
    best = (space.low + space.high) / 2
    while True:
        for axis in range(len(best)):
            for setting in np.linspace(space.low[axis], space.high[axis], SETTINGS + 2)[1:-1]:
                if setting == best[axis]:
                    continue
                tried = best.copy()
                tried[axis] = setting
                if person.answer(best, tried) == "second":
                    best = tried
                number += 1
                if number in ASKED:
                    found.append(person.judge(best))
                if number == ASKED[-1]:
                    return np.array(found)


def measure(pipe, people, directions, ways=WAYS, feel=None):
    """Way -> (people, len(ASKED), 2)."""
    results = {way: [] for way in ways}
    for seed in range(people):
        for way in ways:
            rng = np.random.default_rng([seed, 29])  # the same person for every way
            search = PreferenceSearch(pipe, directions=directions, seed=seed)
            person = Person(search, rng, None if feel is None else feel(search))
            results[way].append(slid(search, person) if way == "sliders" else searched(search, person, way, rng))
    return {way: np.array(rows) for way, rows in results.items()}


def felt_by_estimator(search):
    """What the rating estimator reads of the textures of points."""

    def feel(points):
        out = search.space.textures(points)
        rows = zip(out.textures, out.friction_coefficient, strict=True)
        return np.array([np.ravel(search.space.pipe.estimate_ratings(t, out.sampling_rate, f)) for t, f in rows])

    return feel


def moved(pipe, seeds=20):
    """What directions do: mean change from -1 to 1, of what the estimator reads and of the nine bands, dB.

    Beside: the same between two takes of one rating, which differ in all noise.
    """
    found = {"direction 1": [], "direction 2": [], "another take": []}
    for seed in range(seeds):
        search, other = (PreferenceSearch(pipe, seed=number) for number in (seed, seeds + seed))
        point = Person(search, np.random.default_rng(seed)).taste
        point[-2:] = 0
        ends = np.repeat(point[None], 4, 0)
        ends[[0, 1], -2], ends[[2, 3], -1] = (-1, 1), (-1, 1)
        textures = [
            *search.space.textures(ends).textures,
            *[one.space.textures(point[None]).textures[0] for one in (search, other)],
        ]
        read = [*felt_by_estimator(search)(ends), *[felt_by_estimator(one)(point[None])[0] for one in (search, other)]]
        for name, place in zip(found, (0, 2, 4), strict=True):
            bands = nine_band_error_db(textures[place], textures[place + 1], DEVICE_RATE)
            found[name].append([*np.abs(read[place] - read[place + 1]), bands])
    return {name: np.mean(rows, 0).tolist() for name, rows in found.items()}


def summary(results):
    """Way -> medians and shares after each number of comparisons, and comparisons until the taste is met."""
    found = {}
    for way, values in results.items():
        away, rank = values[..., 0], values[..., 1]
        near, high = away <= NEAR, rank > 0.9
        until = {"near": near, "ranked": high, "met": near | high}
        found[way] = {
            "people": len(values),
            "median_away": np.median(away, 0).tolist(),
            "median_rank": np.median(rank, 0).tolist(),
            **{f"share_{name}": hits.mean(0).tolist() for name, hits in until.items()},
            **{f"until_{name}": _median_until(hits) for name, hits in until.items()},
        }
    return found


def _median_until(hits):
    """Median over people of the comparisons from which on the taste stays met; None = more than were asked."""
    stays = np.flip(np.logical_and.accumulate(np.flip(hits, 1), 1), 1)
    counts = np.where(stays.any(1), np.array(ASKED)[stays.argmax(1)], np.inf)
    middle = float(np.median(counts))
    return middle if np.isfinite(middle) else None


def page(report, directions):
    """The page as Markdown."""
    lines = [
        "# How many comparisons find a texture?",
        "",
        f"{__doc__.split(chr(10) * 2, 1)[1].strip()}".replace("\n", " "),
        "",
        f"*Near*: within {NEAR} z-scores per axis (RMS over the three ratings). *Ranked*: liked better than 90 % of "
        "random points of the training surfaces' distribution. Numbers of comparisons are medians over people, from "
        f"which on it stays so up to the last, the {ASKED[-1]}th; > = not for half of the people.",
        "",
        "| searched | way | people | near or ranked | ranked | near | away after 10, z | after 25, z |",
        "|---|---|---:|---:|---:|---:|---:|---:|",
    ]
    for name, ways in report.items():
        for way, row in ways.items():
            until = [_text(row[f"until_{kind}"]) for kind in ("met", "ranked", "near")]
            away = [f"{row['median_away'][ASKED.index(number)]:.2f}" for number in (10, 25)]
            lines.append(f"| {name} | {WAYS[way]} | {row['people']} | {' | '.join([*until, *away])} |")
    bands = {name: f"{row[-1]:.1f}" for name, row in directions.items()}
    lines += [
        "",
        "![curves](preference.png)",
        "",
        "    python examples/research/preference.py --output examples/results",
        "",
        f"From −1 to 1, direction 1 changes nine bands by {bands['direction 1']} dB and direction 2 by "
        f"{bands['direction 2']} dB; another texture of the same ratings differs by {bands['another take']} dB.",
    ]
    lines += ["", "Assumed, not measured with people: noise, threshold and the shape "]
    lines[-1] += "of a taste, which is nearest to one point. A person with two tastes, or none, takes longer. The rule "
    lines[-1] += "that chooses pairs was itself chosen among five on 100 other people of this kind. Of people whose "
    lines[-1] += "answers come from the textures there are too few to tell the last two rows apart."
    return "\n".join(lines) + "\n"


def _text(number):
    return f"> {ASKED[-1]}" if number is None else f"{number:g}"


def plot(report, path):
    """Distance and share met over comparisons, a row for each thing searched."""
    with figure_panels(path, len(report), 2, (9, 3.2 * len(report))) as panels:
        for row, (name, ways) in zip(panels, report.items(), strict=True):
            for way, values in ways.items():
                for panel, key in zip(row, ("median_away", "share_met"), strict=True):
                    panel.plot(ASKED, values[key], marker=".", label=WAYS[way])
            row[0].axhline(NEAR, color="0.7", linewidth=1)
            row[0].set(title=name, xlabel="comparisons", ylabel="from the taste, z (median)", ylim=(0, None))
            row[1].set(title=name, xlabel="comparisons", ylabel="share of people: near or ranked", ylim=(0, 1))
            for panel in row:
                panel.title.set_fontsize(8)
            row[0].legend(fontsize=7)


def main(argv=None):
    """Runs the command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, required=True, metavar="FOLDER", help="of preference.md and .png")
    parser.add_argument("--people", type=int, default=200)
    parser.add_argument("--listeners", type=int, default=12, help="people who compare generated textures")
    add_checkpoint_argument(parser)
    arguments = parser.parse_args(argv)
    pipe = load_pipeline(arguments.checkpoint)
    report = {
        "3 ratings": summary(measure(pipe, arguments.people, 0)),
        "3 ratings, 2 directions": summary(measure(pipe, arguments.people, 2)),
        "3 ratings, as the estimator reads them from the textures": summary(
            measure(pipe, arguments.listeners, 0, ("search", "random"), felt_by_estimator)
        ),
    }
    arguments.output.mkdir(parents=True, exist_ok=True)
    directions = moved(pipe)
    plot(report, arguments.output / "preference.png")
    write_text(arguments.output / "preference.md", page(report, directions))
    print(json.dumps({"searches": report, "directions": directions}, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())

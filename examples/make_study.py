"""A study with people: `python examples/make_study.py make --data prepared.h5 --output study`."""

import argparse
import json
import sys
from pathlib import Path

from tactile_diffusers.cli.program import (
    Parser,
    add_checkpoint_argument,
    add_seed_argument,
    checkpoint_name,
    command,
    existing_file,
    load_pipeline,
)
from tactile_diffusers.io.argument_types import count

DESCRIPTION = """\
Prepares a study in which people feel real, generated and baseline textures, and analyses what they answered.

  make      stimuli under blind ids, trial lists, key and protocol.md from a checkpoint and a prepared data set
  rehearse  answers of simulated participants: tries the analysis and shows the power of the design
  analyse   report.json, report.md and pictures from filled-in trial lists

No human result comes with this package.
"""


def parse_arguments(argv=None):
    """Arguments of the command."""
    parser = Parser(prog="make_study.py", description=DESCRIPTION, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    _add_make(commands.add_parser("make", help="stimuli, trial lists, key and protocol"))
    _add_rehearse(commands.add_parser("rehearse", help="simulated participants"))
    _add_analyse(commands.add_parser("analyse", help="the report of filled-in trial lists"))
    for one in commands.choices.values():
        one.add_argument("--quiet", action="store_true", help="print nothing but errors, no progress bars")
    return parser.parse_args(argv)


def _add_make(parser):
    from study.stimuli import BASELINES, LEVELS, StimulusSettings
    from study.trials import TASKS

    add, default = parser.add_argument, StimulusSettings
    add("--data", type=existing_file, required=True, metavar="PREPARED.h5", help="its test surfaces are used")
    add_checkpoint_argument(parser)
    add("--output", type=Path, required=True, metavar="FOLDER", help="new or empty")
    add("--surfaces", type=int, default=default.surfaces, metavar="N", help=f"default: {default.surfaces}")
    add("--participants", type=count, default=12, metavar="N", help="trial lists; default: 12")
    add("--tasks", nargs="+", choices=TASKS, default=list(TASKS), help="default: all")
    add("--baselines", nargs="*", choices=BASELINES, default=list(default.baselines),
        help=f"default: {' '.join(default.baselines)}")  # fmt: skip
    add("--level", choices=LEVELS, default=default.level,
        help="matched (default): all textures of a surface have one RMS; natural: as they are")  # fmt: skip
    add("--full_scale", type=float, metavar="NEWTONS",
        help="largest force of the device, N, to which all are attenuated; default: largest peak")  # fmt: skip
    add_seed_argument(parser, "seed of all choices")


def _add_rehearse(parser):
    add = parser.add_argument
    add("--study", type=Path, required=True, metavar="FOLDER", help="of `make`")
    add("--output", type=Path, metavar="FOLDER", help="default: rehearsal/ in the study")
    add("--participants", type=count, metavar="N", help="default: as many as there are trial lists")
    add("--repeats", type=int, default=100, metavar="N", help="simulated studies; default: 100")
    for name, what in (
        ("dprime", "sensitivity to a condition, d′"),
        ("rating_share", "share of the rating that is felt"),
    ):
        add(f"--{name}", nargs="+", type=_condition, default=[], metavar="CONDITION=VALUE",
            help=f"assumed {what}; see power.md")  # fmt: skip


def _condition(item):
    condition, _, value = item.partition("=")
    return condition, float(value)  # argparse turns a ValueError into its message


def _add_analyse(parser):
    add = parser.add_argument
    add("--study", type=Path, required=True, metavar="FOLDER", help="of `make`")
    add("--responses", type=Path, required=True, metavar="FOLDER", help="trial lists, filled in")
    add("--output", type=Path, required=True, metavar="FOLDER", help="report.json, report.md, pictures")
    add("--allow_missing", action="store_true", help="leave unanswered trials out, and count them; default: refuse")
    add_seed_argument(parser, "seed of the bootstrap")


@command("make_study.py")
def main(argv=None):
    """Runs the command."""
    arguments = parse_arguments(argv)
    {"make": _make, "rehearse": _rehearse, "analyse": _analyse}[arguments.command](arguments)


def _make(arguments):
    from study import StimulusSettings, make_study

    settings = StimulusSettings(
        surfaces=arguments.surfaces,
        baselines=tuple(arguments.baselines),
        level=arguments.level,
        full_scale=arguments.full_scale,
        seed=arguments.seed,
    )
    study = make_study(
        load_pipeline(arguments.checkpoint),
        arguments.data,
        arguments.output,
        settings,
        arguments.participants,
        arguments.tasks,
        checkpoint_name(arguments.checkpoint),
        arguments.quiet,
    )
    if not arguments.quiet:
        facts = study.settings
        print(
            f"{len(study.key)} files of {len(facts['surfaces'])} surfaces, {facts['participants']} trial lists of "
            f"{facts['trials']} answers; read {study.folder / 'protocol.md'}, hide {study.folder / 'experimenter'}"
        )


def _rehearse(arguments):
    from study import Population, analyse, check_responses, power, read_study, simulate_participants, write_report
    from study.folder import write_csv
    from study.study_report import power_markdown

    from tactile_diffusers.io.files import write_text

    study = read_study(arguments.study)
    output = arguments.output or study.folder / "rehearsal"
    count = arguments.participants or study.settings["participants"]
    seed = study.settings["seed"]
    population, tasks = Population(dict(arguments.dprime), dict(arguments.rating_share)), study.settings["tasks"]
    shares = power(study.key, count, seed, population, tasks, arguments.repeats, arguments.quiet)
    done = simulate_participants(study.key, count, seed, population, tasks)
    answers, missing = check_responses(done.assign(response=""), done)
    write_report(output, analyse(study.key, answers, missing, seed), study.key, answers)
    (output / "responses").mkdir(exist_ok=True)
    for name, rows in done.groupby("participant"):
        write_csv(output / "responses" / f"{name}.csv", rows)
    facts = {"simulated": True, "participants": count, "repeats": arguments.repeats, "seed": seed, "power": shares}
    write_text(output / "power.json", json.dumps(facts, indent=1, allow_nan=False) + "\n")
    text = power_markdown(facts, population, study.settings["conditions"])
    write_text(output / "power.md", text)
    if not arguments.quiet:
        print(f"{text}\nwrote {output / 'power.md'} and {output / 'report.md'}")


def _analyse(arguments):
    from study import analyse, read_answers, report_markdown, write_report

    study, answers, missing = read_answers(arguments.study, arguments.responses, arguments.allow_missing)
    report = analyse(study.key, answers, missing, arguments.seed)
    write_report(arguments.output, report, study.key, answers)
    if not arguments.quiet:
        print(f"{report_markdown(report)}\nwrote {arguments.output / 'report.md'}")


if __name__ == "__main__":
    sys.exit(main())

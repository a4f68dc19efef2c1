"""`tactile-diffusers search`: the texture that somebody prefers, by comparisons of two, from answers in a file."""

from pathlib import Path

from ..signal.constants import RATING_AXES
from .program import Parser, add_common_arguments, command, existing_file, load_pipeline, program
from .recording_file import write_texture


def parse_arguments(argv=None):
    """Arguments of the command."""
    parser = Parser(
        prog=program("search.py"),
        description="Find a texture by comparisons of two. Each call takes the answers that came since the last one, "
        "keeps them in --search, and writes the next pair as first and second, and the best texture so far.",
    )
    add = parser.add_argument
    add("--search", type=Path, required=True, metavar="FILE.json", help="of the search with all its answers; begun if "
        "it is not there")  # fmt: skip
    add("--answer", choices=("first", "second", "neither"), help="to the pair that the last call wrote")
    add("--answers", type=existing_file, metavar="FILE.txt", help="many answers, one word a line, each to the pair "
        "that follows from those before it")  # fmt: skip
    add("--axes", nargs="*", choices=RATING_AXES, default=None, metavar="AXIS", help="of a new search; default: all")
    add("--directions", type=int, default=2, metavar="N", help="of a new search: what is searched beside ratings; "
        "default: 2")  # fmt: skip
    add_common_arguments(parser, "folder of the textures", "of a new search")
    return parser.parse_args(argv)


@command("search.py")
def main(argv=None):
    """Runs the command."""
    arguments = parse_arguments(argv)
    from ..search import PreferenceSearch

    words = arguments.answers.read_text(encoding="utf-8-sig").split() if arguments.answers else []
    words += [arguments.answer] if arguments.answer else []
    pipe = load_pipeline(arguments.checkpoint)
    if arguments.search.is_file():
        search = PreferenceSearch.load(arguments.search, pipe)
    else:
        search = PreferenceSearch(pipe, arguments.axes, arguments.directions, seed=arguments.seed)
    arguments.seed = search.seed
    for word in words:
        search.next_pair()
        search.answer(word)
    search.save(arguments.search)
    best = search.best()
    pair, axes = search.propose(), pipe.dale.config.rating_axes
    for row, name in enumerate(("first", "second")):
        write_texture(arguments, name, pair, search.space.ratings(search.next_pair())[row], row, axes=axes)
    write_texture(arguments, "best", best.texture, search.space.ratings([list(best.point.values())])[0], axes=axes)
    print(f"{len(search.answers)} answers; best so far, with its uncertainty:")
    for name, value in best.point.items():
        print(f"  {name} {value:+.2f} ± {best.uncertainty[name]:.2f}")

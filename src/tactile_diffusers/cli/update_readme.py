"""`python examples/update_readme.py`: what README.md quotes from RESULTS.md."""

import re
import sys
from pathlib import Path

from . import readme
from .program import Parser


def excerpt(results, name, title):
    """The text under a title of a measured block, without what lies under further titles.

    Args:
        results (`str`): Markdown with blocks between markers.
        name (`str`): of the block.
        title (`str`): of a section in it.

    Raises:
        ValueError: if there is no such block or title.
    """
    begin, end = readme.markers(name)
    if not -1 < results.find(begin) < results.find(end):
        raise ValueError(f"There is no block {name!r}: it lies between the lines {begin!r} and {end!r}.")
    block = results[results.index(begin) + len(begin) : results.index(end)]
    found = re.search(rf"^#+ {re.escape(title)}\n(.*?)(?=^#+ |\Z)", block, flags=re.MULTILINE | re.DOTALL)
    if found is None:
        raise ValueError(f"The block {name!r} has no title {title!r}.")
    return found[1].strip()


def quoted(text):
    """What a text quotes: pairs of block and title, from the markers `<!-- begin block / title -->`."""
    return re.findall(r"^<!-- begin (\S+) / (.+) -->$", text, flags=re.MULTILINE)


def main(argv=None):
    """Runs the command; 1 with `--check` where something is not as it is quoted."""
    parser = Parser(prog="update_readme.py", description="Copy excerpts of RESULTS.md into README.md.")
    parser.add_argument("--readme", type=Path, default=Path("README.md"), metavar="README.md")
    parser.add_argument("--results", type=Path, default=Path("RESULTS.md"), metavar="RESULTS.md")
    parser.add_argument("--check", action="store_true", help="write nothing; exit code 1 if something would change")
    arguments = parser.parse_args(argv)
    for path in (arguments.readme, arguments.results):
        if not path.is_file():
            parser.error(f"{path} is not a file; run this in the root of the repository")
    results, before = (path.read_text(encoding="utf-8") for path in (arguments.results, arguments.readme))
    changed = 0
    for name, title in quoted(before):
        text, marker = excerpt(results, name, title), f"{name} / {title}"
        begin, end = readme.markers(marker)
        old = before[before.index(begin) + len(begin) : before.index(end)].strip()
        if old != text:
            changed += 1
            print(f"{marker}: {'differs' if arguments.check else 'written'}")
            if not arguments.check:
                readme.write_between(arguments.readme, marker, text)
    return 1 if arguments.check and changed else 0


if __name__ == "__main__":
    sys.exit(main())

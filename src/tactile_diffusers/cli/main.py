"""`tactile-diffusers COMMAND`: all commands under one name, each a module that is loaded when it is asked for."""

import importlib
import sys

from .program import NAME

#: Command -> module and what it does.
COMMANDS = {
    "generate": ("generate", "ratings in, files of a texture out"),
    "reconstruct": ("reconstruct", "a recording through encoder and decoder, and how near it comes"),
    "export": ("export", "textures as files for devices"),
    "dataset": ("generate_dataset", "many textures, by several processes"),
    "prepare": ("prepare_data", "recordings in, a prepared data set out"),
    "inspect": ("inspect_data", "a card of recordings, with warnings and remedies"),
    "evaluate": ("evaluate", "figures of a checkpoint on held-out surfaces"),
    "compare": ("compare", "reports side by side"),
    "study": ("make_study", "stimuli, trials and analysis of a study with people"),
    "publish": ("publish", "a trained pipeline as a small, documented folder"),
}


def usage():
    """What the commands are."""
    width = max(map(len, COMMANDS))
    rows = [f"  {name:{width}}  {text}" for name, (_, text) in COMMANDS.items()]
    return "\n".join(
        [f"usage: {NAME} COMMAND [options]", "", *rows, "", f"`{NAME} COMMAND --help` lists the options of one."]
    )


def main(argv=None):
    """Runs a command; returns its exit code, 2 for an unknown one.

    Args:
        argv (`list[str]`, *optional*): the command and its options; the process's own by default.
    """
    argv = sys.argv[1:] if argv is None else list(argv)
    if not argv or argv[0] in ("-h", "--help"):
        print(usage())
        return 0 if argv else 2
    if argv[0] == "--version":
        from ..version import __version__

        print(__version__)
        return 0
    if argv[0] not in COMMANDS:
        print(f"{NAME}: error: there is no command {argv[0]!r}\n\n{usage()}", file=sys.stderr)
        return 2
    sys.argv[0] = f"{NAME} {argv[0]}"
    return importlib.import_module(f".{COMMANDS[argv[0]][0]}", __package__).main(argv[1:])


if __name__ == "__main__":
    sys.exit(main())

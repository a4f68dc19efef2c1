"""The console command `tactile-diffusers COMMAND`.

It lies beside the package and not in it, because importing the package imports torch: help and errors need none of it.
A command's own module, in `tactile_diffusers.cli`, is imported when the command is called.
"""

import importlib
import importlib.metadata
import sys

NAME = "tactile-diffusers"
#: Command -> module in `tactile_diffusers.cli`, its function where that is not `main`, and what it does.
COMMANDS = {
    "generate": ("generate", "textures of ratings, as files"),
    "reconstruct": ("reconstruct", "a recording through encoder and decoder, and how close it comes"),
    "edit": ("edit", "a recording changed by ratings, or stretches of it made anew"),
    "continue": ("edit:lengthen", "a recording, longer"),
    "loop": ("edit:loop", "a recording whose end leads into its beginning"),
    "export": ("export", "textures in the formats of devices"),
    "convert": ("convert", "a texture from one format to another, and what was lost"),
    "play": ("play", "the force that a finger meets along a trajectory"),
    "search": ("search", "the texture that you prefer, by comparisons of two"),
    "prepare": ("prepare_data", "recordings as a data set for training"),
    "adapt": ("adapt", "a pretrained pipeline to the few surfaces of a lab"),
}


def usage():
    """The commands, a line each."""
    width = max(map(len, COMMANDS))
    rows = [f"  {name:{width}}  {text}" for name, (_, text) in COMMANDS.items()]
    end = f"`{NAME} COMMAND --help` lists the options of a command, `{NAME} --version` prints the version."
    return "\n".join([f"usage: {NAME} COMMAND [options]", "", *rows, "", end])


def main(argv=None):
    """Runs a command and returns its exit code; 2 if there is no such command.

    Args:
        argv (`list[str]`, *optional*): the command and its options; defaults to those of the process.
    """
    argv = sys.argv[1:] if argv is None else list(argv)
    if not argv or argv[0] in ("-h", "--help"):
        print(usage())
        return 0 if argv else 2
    if argv[0] == "--version":
        print(importlib.metadata.version(NAME))
        return 0
    if argv[0] not in COMMANDS:
        print(f"{NAME}: error: there is no command {argv[0]!r}\n\n{usage()}", file=sys.stderr)
        return 2
    sys.argv[0] = f"{NAME} {argv[0]}"
    module, _, function = COMMANDS[argv[0]][0].partition(":")
    return getattr(importlib.import_module(f"tactile_diffusers.cli.{module}"), function or "main")(argv[1:])


if __name__ == "__main__":
    sys.exit(main())

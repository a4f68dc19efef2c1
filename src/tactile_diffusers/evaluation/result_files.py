"""What commands that measure share: the machine's name, and how results are written."""

import json

import torch

from ..io.files import write_text
from . import report as evaluation


def machine(computing=None):
    """The machine in words: processor, what computes (by default torch's threads), version of torch."""
    computing = computing or f"{torch.get_num_threads()} threads"
    return f"{evaluation.machine()['processor']}, {computing}, torch {torch.__version__}"


def write_results(output, name, report, text, indent=2):
    """Writes NAME.json and NAME.md.

    Args:
        output (`Path`): a folder, made where it is missing.
        name (`str`): of both files.
        report (`dict`): for JSON.
        text (`str`): Markdown.
        indent (`int`): of the JSON.
    """
    output.mkdir(parents=True, exist_ok=True)
    write_text(output / f"{name}.json", json.dumps(report, indent=indent) + "\n")
    write_text(output / f"{name}.md", text)

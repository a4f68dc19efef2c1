"""How results are written: the machine that measured them, and files of one name."""

import json
import os
import platform
from pathlib import Path

import torch

from ..io.files import write_text


def machine_facts():
    """Processor, cores, threads and system of this machine: a dict for JSON."""
    name = platform.processor() or platform.machine()
    try:
        models = [line for line in Path("/proc/cpuinfo").read_text().splitlines() if line.startswith("model name")]
        name = models[0].split(":")[1].strip()
    except (OSError, IndexError):
        pass
    return {"processor": name, "cores": os.cpu_count(), "threads": torch.get_num_threads(), "system": platform.system()}


def machine(computing=None):
    """The machine in words: processor, what computes (by default torch's threads), version of torch."""
    computing = computing or f"{torch.get_num_threads()} threads"
    return f"{machine_facts()['processor']}, {computing}, torch {torch.__version__}"


def write_results(output, name, report, text, indent=2):
    """Writes a report (dict) as NAME.json and its Markdown text as NAME.md to a folder, made where it is missing."""
    output.mkdir(parents=True, exist_ok=True)
    write_text(output / f"{name}.json", json.dumps(report, indent=indent) + "\n")
    write_text(output / f"{name}.md", text)

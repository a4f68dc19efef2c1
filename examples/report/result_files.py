"""How results are written: under which conditions they were measured, and files of one name."""

import json
import os
import platform
import shlex
import subprocess
import sys
from datetime import UTC, datetime
from pathlib import Path

import torch

from tactile_diffusers.io.files import write_text
from tactile_diffusers.pipelines.folders import folder_digest

#: A load of the machine over this, before a measurement begins, is other work beside it; starting one takes the rest.
IDLE = 0.8


def machine_facts():
    """Processor, cores, threads and system of this machine: a dict for JSON."""
    name = platform.processor() or platform.machine()
    try:
        models = [line for line in Path("/proc/cpuinfo").read_text().splitlines() if line.startswith("model name")]
        name = models[0].split(":")[1].strip()
    except (OSError, IndexError):
        pass
    return {"processor": name, "cores": os.cpu_count(), "threads": torch.get_num_threads(), "system": platform.system()}


def conditions(checkpoint, data=None):
    """What a result is of, a dict for JSON: ask before the measurement, which is a load of its own.

    Args:
        checkpoint (`str` or `Path`): a folder, or a Hub id, of which there is no digest.
        data (`PreparedDataset`, *optional*): that it is measured on.
    """
    folder = Path(checkpoint)
    return {
        "command": shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]]),
        "checkpoint": {"name": folder.name, "sha256": folder_digest(folder) if folder.is_dir() else None},
        "data": None if data is None else _data_facts(data),
        "machine": machine_facts() | {"torch": torch.__version__},
        "load_before": round(os.getloadavg()[0], 2),
        "commit": _commit(),
        "date": datetime.now(UTC).date().isoformat(),
    }


def _commit():
    """The commit of the code, "-dirty" where code was changed since: results are not code. `None` outside of git."""

    def git(*words):
        words = ["git", "-C", Path(__file__).parents[2], *words]
        return subprocess.run(words, capture_output=True, text=True).stdout.strip()

    changed = git("status", "--porcelain", "--", "src", "examples", ":!examples/results")
    return (git("rev-parse", "--short", "HEAD") + ("-dirty" if changed else "")) or None


def _data_facts(data):
    facts = ("source", "recipe_version", "seed")
    return {"name": Path(data.path).name} | {name: data.attributes[name] for name in facts if name in data.attributes}


def stamp(found):
    """The conditions in one line of Markdown."""
    facts, data = found["machine"], found["data"]
    parts = [f"Checkpoint {found['checkpoint']['name']} {(found['checkpoint']['sha256'] or '')[:12]}".strip()]
    if data is not None:
        parts.append(", ".join(f"{name} {value}" for name, value in data.items()))
    parts.append(f"{facts['processor']}, {facts['threads']} threads, torch {facts['torch']}")
    parts += [f"commit {found['commit']}", found["date"], f"`{found['command']}`"]
    if found["load_before"] > IDLE:
        parts.append(f"other work ran beside it (load {found['load_before']}): ratios count, seconds do not")
    return "*" + "; ".join(parts) + ".*"


def write_results(output, name, report, text, indent=2):
    """Writes a report (dict) as NAME.json and its Markdown text as NAME.md to a folder, made where it is missing."""
    output.mkdir(parents=True, exist_ok=True)
    write_text(output / f"{name}.json", json.dumps(report, indent=indent) + "\n")
    write_text(output / f"{name}.md", text)

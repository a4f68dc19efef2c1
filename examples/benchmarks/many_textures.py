"""`benchmark.py --suite dataset`: many textures, by one process and by one for each core."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from tactile_diffusers.evaluation.result_files import machine, write_results
from tactile_diffusers.evaluation.tables import markdown_table, title

#: Textures of a shard here: enough shards to see whether time grows in proportion.
SHARD = 64
_CODE = "import sys; from tactile_diffusers.cli.generate_dataset import main; sys.exit(main(sys.argv[1:]))"


def run(arguments, pipe):
    """Measures, writes dataset.json and dataset.md, and returns the Markdown.

    Args:
        arguments (`argparse.Namespace`): "output" (`Path`, a folder), "textures" (`int`), "checkpoint", "quiet".
        pipe (`TactileTexturePipeline`): not used; every run loads its own.

    Returns:
        `str`
    """
    counts = sorted({1, os.cpu_count() or 1})
    where = machine(f"{os.cpu_count()} cores")
    rows = {f"{count} process(es)": measure(arguments, count) for count in counts}
    text = (
        f"{title('Many textures', 4)}{arguments.textures} textures of one segment, 5 + 5 steps, batches of 32, by "
        f"`generate_dataset.py`. {where}. Departure: of the time at which a process finishes its shards from a "
        f"straight line, largest, as a share of the whole time.\n\n{markdown_table(rows, 3)}\n"
    )
    write_results(arguments.output, "dataset", {"machine": where, "rows": rows}, text)
    return text


def measure(arguments, processes):
    """Generates a data set in fresh processes.

    Returns:
        `dict`: seconds without starting, textures a second, hours for 100,000, departure from proportion.

    Raises:
        RuntimeError: if generating fails, with the end of what it wrote.
    """
    with tempfile.TemporaryDirectory(dir=arguments.output.parent) as folder:
        words = ["--num_textures", arguments.textures, "--output", folder, "--textures_per_shard", SHARD]
        words += ["--checkpoint", arguments.checkpoint]
        words += ["--quiet"] if arguments.quiet else []
        launch = [sys.executable, "-m", "torch.distributed.run", "--no_python", "--nproc_per_node", processes]
        done = subprocess.run(
            [str(word) for word in (*launch, sys.executable, "-c", _CODE, *words)],
            stderr=subprocess.PIPE if arguments.quiet else None,
            stdout=subprocess.DEVNULL,
            text=True,
        )
        if done.returncode:
            raise RuntimeError(f"generate_dataset.py failed with {done.returncode}: {(done.stderr or '')[-1000:]}")
        finished = np.array([path.stat().st_mtime for path in sorted(Path(folder).glob("*.h5"))])
    return growth(finished, arguments.textures, processes)


def growth(finished, textures, processes):
    """Figures from the times at which shards were finished, in the order of their numbers.

    Process p makes shards p, p + processes, ...; from its first shard to its last one nothing is started or loaded.
    """
    if len(finished) < 3 * processes:
        raise ValueError(f"{textures} textures are {len(finished)} shards: too few for {processes} processes.")
    rates, departures = [], []
    for process in range(processes):
        times = finished[process::processes][: textures // SHARD // processes]  # the last shard may be a short one
        shards = np.arange(len(times))
        line = np.polyfit(shards, times, 1)
        departures.append(np.abs(times - np.polyval(line, shards)).max() / (times[-1] - times[0]))
        rates.append(SHARD / line[0])
    rate = float(sum(rates))
    return {
        "textures a second": rate,
        "hours for 100,000": 1e5 / rate / 3600,
        "departure from proportion": float(max(departures)),
    }

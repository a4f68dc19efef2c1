"""How fast are many textures generated, by one process and by one per core?

`python examples/benchmarks/many_textures.py --output report`
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from benchmarking import finish, machine, make_parser, parse

from tactile_diffusers.export.generated import find_shards
from tactile_diffusers.io.argument_types import count

sys.path.append(str(Path(__file__).parents[1]))  # examples, for `report`

from report.tables import markdown_table, title

#: Textures of a shard here: enough shards to see whether time grows in proportion.
SHARD = 64
_SCRIPT = Path(__file__).parents[1] / "generate_dataset.py"


def main(argv=None):
    """Measures and writes dataset.json and dataset.md."""
    parser = make_parser("many_textures.py", "Speed of generate_dataset.py in one process and in one per core.")
    parser.add_argument("--textures", type=count, default=2000, metavar="N", help="that are generated; default: 2000")
    arguments = parse(parser, argv)
    cores = os.cpu_count() or 1
    if arguments.textures < 3 * cores * SHARD:
        parser.error(f"argument --textures: must be at least {3 * cores * SHARD} here, got {arguments.textures}")
    where = machine(f"{cores} cores")
    rows = {f"{number} process(es)": measure(arguments, number) for number in sorted({1, cores})}
    text = (
        f"{title('Many textures', 4)}{arguments.textures} textures of one segment, default steps, batches of 32, by "
        f"`generate_dataset.py`. {where}. Departure: of the time at which a process finishes its shards from a "
        f"straight line, largest, as a share of the whole time.\n\n{markdown_table(rows, 3)}\n"
    )
    return finish(arguments, "dataset", {"machine": where, "rows": rows}, text)


def measure(arguments, processes):
    """`growth` of a data set that fresh processes generate."""
    with tempfile.TemporaryDirectory() as folder:
        words = [sys.executable, "-m", "torch.distributed.run", "--nproc_per_node", processes, _SCRIPT]
        words += ["--num_textures", arguments.textures, "--output", folder, "--textures_per_shard", SHARD]
        words += ["--checkpoint", arguments.checkpoint, "--quiet"]
        done = subprocess.run([str(word) for word in words], capture_output=True, text=True)
        if done.returncode:
            raise RuntimeError(f"generate_dataset.py failed with {done.returncode}: {done.stderr[-1000:]}")
        finished = np.array([path.stat().st_mtime for path in find_shards(folder)])
    return growth(finished, arguments.textures, processes)


def growth(finished, textures, processes):
    """Figures from the times at which shards were finished, in the order of their numbers.

    Process p generates shards p, p + processes, ...; from its first shard to its last one nothing is started or loaded.
    """
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


if __name__ == "__main__":
    sys.exit(main())

"""Reads files that claim absurd sizes, one after the other, and says how each was refused: a line of JSON each.

A process of its own, so that its largest memory is that of the readers. The limit is a net for the machine; a reader
that runs into it has asked for the memory, which is what must not happen.
"""

import json
import resource
import sys
import time
import warnings
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "examples" / "demo"))
from uploads import read_upload  # noqa: E402

from tactile_diffusers.cli.dataset_ratings import read_ratings_file
from tactile_diffusers.data import PreparedDataset, RecordingsFile
from tactile_diffusers.data.folder.tables import list_tables
from tactile_diffusers.export import FORMATS, read_generated


class Config:
    rating_axes = ["roughness", "bumpiness", "slipperiness"]


def columns(path):
    return [table.numbers(name) for table in list_tables(path) for name in table.names]


def recordings(path):
    with RecordingsFile(path) as file:
        return [file.read(name) for name in file.names]


READERS = {
    "table": columns,
    "npz": FORMATS["npz"].read,
    "hdf5": FORMATS["hdf5"].read,
    "wav": FORMATS["wav"].read,
    "png": FORMATS["png"].read,
    "recordings": recordings,
    "prepared": lambda path: PreparedDataset(path, "all"),
    "generated": lambda path: read_generated(path)[:],
    "ratings": lambda path: read_ratings_file(path, Config, 10),
    "upload": lambda path: read_upload(path.read_bytes(), 5000),
}


def status(name):
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) * 1024 for line in lines if line.startswith(name + ":"))


warnings.simplefilter("ignore")
resource.setrlimit(resource.RLIMIT_AS, (status("VmSize") + 2**33,) * 2)
for name, path in json.loads(sys.argv[1]):
    before, start = status("VmHWM"), time.process_time()
    try:
        READERS[name](Path(path))
        found = {"type": "nothing", "message": "", "cause": ""}
    except Exception as error:
        found = {"type": type(error).__name__, "message": str(error), "cause": type(error.__cause__).__name__}
    found |= {"seconds": time.process_time() - start, "bytes": status("VmHWM") - before}
    print(json.dumps({"reader": name, "path": path, **found}), flush=True)

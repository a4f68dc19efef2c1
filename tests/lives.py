"""Runs scripts in forks of a process that has imported everything, so that a test can kill many of them.

A line on stdin, {"script": path, "words": [...], "log": path}, starts one; its process id is answered. When it ended,
"ended" is; then any line takes it off the process table and gets its exit status. The other end is in
`tests/conftest.py`.
"""

import importlib.util
import json
import os
import shutil  # noqa: F401 - it looks up in `os` what is slowed down below
import sys
import time
import traceback
from pathlib import Path

#: Seconds that each of these takes at least: a disk so slow that a kill can be aimed between two of them.
DELAY = 0.002
SLOW = ("fsync", "replace", "unlink", "rmdir", "mkdir")


def load(path):
    spec = importlib.util.spec_from_file_location(Path(path).stem, path)
    module = importlib.util.module_from_spec(spec)
    sys.path.append(str(Path(path).parent))  # as of a script that is started
    spec.loader.exec_module(module)
    return module


def slowed(function):
    def call(*arguments, **options):
        time.sleep(DELAY)
        return function(*arguments, **options)

    return call


def live(script, words, log):
    """The forked process: it never returns."""
    with open(log, "ab", buffering=0) as file:
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
    for name in SLOW:
        setattr(os, name, slowed(getattr(os, name)))
    try:
        status = script.main(words)
    except SystemExit as stop:
        status = stop.code
    except BaseException:
        traceback.print_exc()
        status = 1
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status or 0)


def main():
    import matplotlib
    import matplotlib.pyplot  # noqa: F401 - imported by the scripts, late
    import torch

    matplotlib.use("Agg")
    torch.set_num_threads(1)
    torch.use_deterministic_algorithms(True)
    scripts = {}
    print("ready", flush=True)
    for line in sys.stdin:
        request = json.loads(line)
        path = request["script"]
        script = scripts.setdefault(path, None) or load(path)
        scripts[path] = script
        pid = os.fork()
        if not pid:
            live(script, request["words"], request["log"])
        print(pid, flush=True)
        os.waitid(os.P_PID, pid, os.WEXITED | os.WNOWAIT)  # it stays in the table: a late kill hits nobody else
        print("ended", flush=True)
        sys.stdin.readline()
        print(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]), flush=True)


if __name__ == "__main__":
    main()

"""Fuzzes readers of HDF5 files: python tests/fuzz/fuzz_hdf5.py [TARGET ...] [--seconds 180] [--seed 0] [--collect F].

HDF5 may never return from a damaged file, or end the process, and nothing inside the process can stop it. So inputs
are read in a child, which a watchdog ends after `LIMIT` seconds; the next child goes on after the input at fault. An
input is made from seed and number alone. Each kind of fault is counted, and written to the folder once.
"""

import argparse
import faulthandler
import json
import os
import random
import re
import resource
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
import readers

#: Targets whose files are HDF5.
TARGETS = [name for name, target in readers.TARGETS.items() if target.suffix == ".h5"]
#: Seconds that a reader may take, bytes that it may ask for, and inputs after which a child makes room for the next.
LIMIT, MOST_BYTES, INPUTS = 2.0, 2**29, 2000
#: What stands in the place of numbers of 1, 2, 4 or 8 bytes.
ODD = (0, 1, 2, 7, 8, 16, 255, -1, -2, -8, -16, 2**31 - 1, 2**31, 2**40, 2**63 - 1, -(2**63))


def mutated(seeds, rng):
    """One of the good files with one to four changes, most of them near a name or a mark, where headers are."""
    data = bytearray(rng.choice(seeds))
    named = [match.start() for match in re.finditer(rb"[A-Za-z_]{4,}", data)]
    for _ in range(rng.choice((1, 1, 1, 2, 3, 4))):
        size = len(data)
        if not size:
            break
        near = rng.random()
        at = rng.randrange(size)
        if near < 0.7:
            at = min(max(rng.choice(named) + rng.randrange(-64, 64), 0), size - 1)
        elif near < 0.8:
            at = rng.randrange(min(1024, size))
        action = rng.random()
        if action < 0.25:
            data[at] ^= 1 << rng.randrange(8)
        elif action < 0.6:
            width = rng.choice((1, 2, 4, 8))
            value = rng.choice((*ODD, size, rng.randrange(size), int.from_bytes(data[at : at + width], "little") + 8))
            data[at : at + width] = (value % 2 ** (8 * width)).to_bytes(width, "little")
        elif action < 0.75:  # a page of zeros, a disk's own kind of damage
            length = rng.choice((4, 16, 64, 512, 4096))
            data[at : at + length] = bytes(len(data[at : at + length]))
        elif action < 0.95:  # a piece of a good file, often a pointer: circles
            other, length = rng.choice(seeds), rng.choice((8, 8, 24, 64, 512))
            begin = rng.randrange(len(other)) & ~7
            data[at & ~7 : (at & ~7) + length] = other[begin : begin + length]
        else:
            del data[at:]
    return bytes(data)


def _input(seeds, seed, number):
    return mutated(seeds, random.Random(f"{seed}/{number}"))


def _child(target, seeds, seed, number, until, folder, out, stack):
    """Reads input after input, and says of each what its fault was."""
    warnings.simplefilter("ignore")
    size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (size + 2**32,) * 2)
    for current in range(number, number + INPUTS):
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        faulthandler.dump_traceback_later(LIMIT, exit=True, file=stack)
        error = readers.fault(target, _input(seeds, seed, current), folder)
        faulthandler.cancel_dump_traceback_later()
        grown = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
        kind, text = None, ""
        if error is not None:
            last = traceback.extract_tb(error.__traceback__)[-1]
            kind = f"{type(error).__name__} at {Path(last.filename).name}:{last.lineno}"
            text = "".join(traceback.format_exception(error))[-3000:]
        elif grown > MOST_BYTES:
            kind = "memory"
        out.write(json.dumps([current, kind, text]) + "\n")
        out.flush()
        if time.monotonic() > until:
            break


def fuzz(name, seconds, seed=0, collected=None):
    """Reads damaged files for some seconds: returns how many inputs, and a `Counter` of kinds of fault."""
    target, number, found = readers.TARGETS[name], 0, Counter()
    seeds = target.seeds()
    until = time.monotonic() + seconds
    with tempfile.TemporaryDirectory(prefix=f"fuzz-{name}-") as folder:
        while time.monotonic() < until:
            reader, writer = os.pipe()
            with open(Path(folder) / "stack", "w+") as stack:
                child = os.fork()
                if child == 0:
                    os.close(reader)
                    faulthandler.enable(stack)
                    with os.fdopen(writer, "w") as out:
                        _child(target, seeds, seed, number, until, folder, out, stack)
                    os._exit(0)
                os.close(writer)
                with os.fdopen(reader) as replies:
                    for line in replies:
                        current, kind, text = json.loads(line)
                        number = current + 1
                        if kind is not None:
                            _count(found, kind, text, _input(seeds, seed, current), name, collected)
                status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
                if status != 0:
                    stack.seek(0)
                    text = stack.read()
                    frames = re.findall(r'File ".*?([^/"]+)", line (\d+)', text)
                    where = " < ".join(f"{file}:{line}" for file, line in frames[:6])
                    kind = f"{'hang' if status == 1 else f'ended by signal {-status}'} at {where}"
                    _count(found, kind, text, _input(seeds, seed, number), name, collected)
                    number += 1
    return number, found


def _count(found, kind, text, data, name, collected):
    found[kind] += 1
    if collected is not None and found[kind] == 1:
        collected.mkdir(parents=True, exist_ok=True)
        (collected / f"{name}-{len(found)}").write_bytes(data)
        (collected / f"{name}-{len(found)}.txt").write_text(f"{kind}\n{text}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("targets", nargs="*", default=TARGETS, help=f"of {', '.join(TARGETS)}; all by default")
    parser.add_argument("--seconds", type=float, default=180.0, help="of each target")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--collect", type=Path, help="folder for an input of each kind of fault")
    arguments = parser.parse_args()
    faults = 0
    for name in arguments.targets:
        number, found = fuzz(name, arguments.seconds, arguments.seed, arguments.collect)
        print(f"{name}: {number} inputs, {sum(found.values())} at fault", flush=True)
        for kind, count in found.most_common():
            print(f"  {count} x {kind}", flush=True)
        faults += len(found)
    sys.exit(1 if faults else 0)


if __name__ == "__main__":
    main()

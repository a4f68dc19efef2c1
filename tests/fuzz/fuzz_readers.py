"""Fuzzes one reader with atheris (`pip install "atheris>=3,<4"`): python tests/fuzz/fuzz_readers.py TARGET [options].

TARGET "all" is every reader, chosen by the first byte: it shows that the harness works, and finds little. Options are
libFuzzer's: `-max_total_time=180 -rss_limit_mb=2048 -timeout=20`, and a folder for the corpus. Fuzzing ends at the
first fault; what is found becomes a test in tests/fuzz/test_findings.py.
"""

import json
import random
import sys
import tempfile
import warnings
from pathlib import Path

import atheris

sys.path.insert(0, str(Path(__file__).parent))
ROOMS = [f"tactile_diffusers.{room}" for room in ("data", "export", "io", "playback")]
with atheris.instrument_imports(include=[*ROOMS, "tomllib"]):
    import readers

#: What no writer writes, in place of any value of a JSON file.
ODD = [None, True, "", "x", "1", -1, 0, 0.5, 1e308, -1e-320, 2**70, float("nan"), float("inf"), [], {}, [[1]], [None]]


def mutate_json(data, max_size, seed):
    """One value somewhere in a JSON file replaced, removed or doubled; now and then its bytes."""
    rng = random.Random(seed)
    try:
        tree = json.loads(data)
    except (ValueError, RecursionError):
        return atheris.Mutate(data, max_size)
    if rng.random() < 0.1:
        return atheris.Mutate(data, max_size)
    node, key = {"": tree}, ""
    top = node
    while isinstance(node[key], dict | list) and node[key] and rng.random() < 0.85:
        node = node[key]
        key = rng.choice(list(node) if isinstance(node, dict) else range(len(node)))
    action = rng.random()
    if action < 0.15 and node is not top:
        del node[key]
    elif action < 0.25 and isinstance(node, list):
        node.insert(key, node[key])
    elif action < 0.35 and isinstance(node[key], int | float):
        node[key] = node[key] * rng.choice([-1, 0.5, 10])
    else:
        node[key] = rng.choice(ODD)
    made = json.dumps(top[""]).encode()
    return made if len(made) <= max_size else data


def _every_seed():
    for number, target in enumerate(readers.TARGETS.values()):
        for seed in target.seeds():
            yield bytes([number]) + seed


def main():
    arguments = sys.argv[1:]
    name = arguments.pop(0) if arguments else ""
    if name not in (*readers.TARGETS, "all"):
        sys.exit(f"{__doc__}\nTARGET is one of {', '.join(readers.TARGETS)}, all.")
    target = readers.TARGETS.get(name)
    folder = tempfile.mkdtemp(prefix=f"fuzz-{name}-")
    corpus = Path(tempfile.mkdtemp(prefix=f"corpus-{name}-"))
    for number, seed in enumerate(_every_seed() if target is None else target.seeds()):
        (corpus / f"seed{number}").write_bytes(seed)
    warnings.simplefilter("ignore")

    def one_input(data):
        chosen = target
        if target is None:
            chosen, data = list(readers.TARGETS.values())[data[0] % len(readers.TARGETS) if data else 0], data[1:]
        error = readers.fault(chosen, data, folder)
        if error is not None:
            raise error

    options = {"custom_mutator": mutate_json} if target is not None and target.structured else {}
    atheris.Setup([sys.argv[0], "-max_len=60000", *arguments, str(corpus)], one_input, **options)
    atheris.Fuzz()


if __name__ == "__main__":
    main()

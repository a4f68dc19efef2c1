"""What does preparing data cost, and does the loader keep up with training?

`python examples/benchmarks/data_loading.py --output report`
"""

import json
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import torch
from benchmarking import finish, machine, make_parser, parse, run_child

from tactile_diffusers.cli.program import existing_file, load_pipeline
from tactile_diffusers.data import PreparedDataset
from tactile_diffusers.training.batches import EndlessBatches
from tactile_diffusers.virtual import generate_recordings

sys.path.append(str(Path(__file__).parents[1]))  # examples, for `report`

from report.tables import markdown_table

#: Segments of the paper's collection, which preparation is extrapolated to.
PAPER_SEGMENTS = 22_000
#: Virtual surfaces that are recorded (two explorers, 40 s) where no recordings are given.
SURFACES, SECONDS = 16, 40.0
#: Batch sizes of the training scripts.
BATCH = {"LCTG": 16, "DALE": 64}
#: How long each speed is measured, s.
MEASURED_SECONDS = 3.0

#: what a child process does, so that its peak memory is that of the preparation
_PREPARE = """
import json, sys, time
from tactile_diffusers.data import prepare_recordings
begin = time.perf_counter()
report = prepare_recordings(sys.argv[1], sys.argv[2], quiet=True)
print(json.dumps({"seconds": time.perf_counter() - begin, "segments": sum(report.segments["filtered"].values()),
                  "recorded s": sum(report.seconds["filtered"].values())}))
"""


def main(argv=None):
    """Measures and writes data.json and data.md."""
    parser = make_parser("data_loading.py", "Cost of preparing data, and speed of the loader against training.")
    add = parser.add_argument
    add("--recordings", type=existing_file, metavar="R.h5", help="to prepare; default: virtual ones")
    add("--data", type=existing_file, metavar="PREPARED.h5", help="to load; default: what was prepared here")
    arguments = parse(parser, argv)
    pipe = load_pipeline(arguments.checkpoint)
    with tempfile.TemporaryDirectory() as folder:
        recordings, prepared = arguments.recordings, Path(folder) / "prepared.h5"
        if recordings is None:
            recordings = Path(folder) / "recordings.h5"
            generate_recordings(recordings, SURFACES, SECONDS, quiet=arguments.quiet)
        preparation = prepare(recordings, prepared)
        loading, training = feed(arguments.data or prepared, pipe)
    report = {"machine": machine(), "preparation": preparation, "loading": loading, "training": training}
    return finish(arguments, "data", report, markdown(report))


def prepare(recordings, prepared):
    """Seconds and peak memory of `prepare_recordings` in a process of its own: a dict.

    Time is proportional to the recorded seconds and memory to the longest recording, so that 22,000 segments at 10 kHz
    follow. Peak memory is known on Linux only.
    """
    printed, peak = run_child(_PREPARE, str(recordings), str(prepared))
    facts = json.loads(printed.splitlines()[-1])
    facts[f"seconds for {PAPER_SEGMENTS}"] = facts["seconds"] * PAPER_SEGMENTS / facts["segments"]
    facts["peak MiB"] = peak
    facts["MiB on disk"] = prepared.stat().st_size / 2**20
    return facts


def feed(prepared, pipe):
    """Samples per second that a data set gives, by rate and way, and that training takes, by model: rows of tables."""
    extractor, loading = pipe.feature_extractor, {}
    for rate in (None, extractor.sampling_rate):
        begin = time.perf_counter()
        data = PreparedDataset(prepared, "train", sampling_rate=rate)
        row = {"open s": time.perf_counter() - begin, "memory MiB": _memory(data) / 2**20}
        loading[f"{data.sampling_rate} Hz"] = row | _loading_speeds(data, extractor)
    consumption = {}
    for name, step in _training_steps(data, pipe).items():
        taken = speed(step)
        row = {"batch": BATCH[name], "training takes /s": taken}
        # DALE is trained on latents that the frozen encoder makes once: its textures are loaded once
        given = loading[f"{data.sampling_rate} Hz"]["batches with features /s" if name == "LCTG" else "batches /s"]
        consumption[name] = row | {"loader gives /s": given, "times as fast": given / taken}
    return loading, consumption


def speed(work):
    """Samples per second of `work`, which returns how many it made; the first call does not count."""
    work()
    count, begin = 0, time.perf_counter()
    while time.perf_counter() - begin < MEASURED_SECONDS:
        count += work()
    return count / (time.perf_counter() - begin)


def _memory(data):
    """Bytes of the arrays that a view holds, the mapped file apart."""
    arrays = [value for value in vars(data).values() if isinstance(value, np.ndarray)]
    return sum(array.nbytes for array in arrays if not isinstance(array, np.memmap))


def _loading_speeds(data, extractor):
    def features(items):
        textures = torch.stack([item["texture"] for item in items])
        waveform, _ = extractor.normalize(textures, data.sampling_rate)
        return {"waveform": waveform, "input_features": extractor.features(waveform), "index": items}

    def batches(workers, collate=None):
        batch = min(BATCH["LCTG"], len(data))
        sampler = EndlessBatches(len(data), batch, seed=0)
        loader = torch.utils.data.DataLoader(data, batch_sampler=sampler, num_workers=workers, collate_fn=collate)
        iterator = iter(loader)
        return lambda: len(next(iterator)["index"])

    rng = np.random.default_rng(0)
    ways = {
        "random textures /s": lambda: len(data.textures(rng.integers(len(data)))),
        "batches /s": batches(0),
        "batches, 2 workers /s": batches(2),
    }
    if data.sampling_rate == extractor.sampling_rate:
        ways["batches with features /s"] = batches(0, features)
    return {name: speed(work) for name, work in ways.items()}


def _training_steps(data, pipe):
    """Functions that each do one update of a model, as the training scripts do, and return the size of its batch."""
    extractor = pipe.feature_extractor
    rows = [i % len(data) for i in range(BATCH["LCTG"])]
    waveform, _ = extractor.normalize(torch.from_numpy(data.textures(rows)), data.sampling_rate)
    features = torch.from_numpy(extractor.features(waveform))
    shape = BATCH["LCTG"], 1, pipe.lctg.config.segment_samples
    steps = {"LCTG": _update(pipe.lctg, shape, lambda: pipe.lctg.encode(features))}
    if pipe.dale is not None:
        shape = BATCH["DALE"], pipe.dale.config.in_channels, pipe.dale.config.latent_frames
        ratings = torch.zeros(BATCH["DALE"], 3)
        steps["DALE"] = _update(pipe.dale, shape, lambda: ratings)
    return steps


def _update(model, shape, condition):
    """Forward, backward and AdamW on noise of `shape`, under what `condition` returns."""
    optimizer = torch.optim.AdamW(model.train().requires_grad_(True).parameters(), lr=1e-5)
    timesteps = torch.linspace(0, 999, shape[0])

    def step():
        velocity = model(torch.randn(shape), timesteps, condition(), return_dict=False)[0]
        velocity.square().mean().backward()
        optimizer.step()
        optimizer.zero_grad()
        return shape[0]

    return step


def markdown(report):
    """The report's tables."""
    about = (
        f"{report['machine']}. Preparation: one process. Loading: random order, batches of {BATCH['LCTG']}; features "
        "as in examples/train_lctg.py. Training: updates of the pipeline's models."
    )
    parts = ["### Data", about, "#### Preparation", markdown_table({"": report["preparation"]}, 1)]
    parts += ["#### Loading", markdown_table(report["loading"], 1)]
    parts += ["#### Loading against training", markdown_table(report["training"], 1)]
    return "\n\n".join(parts) + "\n"


if __name__ == "__main__":
    sys.exit(main())

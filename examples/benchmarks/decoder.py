"""What do few steps of LCTG cost in accuracy, distilled or not?

`python examples/benchmarks/decoder.py --data prepared.h5 --output report`
"""

import sys
from pathlib import Path

import numpy as np
import torch
from benchmarking import finish, machine, make_parser, parse
from tqdm.auto import tqdm

from tactile_diffusers.cli.program import existing_file, load_pipeline, refuse
from tactile_diffusers.data import PreparedDataset
from tactile_diffusers.data.dataset import check_fit
from tactile_diffusers.evaluation.metrics.distances import Reference
from tactile_diffusers.pipelines import TactileTexturePipeline
from tactile_diffusers.signal import nine_band_error_db, resample

sys.path.append(str(Path(__file__).parents[1]))  # examples, for `report`

from report.tables import markdown_table, title

#: Steps of the checkpoint's own LCTG.
STEPS = (1, 2, 3, 5, 10)
BATCH = 32


def main(argv=None):
    """Measures and writes decoder.json and decoder.md."""
    parser = make_parser("decoder.py", "Accuracy of few steps of LCTG, by its own decoder and by the distilled one.")
    add = parser.add_argument
    add("--data", type=existing_file, required=True, metavar="PREPARED.h5", help="from examples/prepare_data.py")
    arguments = parse(parser, argv)
    pipe = load_pipeline(arguments.checkpoint)
    train, held_out = (PreparedDataset(arguments.data, split) for split in ("train", "test"))
    held_out.set_axes(pipe.dale.config.rating_axes)
    try:
        check_fit(pipe, held_out)
    except ValueError as error:
        return refuse("decoder.py", error)
    chosen = train.non_overlapping(1, arguments.seed)
    reference = Reference(train.textures(chosen), train.sampling_rate, train.surface_ids[chosen])
    given = _Given(pipe, held_out, reference, arguments.seed)
    teacher, rows = TactileTexturePipeline.from_pipe(pipe, lctg_distilled=None), {}
    decoders = {"as trained": (teacher, STEPS)}
    if pipe.lctg_distilled is not None:
        decoders["distilled"] = pipe, range(1, pipe.lctg_distilled.config.distilled_steps + 1)
    for name, (one, counts) in decoders.items():
        for steps in tqdm(counts, disable=arguments.quiet, desc=name):
            rows[f"{name}, {steps} step{'s' * (steps > 1)}"] = given.measure(one, steps, arguments.seed)
    text = (
        f"{title('Few steps', 4)}{len(given.real)} segments of {len(set(given.surfaces))} test surfaces of "
        f"`{arguments.data.name}`, one each. Reconstructed: with the detail layer; "
        "from the base layer: decoded from what DALE would generate alone; generated: from ratings, DALE in its "
        f"default steps.\n\n{markdown_table(rows, 2)}\n"
    )
    return finish(arguments, "decoder", {"machine": machine(), "rows": rows}, text)


class _Given:
    """Latents of held-out segments and of textures generated from their ratings, and the yardsticks."""

    def __init__(self, pipe, held_out, reference, seed):
        rows = held_out.non_overlapping(1, seed)
        self.reference, self.surfaces, self.rate = reference, held_out.surface_ids[rows], held_out.sampling_rate
        self.real = held_out.textures(rows)
        self.floor = reference.distances(reference.embed(self.real), self.surfaces)["ktd"]["mean"]
        encoded = pipe.encode(self.real, self.rate)
        base = pipe.lctg.pad_detail(encoded.latents[:, : pipe.lctg.base_channels])
        ratings, made = held_out.ratings.mean[self.surfaces], []
        for start in range(0, len(ratings), BATCH):
            generator = torch.Generator().manual_seed(seed + start)
            made.append(pipe(ratings[start : start + BATCH], generator=generator, output_type="latent"))
        self.latents = {
            "reconstructed": (encoded.latents, encoded.level),
            "from the base layer": (base, encoded.level),
            "generated": (torch.cat([one.latents for one in made]), torch.cat([one.level for one in made])),
        }

    def measure(self, pipe, steps, seed):
        """Nine-band error, dB, and KTD over that of real segments, of each kind of texture."""
        row = {}
        for name, (latents, level) in self.latents.items():
            parts = []
            for start in range(0, len(latents), BATCH):
                generator = torch.Generator().manual_seed(seed + start)
                batch = slice(start, start + BATCH)
                parts.append(pipe.decode(latents[batch], level[batch], None, steps, generator))
            textures = resample(np.concatenate([part.textures for part in parts]), parts[0].sampling_rate, self.rate)
            textures = textures[:, : self.real.shape[-1]]
            if name != "generated":
                row[f"{name}: nine-band error, dB"] = float(nine_band_error_db(textures, self.real, self.rate).mean())
            distance = self.reference.distances(self.reference.embed(textures), self.surfaces)["ktd"]["mean"]
            row[f"{name}: KTD over real"] = distance - self.floor
        return row


if __name__ == "__main__":
    sys.exit(main())

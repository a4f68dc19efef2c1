"""`benchmark.py --suite decoder`: what few steps of LCTG cost in accuracy, distilled or not."""

import numpy as np
import torch
from tqdm.auto import tqdm

from tactile_diffusers.checkpoints import DISTILLED
from tactile_diffusers.data import PreparedDataset
from tactile_diffusers.evaluation.held_out import check_fit
from tactile_diffusers.evaluation.metrics.reference import Reference
from tactile_diffusers.evaluation.result_files import machine, write_results
from tactile_diffusers.evaluation.tables import markdown_table, title
from tactile_diffusers.models.lctg import LCTGModel, same_encoder
from tactile_diffusers.pipelines import TactileTexturePipeline
from tactile_diffusers.schedulers import VDDIMScheduler
from tactile_diffusers.signal import nine_band_error_db, resample

#: Steps of the checkpoint's own LCTG.
STEPS = (1, 2, 3, 5, 10)
BATCH = 32


def run(arguments, pipe):
    """Measures, writes decoder.json and decoder.md, and returns the Markdown.

    Args:
        arguments (`argparse.Namespace`): "output" (`Path`, a folder), "data" (`Path`, prepared), "decoders"
            (`list[str]` of NAME=FOLDER, output folders of `distill_lctg.py`), "seed", "quiet".
        pipe (`TactileTexturePipeline`): with a DALE.

    Returns:
        `str`

    Raises:
        ValueError: if a decoder does not belong to the checkpoint.
    """
    train, held_out = (PreparedDataset(arguments.data, split) for split in ("train", "test"))
    check_fit(pipe, held_out)
    decoders = {"as trained": (pipe, STEPS), **_distilled(arguments, pipe)}
    chosen = train.non_overlapping(1, arguments.seed)
    reference = Reference(train.textures(chosen), train.sampling_rate, train.surface_ids[chosen])
    given = _Given(pipe, held_out, reference, arguments.seed)
    rows = {}
    for name, (one, counts) in decoders.items():
        for steps in tqdm(counts, disable=arguments.quiet, desc=name):
            rows[f"{name}, {steps} step{'s' * (steps > 1)}"] = given.measure(one, steps, arguments.seed)
    text = (
        f"{title('Few steps', 4)}{len(given.real)} segments of {len(set(given.surfaces))} test surfaces of "
        f"`{arguments.data.name}`, one each; KTD over that of real segments. Reconstructed: with the detail layer; "
        "from the base layer: told of a recording only what DALE would make; generated: from ratings, DALE in its "
        f"default steps.\n\n{markdown_table(rows, 2)}\n"
    )
    write_results(arguments.output, "decoder", {"machine": machine(), "rows": rows}, text)
    return text


def _distilled(arguments, pipe):
    """Pipelines with the decoders that were asked for, or with the checkpoint's own: name -> (pipeline, steps)."""
    folders = dict(word.split("=", 1) for word in arguments.decoders)
    made = {}
    for name, folder in (folders or {"distilled": arguments.checkpoint}).items():
        lctg = LCTGModel.from_pretrained(folder, subfolder=DISTILLED)
        if not same_encoder(lctg, pipe.lctg):
            raise ValueError(f"--decoders {name}={folder}: its encoder is not the checkpoint's; it fits another one.")
        own = {"scheduler": VDDIMScheduler.from_pretrained(folder, subfolder="scheduler")} if folders else {}
        made[name] = TactileTexturePipeline.from_pipe(pipe, lctg=lctg, **own), range(1, lctg.config.distilled_steps + 1)
    return made


class _Given:
    """Latents of held-out segments and of textures generated from their ratings, and the yardsticks."""

    def __init__(self, pipe, held_out, reference, seed):
        rows = held_out.non_overlapping(1, seed)
        self.reference, self.surfaces, self.rate = reference, held_out.surface_ids[rows], held_out.sampling_rate
        self.real = held_out.textures(rows)
        self.floor = reference.distances(reference.embed(self.real), self.surfaces)["ktd"]["mean"]
        encoded = pipe.encode(self.real, self.rate)
        base = pipe.lctg.pad_detail(encoded.latents[:, : pipe.lctg.base_channels])
        ratings, made = held_out.surface_ratings[self.surfaces], []
        for start in range(0, len(ratings), BATCH):
            generator = torch.Generator().manual_seed(seed + start)
            made.append(pipe(ratings[start : start + BATCH], generator=generator, output_type="latent"))
        self.latents = {
            "reconstructed": (encoded.latents, encoded.level),
            "from the base layer": (base, encoded.level),
            "generated": (torch.cat([one.latents for one in made]), torch.cat([one.level for one in made])),
        }

    def measure(self, pipe, steps, seed):
        """Nine-band error, dB, and KTD of each kind of texture."""
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
            row[f"{name}: KTD"] = distance - self.floor
        return row

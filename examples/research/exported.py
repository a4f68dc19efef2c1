#!/usr/bin/env python
"""Exports a pipeline's networks for programs without Python, and says how far they are from the original.

    python examples/research/exported.py --output exported
    python examples/research/exported.py --output exported --compile      # AOTInductor; needs a C++ compiler

`dale.pt2` takes a state (batch, channels, frames), times (batch,) and ratings (batch, axes); `lctg.pt2` a sample
(batch, 1, samples), times and latents (batch, channels, frames). Each gives the velocity. Batch and frames are free;
frames are a multiple of what a U-Net halves, twice that at least: pad with zeros, as the models do, and cut. Compiled
packages load in C++ by `torch::inductor::AOTIModelPackageLoader`.
"""

import argparse
import json
import time
from pathlib import Path

import torch
from torch.export import Dim, export, save

from tactile_diffusers import TactileTexturePipeline, bundled_checkpoint

#: Where an exported network is compared: batch, and frames in multiples of what the U-Net halves.
SHAPES = ((1, 2), (2, 4), (5, 13))
REPEATS = 20


class Velocity(torch.nn.Module):
    """A model as tensors in, tensor out."""

    def __init__(self, model):
        super().__init__()
        self.model = model.eval()

    def forward(self, sample, timestep, condition):
        """Velocity, of the shape of the sample."""
        return self.model(sample, timestep, condition, return_dict=False)[0]


def inputs_of(model, batch, frames):
    """Random inputs of a model, at the first step."""
    config, times = model.config, torch.full((batch,), float(model.config.num_train_timesteps - 1))
    if hasattr(config, "rating_axes"):
        return torch.randn(batch, config.in_channels, frames), times, torch.randn(batch, len(config.rating_axes))
    return torch.randn(batch, 1, frames * config.latent_hop), times, torch.randn(batch, config.latent_channels, frames)


def least_frames(model):
    """Frames to a multiple of which the model pads."""
    if hasattr(model.config, "rating_axes"):
        return model.config.patch_size * model.unet.stride
    return max(1, model.decoder.stride // model.config.latent_hop)


def exported(model):
    """The `ExportedProgram` of a model's velocity, of any batch and number of frames."""
    step, batch, count = least_frames(model), Dim("batch", min=1), Dim("count", min=2)
    frames = step * count
    if hasattr(model.config, "rating_axes"):
        dynamic = {0: batch, 2: frames}, {0: batch}, {0: batch}
    else:
        dynamic = {0: batch, 2: model.config.latent_hop * step * count}, {0: batch}, {0: batch, 2: frames}
    return export(Velocity(model), inputs_of(model, 3, 4 * step), dynamic_shapes=dynamic)


@torch.no_grad()
def largest_difference(model, network):
    """Of the velocities at all `SHAPES`, over the RMS of the original's."""
    found = []
    for batch, count in SHAPES:
        inputs = inputs_of(model, batch, count * least_frames(model))
        wanted = Velocity(model)(*inputs)
        found.append(float((network(*inputs) - wanted).abs().max() / wanted.square().mean().sqrt()))
    return max(found)


@torch.no_grad()
def times_as_fast(model, network):
    """How many times as fast one texture goes through, least of some in turn."""
    inputs = inputs_of(model, 1, 4 * least_frames(model))
    least = {}
    for _ in range(REPEATS):
        for name, run in (("model", Velocity(model)), ("network", network)):
            start = time.perf_counter()
            run(*inputs)
            least[name] = min(least.get(name, float("inf")), time.perf_counter() - start)
    return least["model"] / least["network"]


def main(argv=None):
    """Writes the packages and `exported.json`."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--checkpoint", default=bundled_checkpoint(), help="pipeline folder; default: the bundled one")
    parser.add_argument("--compile", action="store_true", help="compile the packages with AOTInductor")
    parser.add_argument("--output", type=Path, required=True, help="folder")
    args = parser.parse_args(argv)
    pipe, found = TactileTexturePipeline.from_pretrained(args.checkpoint), {}
    args.output.mkdir(parents=True, exist_ok=True)
    for name, model in (("dale", pipe.dale), ("lctg", pipe.lctg_distilled or pipe.lctg)):
        program, path = exported(model), args.output / f"{name}.pt2"
        if args.compile:
            torch._inductor.aoti_compile_and_package(program, package_path=str(path))
            network = torch._inductor.aoti_load_package(str(path))
        else:
            save(program, path)
            network = torch.export.load(path).module()
        found[name] = {"difference": largest_difference(model, network), "times": times_as_fast(model, network)}
        print(f"{path}: {found[name]['difference']:.1e} of the RMS off, {found[name]['times']:.2f} times as fast")
    (args.output / "exported.json").write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()

"""Does a change of the code change the textures? Run a fixed set of calls before and after, and compare bit for bit.

    python examples/research/fixed_calls.py before          # on the old code
    python examples/research/fixed_calls.py after --compare before

The calls cover generation (ratings, seeds, lengths, guidance, takes), reconstruction, the way
back to ratings, streams, scenes and the bytes of each export format, all of the bundled checkpoint. Results are equal
bit for bit on one machine only: processors and thread counts round differently.
"""

import argparse
import re
import sys
import warnings
from pathlib import Path

import numpy as np
import torch

from tactile_diffusers import TactileTexturePipeline, bundled_checkpoint
from tactile_diffusers.export import FORMATS
from tactile_diffusers.playback import EndlessProfile, EndlessStream, TextureProfile, TextureScene, TextureStream

CALLS = {
    "one": {"ratings": [[1.5, 0.0, -1.0]]},
    "open_axes": {"ratings": [[1.5, 0.0, -1.0], [None, 1.2, None]]},
    "by_name": {"ratings": {"slipperiness": 0.7}},
    "takes": {"ratings": [[0.5, -1.0, 0.3]], "num_textures_per_rating": 3},
    "short": {"ratings": [[0.0, 0.0, 0.0]], "duration_s": 0.3},
    "long": {"ratings": [[0.8, 1.0, 0.2]], "duration_s": 5.2},
    "steps": {"ratings": [[0.8, 1.0, 0.2]], "num_inference_steps": 10, "num_latent_inference_steps": 2},
    "guidance": {"ratings": [[0.8, 1.0, 0.2]], "guidance_scale": 1.5},
    "guidance_by_axis": {"ratings": [[0.8, 1.0, 0.2]], "guidance_scale": {"bumpiness": 1.4}, "guidance_rescale": 0.5},
    "raw": {"ratings": [[6.0, 3.0, 2.0]], "rating_scale": "raw"},
    "percentile": {"ratings": [[80.0, 30.0, None]], "rating_scale": "percentile"},
}
SEED = 7


def generator(seed=SEED):
    return torch.Generator("cpu").manual_seed(seed)


def textures_of(pipe):
    """Arrays by name: every call of `CALLS`, and one whose rows have generators of their own."""
    found = {}
    for name, call in CALLS.items():
        out = pipe(**call, generator=generator())
        found[name] = out.textures
        found[f"{name}/scalars"] = np.stack([out.friction_coefficient, out.level])
    out = pipe([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], generator=[generator(1), generator(2)])
    found["generators"] = out.textures
    latents = pipe([[1.0, 0.0, 0.0]], output_type="latent", generator=generator())
    found["latents"] = latents.latents.float().cpu().numpy()
    return found


def recording_calls(pipe, texture, rate):
    """Encoding, reconstruction, decoding and estimated ratings of a texture."""
    z = pipe.encode(texture, rate)
    found = {"encode": z.latents.numpy(), "encode/level": z.level.numpy()}
    found["decode"] = pipe.decode(z.latents, z.level, generator=generator()).textures
    found["reconstruct"] = pipe.reconstruct(texture, rate, generator=generator()).textures
    found["estimate"] = np.asarray(pipe.estimate_ratings(texture, rate, np.full(len(texture), 0.6)))
    return found


def playback_calls(pipe, out):
    """A stream, an endless stream and a scene under a finger that goes back and forth."""
    profile = TextureProfile(out.textures[0], out.sampling_rate, out.reference_speed)
    stream = TextureStream(profile, out.friction_coefficient[0], sensor_rate=125)
    found = {"stream": _played(stream)}
    with EndlessStream(EndlessProfile(pipe, [1.5, 0.0, -1.0], seed=0), sensor_rate=125) as endless:
        found["endless/first"] = endless.read(80)
    scene = TextureScene({"a": [1.0, 0.5, -1.0], "b": {"roughness": -1.0}}, pipe, seed=3)
    stream = TextureStream(scene.profile("a"), scene.friction_coefficient("a"), sensor_rate=125)
    found["scene"] = _played(stream)
    return found


def _played(stream):
    blocks = []
    for number in range(60):
        stream.report(number / 125, 40 * np.sin(np.pi * number / 125))
        blocks.append(stream.read(80, normal_force=0.5))
    return np.concatenate(blocks)


def write_formats(out, folder):
    """One texture in every format."""
    about = {"sampling_rate": out.sampling_rate, "reference_speed": out.reference_speed, "seed": SEED}
    about |= {"friction_coefficient": float(out.friction_coefficient[0]), "ratings": [1.5, 0.0, -1.0]}
    for name, form in FORMATS.items():
        form.write(folder / f"{name}{form.suffix}", out.textures[0], checkpoint="bundled", **about)


def compare(folder, other):
    """Prints what differs from an earlier run; returns the number of differences."""
    now, then = (np.load(place / "arrays.npz") for place in (folder, other))
    different = sorted(set(now.files) ^ set(then.files))
    for name in sorted(set(now.files) & set(then.files)):
        if now[name].shape != then[name].shape:
            different.append(f"{name}: shapes {then[name].shape} and {now[name].shape}")
        elif not np.array_equal(now[name], then[name], equal_nan=True):
            rms = np.sqrt(np.mean(np.square(then[name]), dtype=np.float64))
            different.append(f"{name}: by up to {np.abs(now[name] - then[name]).max() / rms:.3g} of the RMS")
    names = {path.name for place in (folder, other) for path in place.iterdir()} - {"arrays.npz"}
    for name in sorted(names):
        paths = folder / name, other / name
        if not all(path.is_file() for path in paths) or _content(paths[0]) != _content(paths[1]):
            different.append(f"{name}: other bytes")
    print("\n".join(different) or f"{len(now.files)} arrays and {len(names)} files are the same, bit for bit")
    return len(different)


def _content(path):
    """Bytes of a file without the time at which it was written."""
    content = path.read_bytes()
    if path.suffix == ".hjif":
        return re.sub(rb'"date": ?"[^"]*"', b"", content)
    if path.name == "wav.wav" and (place := content.find(b"PEAK")) >= 0:  # id, size, version, then the time
        return content[: place + 12] + content[place + 16 :]
    return content


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="where the results of the calls go")
    parser.add_argument("--compare", type=Path, metavar="FOLDER", help="earlier run; exit code 1 if anything differs")
    arguments = parser.parse_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    warnings.simplefilter("ignore")
    pipe = TactileTexturePipeline.from_pretrained(bundled_checkpoint())
    pipe.set_progress_bar_config(disable=True)
    out = pipe(**CALLS["one"], generator=generator())
    found = textures_of(pipe) | recording_calls(pipe, out.textures, out.sampling_rate) | playback_calls(pipe, out)
    np.savez(arguments.folder / "arrays.npz", **found)
    write_formats(out, arguments.folder)
    return int(bool(arguments.compare and compare(arguments.folder, arguments.compare)))


if __name__ == "__main__":
    sys.exit(main())

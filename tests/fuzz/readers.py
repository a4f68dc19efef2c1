"""What is fuzzed: every reader of a file, good files to begin from, and what a reader may do with a bad one.

A reader may refuse with a ValueError that names the file, or a FileNotFoundError for one that is named inside; what it
gives otherwise must be what it documents. Formats with checksums are fuzzed behind them too (`pack`): a mutated byte
would never come past the check. tests/faults damages recordings and prepared
data: libFuzzer finds inputs that keep the HDF5 library busy for ever.
"""

import io
import json
import struct
import textwrap
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import soundfile

from tactile_diffusers.data.folder import load_layout, read_recording
from tactile_diffusers.data.folder.tables import list_tables
from tactile_diffusers.display import DriveProfile
from tactile_diffusers.export import FORMATS, DeviceProfile
from tactile_diffusers.playback import TextureScene

TINY_PIPELINE = Path(__file__).parents[1] / "fixtures" / "tiny_pipeline"
COMMON = {
    "sampling_rate": 10_000,
    "friction_coefficient": 0.6,
    "reference_speed": 80.0,
    "ratings": [1.5, float("nan"), -1.0],
    "seed": 7,
    "checkpoint": "tiny",
}


@dataclass(frozen=True)
class Target:
    """One reader and how to feed it.

    Attributes:
        suffix (`str`): of the files.
        read (`Callable`): `read(path)`.
        seeds (`Callable`): good inputs, a list of `bytes`.
        pack (`Callable`): an input as the bytes of a file.
        structured (`bool`): whether inputs are JSON, to be mutated as such.
    """

    suffix: str
    read: Callable
    seeds: Callable
    pack: Callable = bytes
    structured: bool = False


def fault(target, data, folder):
    """The exception by which a reader breaks its promise, or `None`."""
    path = Path(folder) / f"a{target.suffix}"
    path.write_bytes(target.pack(data))
    try:
        target.read(path)
    except FileNotFoundError:
        return None
    except ValueError as error:
        if path.stem not in str(error) and path.parent.name not in str(error):
            return error  # nobody knows which file is meant
    except Exception as error:
        return error
    return None


def _texture(samples=300):
    time = np.arange(samples) / COMMON["sampling_rate"]
    return 0.01 * np.sin(2 * np.pi * 150 * time) + 0.003 * np.cos(2 * np.pi * 640 * time)


@cache
def _written(name, inner=None):
    """What a writer writes, or what `inner` makes of its path."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"a{FORMATS[name].suffix}"
        options = {"height": 2, "pixel_pitch": 0.03} if name == "png" else {}
        FORMATS[name].write(path, _texture(), **COMMON, **options)
        return path.read_bytes() if inner is None else inner(path)


def _read_texture(name, path):
    texture, metadata = FORMATS[name].read(path)
    assert isinstance(texture, np.ndarray) and texture.ndim == 1 and texture.dtype == np.float32, texture
    rate, ratings = metadata["sampling_rate"], metadata["ratings"]
    assert isinstance(rate, int) and rate > 0, metadata
    assert len(ratings) == 3 and all(isinstance(value, float) for value in ratings), metadata


def _format(name, structured=False):
    return Target(FORMATS[name].suffix, partial(_read_texture, name), lambda: [_written(name)], structured=structured)


def _sidecar_bytes(path):
    return Path(f"{path}.json").read_bytes()


def _read_wav(path):
    Path(f"{path}.json").write_bytes(_written("wav16", _sidecar_bytes))
    _read_texture("wav", path)


def _read_sidecar(path):
    wav = path.with_suffix("")
    wav.write_bytes(_written("wav16"))
    _read_texture("wav", wav)


def _npz_member(data):
    """An archive in which one member, told by the first byte, is replaced by the rest."""
    with zipfile.ZipFile(io.BytesIO(_written("npz"))) as old:
        members = {name: old.read(name) for name in old.namelist()}
    names = sorted(members)
    members[names[data[0] % len(names)] if data else names[0]] = data[1:]
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w") as new:
        for name, content in members.items():
            new.writestr(name, content)
    return made.getvalue()


def _npz_members():
    with zipfile.ZipFile(io.BytesIO(_written("npz"))) as file:
        return [bytes([number]) + file.read(name) for number, name in enumerate(sorted(file.namelist()))]


def _png_chunk(path):
    from PIL import Image

    with Image.open(path) as picture:
        return picture.info["tactile_diffusers"].encode()


def _png_of(data):
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    chunks, made = PngInfo(), io.BytesIO()
    chunks.add_text("tactile_diffusers", data.decode("latin-1").replace("\0", " "))
    with Image.open(io.BytesIO(_written("png"))) as picture:
        picture.save(made, format="PNG", pnginfo=chunks)
    return made.getvalue()


@cache
def _pipe():
    from tactile_diffusers import TactileTexturePipeline

    return TactileTexturePipeline.from_pretrained(TINY_PIPELINE)


@cache
def _scene():
    with TemporaryDirectory() as folder:
        path = Path(folder) / "a.safetensors"
        TextureScene({"a": [1, 0, 0], "b": None}, _pipe(), {"a": (0, 0, 5, 5)}).save(path)
        return path.read_bytes()


def _read_scene(path):
    scene = TextureScene.load(path, _pipe())
    scene.friction_coefficient(scene.names[0])


def _scene_parts():
    data = _scene()
    size = struct.unpack("<Q", data[:8])[0]
    return json.loads(data[8 : 8 + size]), data[8 + size :]


def _scene_with(data):
    """The good scene with another description of its surfaces in its header."""
    header, tensors = _scene_parts()
    header["__metadata__"]["scene"] = data.decode("latin-1")
    text = json.dumps(header).encode()
    return struct.pack("<Q", len(text)) + text + tensors


CSV = [
    b"t,Fx,Fy\n0.0,1,2\n0.1,1.5,2e-3\n0.2,,nan\n",
    b"\xef\xbb\xbft;Fx\n0,0;1,25\n0,1;1,5\n",
    b"# made by x\n1\t2\n3\t4\n5\t6\n",
    b'"a ""b""", c\n1, 2\n3, x\n',
    "µ Kraft\n1\n2\n".encode("utf-16"),
]


def _read_tables(path):
    for table in list_tables(path):
        for name in table.names:
            table.text(name)
            assert table.numbers(name).dtype == np.float64


def _recordings():
    """Tables of 0.3 s that `edit`, `reconstruct` and the demo read: with stamps, and with decimal commas."""
    rows = [(n / 5000, 300 + 20 * np.sin(n)) for n in range(1500)]
    plain = "t_s,Fx_mN,note\n" + "\n".join(f"{t:.4f},{x:.3f},a" for t, x in rows)
    comma = "# rig 2\nZeit (ms);Kraft (N)\n" + "\n".join(f"{1e3 * t:.1f};{x / 1e3:.5f}" for t, x in rows)
    return [plain.encode(), comma.replace(".", ",").encode()]


def _wav(samples):
    made = io.BytesIO()
    soundfile.write(made, _texture(samples), COMMON["sampling_rate"], subtype="PCM_16", format="WAV")
    return made.getvalue()


def _read_recording(path):
    force, rate, notes = read_recording(path)
    assert force.ndim == 1 and np.isfinite(force).all() and rate >= 2500 and all(isinstance(n, str) for n in notes)


LATERAL_LAYOUT = b"""format = "tactile-layout"
version = 1
source = "s"
licence = "CC0"
[[files]]
pattern = "{surface}.h5"
inside = "{explorer}/{trial}"
rate = 1000
lateral = { column = 0, unit = "1", scale = 2.5 }
velocity = { x = "vx", unit = "m/s" }
[ratings]
pattern = "{axis}.csv"
form = "wide"
rows = "rater"
columns = "surface"
scale = [0, 100]
[ratings.axes]
roughness = { column = "r", high = "rough" }
"""


def _layouts():
    from tactile_diffusers.data.folder import layout

    example = layout.__doc__.split("\n\n", 1)[1].split("\n\nThe classes below")[0]
    return [LATERAL_LAYOUT, textwrap.dedent(example).encode()]


PROFILE = {
    "format": "tactile-drive-profile",
    "version": 1,
    "units": {"force": "N", "speed": "mm/s", "frequency": "Hz", "drive": "V"},
    "kind": "electroadhesion",
    "gain": 6e-6,
    "offset": 0.3,
    "cutoffs": [[80.0, 300.0]],
    "max_drive": 180.0,
    "normal_force": 0.5,
    "lookup": None,
    "max_gain_db": 12.0,
}

TARGETS = {
    "npz": _format("npz"),
    "npz-members": Target(".npz", partial(_read_texture, "npz"), _npz_members, _npz_member),
    "hdf5": _format("hdf5"),
    "wav": Target(".wav", _read_wav, lambda: [_written("wav"), _written("wav16")]),
    "wav-sidecar": Target(".wav.json", _read_sidecar, lambda: [_written("wav16", _sidecar_bytes)], structured=True),
    "png": _format("png"),
    "png-text": Target(
        ".friction.png", partial(_read_texture, "png"), lambda: [_written("png", _png_chunk)], _png_of, structured=True
    ),
    "hjif": _format("hjif", structured=True),
    "hjif-friction": _format("hjif-friction", structured=True),
    "haptic": _format("haptic", structured=True),
    "ahap": _format("ahap", structured=True),
    "scene": Target(".safetensors", _read_scene, lambda: [_scene()]),
    "scene-json": Target(
        ".safetensors",
        _read_scene,
        lambda: [_scene_parts()[0]["__metadata__"]["scene"].encode()],
        _scene_with,
        structured=True,
    ),
    "tables-hdf5": Target(".h5", _read_tables, lambda: [_written("hdf5")]),
    "tables": Target(".csv", _read_tables, lambda: CSV),
    "recording": Target(".csv", _read_recording, _recordings),
    "recording-wav": Target(".wav", _read_recording, lambda: [_wav(3000)]),
    "device": Target(
        ".json", DeviceProfile.load, lambda: [b'{"rate": 1000, "band": [40, 400], "bits": 12}'], structured=True
    ),
    "layout": Target(".toml", load_layout, _layouts),
    "drive": Target(".json", DriveProfile.load, lambda: [json.dumps(PROFILE).encode()], structured=True),
}

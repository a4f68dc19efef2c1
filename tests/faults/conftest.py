"""Damage to files, and what every reader owes the caller of a damaged one.

A reader refuses with a ValueError (an OSError where a file is missing) that names the file, within two seconds, or
gives the whole. Formats without a checksum cannot tell that a sample was changed: after a flipped bit the demand is a
refusal, or a result of finite numbers. Formats without a length (text tables) cannot tell that their end is missing:
`whole=False` then asks of a truncated file what is asked of a flipped one.
"""

import random
import shutil
import time
import warnings

import numpy as np
import pytest

#: What a refusal may be, and no subclass: UnicodeDecodeError is a ValueError that names no file.
REFUSALS = (ValueError, OSError, FileNotFoundError)
SECONDS = 2.0
#: Flipped bits of each file, by default and in slow runs.
FLIPS, MORE_FLIPS = 12, 300
#: What stands in the place of a value, by default and in slow runs.
ODD = ("missing", 10**9, "word")
MORE_ODD = (*ODD, None, -1, 0, 1e300, [], {}, True, 10**15, [[]], [10**9] * 3, [None])


def _numbers(result):
    """All arrays of numbers in a result, however nested."""
    if isinstance(result, np.ndarray):
        return [result] if result.dtype.kind in "fiub" else []
    if isinstance(result, dict):
        result = list(result.values())
    if isinstance(result, list | tuple):
        return [array for part in result for array in _numbers(part)]
    return [np.asarray(result)] if isinstance(result, int | float) else []


def _same(one, other):
    one, other = _numbers(one), _numbers(other)
    return len(one) == len(other) and all(
        a.shape == b.shape and np.array_equal(a.astype(float), b.astype(float), equal_nan=True)
        for a, b in zip(one, other, strict=True)
    )


def _refusal(read, path):
    """(result, None), or (None, the message of a proper refusal); anything else fails the test."""
    start = time.process_time()  # not the clock's: other processes may keep the machine busy
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a damaged header may say anything
            result = read(path)
        message = None
    except Exception as error:
        assert type(error) in REFUSALS, f"{type(error).__name__} instead of a refusal: {error}"
        result, message = None, str(error)
        absent = type(error) is FileNotFoundError and str(path.parent) in message  # a folder without any such file
        # a pair of files may be named by either (texture.wav, texture.wav.json), a component by its folder
        rest = message.replace(str(path.parent), "")
        named = absent or path.name.split(".")[0] in rest or path.parent.name in rest
        assert named, f"the message does not name {path.name}: {message}"
        assert len(message) > len(str(path)) + 10, f"the message says nothing: {message}"
    seconds = time.process_time() - start
    assert seconds < SECONDS, f"took {seconds:.1f} s"
    return result, message


class Damager:
    """Damages copies of a good file; `read` takes the path of the copy. What lies below `root` is copied along."""

    def __init__(self, good, read, folder, sane=None, whole=True, root=None):
        self.good, self.read, self.folder, self.whole = good, read, folder, whole
        self.root = root or good.parent
        self.sane = sane or (lambda result: all(np.isfinite(array).all() for array in _numbers(result)))
        self.content = good.read_bytes()
        self.path = folder / good.relative_to(self.root)
        self.expected = self.read(self.fresh())

    def fresh(self):
        """The copy, as good as new."""
        shutil.rmtree(self.folder, ignore_errors=True)
        shutil.copytree(self.root, self.folder)
        return self.path

    def put(self, content):
        """Writes the copy anew: another inode, so that nothing that a reader maps or remembers is of the old one."""
        self.path.unlink()
        self.path.write_bytes(content)
        return self.path

    def truncate(self):
        """Cut at every tenth of the length, and of the last byte."""
        size = len(self.content)
        for length in [*(size * tenth // 10 for tenth in range(10)), size - 1]:
            result, message = _refusal(self.read, self.put(self.content[:length]))
            if message is None:
                fits = _same(result, self.expected) if self.whole else self.sane(result)
                assert fits, f"cut to {length} of {size} bytes, it passes for whole"

    def flip(self, count):
        """Bits at seeded places, half of them in the first kilobyte, where headers are."""
        drawn = random.Random(self.good.name)
        for number in range(count):
            place = drawn.randrange(min(1024, len(self.content)) if number % 2 else len(self.content))
            changed = bytearray(self.content)
            changed[place] ^= 1 << drawn.randrange(8)
            result, message = _refusal(self.read, self.put(bytes(changed)))
            if message is None:
                assert self.sane(result), f"with a bit of byte {place} flipped, the result is not sane"

    def replace(self, others):
        """Absent, a folder, and each of `others`: contents that are of another kind."""
        for content in others:
            if content in (b"", self.content):
                continue
            _, message = _refusal(self.read, self.put(content))
            assert message is not None, f"{content[:20]!r}... is taken for a {self.good.name}"
        self.path.unlink()
        assert _refusal(self.read, self.path)[1]
        self.path.mkdir()
        assert _refusal(self.read, self.path)[1]

    def damage(self, flips, others):
        """All of it."""
        self.truncate()
        self.flip(flips)
        self.replace(others)

    def refuse(self, content, match=None):
        """The message in which `content` is refused."""
        _, message = _refusal(self.read, self.put(content))
        assert message is not None, f"not refused: {content[:60]!r}"
        assert match is None or match in message, message
        return message


PNG = bytes.fromhex(
    "89504e470d0a1a0a0000000d4948445200000001000000010800000000 3a7e9b55".replace(" ", "")
    + "0000000a49444154789c63680000008200811dda2bd20000000049454e44ae426082"
)
#: Contents that are none of our formats, or one of another kind.
FOREIGN = {
    "png": PNG,
    "text": b"This is no table: it is a letter.\n\nYours faithfully\n",
    "zeros": bytes(4096),
    "pickle": b"\x80\x04\x95\x17\x00\x00\x00\x00\x00\x00\x00\x8c\x05posix\x8c\x06system\x93\x8c\x04true\x85R.",
    "binary": random.Random(0).randbytes(4096),
    "json list": b"[]",
    "json number": b"1",
    "deep json": b"[" * 100_000 + b"]" * 100_000,
}


@pytest.fixture
def damaged(tmp_path):
    """Makes a `Damager` of a file: (path, read, sane=None, whole=True, root=None)."""
    return lambda good, read, **options: Damager(good, read, tmp_path / "a_copy", **options)


@pytest.fixture(params=[FLIPS, pytest.param(MORE_FLIPS, marks=pytest.mark.slow)])
def flips(request):
    return request.param


@pytest.fixture(params=[ODD, pytest.param(MORE_ODD, marks=pytest.mark.slow)], ids=["few", "many"])
def odd_values(request):
    return request.param


@pytest.fixture
def refusal():
    return _refusal


@pytest.fixture
def foreign():
    return dict(FOREIGN)


@pytest.fixture
def same():
    return _same

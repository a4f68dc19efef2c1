"""What a WAV file's header promises: libsndfile reads a file that was cut off as if it were whole."""

import io

#: Lengths of samples that programs write to a pipe, where they cannot come back to say the true one: ffmpeg; arecord;
#: sox.
UNKNOWN = (0xFFFFFFFF, 0x80000000, 0x7FFFFFFF, 0x7FFFF000)


def check_wav(file):
    """Raises a `ValueError` unless the samples that the header of a WAV file promises are all there.

    A length of `UNKNOWN`, which the length of the whole file confirms, promises nothing: the samples go on to the end.

    Args:
        file: binary, open for reading. What begins like no RIFF file (RF64, for example) is left to the reader.
    """
    size = file.seek(0, io.SEEK_END)
    file.seek(0)
    if file.read(4) != b"RIFF":
        return
    whole, place = int.from_bytes(file.read(4), "little"), 12
    while place + 8 <= size:
        file.seek(place)
        name, length = file.read(4), int.from_bytes(file.read(4), "little")
        if name == b"data":
            if length in UNKNOWN and whole in (0xFFFFFFFF, length + place) and size > place + 8:
                return
            if place + 8 + length > size:
                raise ValueError(
                    f"its header promises {length} bytes of samples, it holds {size - place - 8}: cut off?"
                )
            return
        place += 8 + length + length % 2  # chunks are padded to even lengths
    raise ValueError("it has no samples: cut off?")

"""Virtual surfaces, explored and rated, written to `recordings.h5`."""

from tqdm import tqdm

from ..data.recordings import RecordingsWriter
from ..io.files import clear_left_behind
from ..signal import DEVICE_RATE
from ..signal.checks import check_whole_number
from ..signal.constants import VIRTUAL_SOURCE
from .collection import Collection
from .exploration import VELOCITY_RATE
from .workers import run_in_order

LICENCE = "CC0-1.0"


def generate_recordings(
    path,
    surfaces,
    seconds,
    quiet=False,
    workers=1,
    **settings,
):
    """Writes recordings and ratings of virtual surfaces: about 2 ms for each second of recording.

    Args:
        path (`str` or `Path`): `recordings.h5` to write; it appears when it is complete.
        surfaces (`int`): number of surfaces.
        seconds (`float`): duration of a recording.
        quiet (`bool`): no progress bar.
        workers (`int`): processes that explore; 1 = this one. The result does not depend on it.
        **settings: further ones of `Collection`, such as `explorers` and `seed`.

    Raises:
        ValueError: if an argument is out of range.
        FileNotFoundError: if the folder of `path` does not exist.
        ChildProcessError: if a worker was killed.
    """
    collection = Collection(seconds, **settings)
    surfaces, workers = check_whole_number("surfaces", surfaces), check_whole_number("workers", workers)
    clear_left_behind(path)
    with RecordingsWriter(path, VIRTUAL_SOURCE, LICENCE, **collection.attributes) as writer:
        known = [collection.surface(index) for index in range(surfaces)]
        tasks = [(collection, index) for index in range(surfaces)]
        explored = run_in_order(explore, tasks, workers)
        bar = tqdm(explored, total=surfaces, desc=VIRTUAL_SOURCE, unit="surface", disable=quiet)
        for surface, recordings in zip(known, bar, strict=True):
            for number, (force, velocity) in enumerate(recordings):
                rates = {"force_rate": DEVICE_RATE, "velocity_rate": VELOCITY_RATE}
                writer.add_recording(surface.name, f"explorer-{number}", "0", force=force, velocity=velocity, **rates)
        raters = [f"rater-{number}" for number in range(collection.raters)]
        writer.set_ratings(
            collection.answers(known), raters, [surface.name for surface in known], collection.rating_axes
        )


def explore(collection, index):
    """Force and velocity of one surface, by all explorers of a collection: a list of pairs."""
    surface = collection.surface(index)
    return [surface.explore(number, collection.seconds) for number in range(collection.explorers)]

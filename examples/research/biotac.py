"""Reader of real sliding vibration: the BioTac slides of github.com/dexrob/BioTac_slide_20_50, as an HDF5 file.

For checks only: counts of a robot finger's vibration channel are no newtons, there is no normal force, the speed lies
outside the limits of segments, and no licence is stated.

    python examples/research/biotac.py biotac_slide.h5 recordings.h5 prepared.h5
"""

import argparse
from pathlib import Path

import numpy as np
from tqdm import tqdm

from tactile_diffusers.data import SegmentLimits, prepare_recordings
from tactile_diffusers.data.recordings import RecordingsWriter
from tactile_diffusers.io.files import clear_left_behind
from tactile_diffusers.io.hdf5 import open_whole

#: The first part of a slide holds the contact transient (README of the data).
CONTACT_SECONDS = 0.5
#: Rate of the nominal velocity that is written beside the counts, Hz.
NOMINAL_VELOCITY_RATE = 100
#: A strong component near 10 Hz is in every slide: high-pass at 30 Hz (README of the data).
BIOTAC_BAND_HZ = (30.0, 1000.0)
#: Unseen surfaces for testing.
BIOTAC_TEST_SURFACES = 3


def convert_biotac(root, output, quiet=False):
    """Converts the BioTac slides to `recordings.h5`: uncalibrated `lateral`, nominal `velocity`, one trial per slide.

    Args:
        root (`str` or `Path`): `biotac_slide.h5`, groups `matNN` with `pac` (slides, samples) int16.
        output (`str` or `Path`): the file to write.
        quiet (`bool`): no progress bar.

    Raises:
        FileNotFoundError: if there is no file.
        ValueError: if the file is not the one described.
    """
    with open_whole(root) as source:
        if "sampling_rate_hz" not in source.attrs or not all("pac" in group for group in source.values()):
            raise ValueError(f"{root} has no `sampling_rate_hz` or groups without `pac`: give biotac_slide.h5.")
        rate, speed = float(source.attrs["sampling_rate_hz"]), float(source.attrs["sliding_speed_mm_s"])
        origin = f"BioTac slides, {source.attrs['source']}"
        clear_left_behind(output)
        with RecordingsWriter(output, source=origin, licence=str(source.attrs["licence"])) as writer:
            for key, group in tqdm(source.items(), total=len(source), desc="slides", unit="surface", disable=quiet):
                name = f"{key}-{group.attrs['name']}".replace("/", "-")
                slides = group["pac"][:, int(round(CONTACT_SECONDS * rate)) :].astype(np.float32)
                steps = int(slides.shape[1] / rate * NOMINAL_VELOCITY_RATE) + 1
                velocity = np.tile(np.float32([speed, 0.0]), (steps, 1))
                for number, slide in enumerate(slides):
                    writer.add_recording(
                        name,
                        "robot",
                        f"{number:02d}",
                        lateral=slide,
                        lateral_rate=rate,
                        unit="1",
                        velocity=velocity,
                        velocity_rate=NOMINAL_VELOCITY_RATE,
                    )


def main(argv=None):
    """Converts the slides and prepares a data set of them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("slides", type=Path, help="biotac_slide.h5")
    parser.add_argument("recordings", type=Path, help="recordings.h5, written")
    parser.add_argument("prepared", type=Path, help="prepared.h5, written")
    parser.add_argument("--quiet", action="store_true", help="no progress bars")
    arguments = parser.parse_args(argv)
    convert_biotac(arguments.slides, arguments.recordings, arguments.quiet)
    print("BioTac: sensor counts, not newtons; no normal force; 25 mm/s, below the paper's limits. Checks only.")
    prepare_recordings(
        arguments.recordings,
        arguments.prepared,
        limits=SegmentLimits(speed=None),
        band=BIOTAC_BAND_HZ,
        test=BIOTAC_TEST_SURFACES,
        quiet=arguments.quiet,
    )


if __name__ == "__main__":
    main()

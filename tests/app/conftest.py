"""What the tests of the demo share: the bundled checkpoint, loaded once."""

import pytest

from tactile_diffusers.cli.app.texture import Studio


@pytest.fixture(scope="session")
def studio():
    return Studio()

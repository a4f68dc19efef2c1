"""The readers that are fuzzed, for the tests of what fuzzing found."""

import sys
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def readers():
    """The module `readers` beside this file, which is no package: atheris runs it as a script."""
    sys.path.insert(0, str(Path(__file__).parent))
    try:
        import readers
    finally:
        sys.path.pop(0)
    return readers

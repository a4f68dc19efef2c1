"""How a training script refuses to start: in one line, as the other commands do."""

import sys
from contextlib import contextmanager
from pathlib import Path

_REFUSALS = (ImportError, OSError, ValueError)


@contextmanager
def starting():
    """Marks what the block raises as a refusal: nothing was trained yet, and its message says what to do."""
    try:
        yield
    except _REFUSALS as error:
        error.refused_at_start = True
        raise


def run(main):
    """Runs a script's `main`. What comes later than `starting` keeps its traceback: it may be a fault of ours.

    Raises:
        SystemExit: with exit code 2 and one line on stderr, if it refused to start.
    """
    try:
        main()
    except _REFUSALS as error:
        if not getattr(error, "refused_at_start", False):
            raise
        print(f"{Path(sys.argv[0]).name}: error: {' '.join(str(error).split())}", file=sys.stderr)
        raise SystemExit(2) from None

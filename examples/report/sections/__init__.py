"""The sections of a report: each measures one thing on a `Context` and returns leaves under top-level keys."""

from . import control, generation, paper, reconstruction, regression, second_judge, speed
from .context import FULL, QUICK, Context, Settings, make_context

#: name -> function of a context that returns `{top-level key: ...}`
SECTIONS = {
    "reconstruction": reconstruction.run,
    "generation": generation.run,
    "second_judge": second_judge.run,
    "control": control.run,
    "regression": regression.run,
    "paper": paper.run,
    "speed": speed.run,
}
#: sections that need neither DALE nor ratings
WITHOUT_RATINGS = ("reconstruction", "second_judge", "speed")

__all__ = ["FULL", "QUICK", "SECTIONS", "WITHOUT_RATINGS", "Context", "Settings", "make_context"]

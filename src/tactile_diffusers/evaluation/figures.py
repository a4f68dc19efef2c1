"""The one helper that writes pictures of results."""

from contextlib import contextmanager

from ..io.files import atomic_path

_DPI = 90


@contextmanager
def figure_panels(output_path, rows, columns, size):
    """Yields an array of panels (rows, columns), then gives each a grid and writes the PNG; `size` in inches."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, panels = plt.subplots(rows, columns, figsize=size, constrained_layout=True, squeeze=False)
    try:
        for panel in panels.flat:
            panel.grid(alpha=0.3)
        yield panels
        with atomic_path(output_path) as temporary:
            figure.savefig(temporary, dpi=_DPI, format="png")
    finally:
        plt.close(figure)

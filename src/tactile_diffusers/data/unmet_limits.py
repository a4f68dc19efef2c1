"""Why no segment meets the limits: the measured force and speed, beside the limits and the flags that set them."""

import numpy as np

from ..signal.masks import true_runs

#: A median this many times beyond a limit looks like a wrong unit (recipe).
FAR_OFF = 5.0
_QUANTITIES = {"normal_force": ("normal force", "N"), "speed": ("speed", "mm/s")}


class Measured:
    """Collects, recording by recording, what the `SegmentLimits` are compared with; rates in Hz."""

    def __init__(self, limits, rate):
        self.limits, self.rate = limits, rate
        self._medians, self._runs, self._gaps = {name: [] for name in _QUANTITIES}, [], []

    def add(self, data, usable):
        """Adds one recording: its `Channels`, and the samples that a segment may hold, (n,) bool."""
        for name, values in (("normal_force", data.normal), ("speed", data.speed)):
            if values is not None and not np.isnan(values).all():
                self._medians[name].append(float(np.nanmedian(values)))
        runs = true_runs(usable) / self.rate
        self._runs.extend(runs[:, 1] - runs[:, 0])
        self._gaps.extend(runs[1:, 0] - runs[:-1, 1])

    def __str__(self):
        lines = [self._compare(name, float(np.median(found))) for name, found in self._medians.items() if found]
        runs = f"median {np.median(self._runs):.2g} s, longest {max(self._runs):.2g} s" if self._runs else "none"
        needed = f"a segment lasts {self.limits.seconds:.2f} s (--segment-seconds)"
        lines.append(f"  runs within the limits: {runs}; {needed}")
        if self._gaps:
            bridged = f"up to {self.limits.longest_excursion:g} s outside the limits are bridged (--longest-excursion)"
            lines.append(f"  between two runs: median {np.median(self._gaps):.2g} s; {bridged}")
        return "\n".join(lines)

    def _compare(self, name, median):
        (what, unit), bounds = _QUANTITIES[name], getattr(self.limits, name)
        if bounds is None:
            return f"  {what}: median {median:.3g} {unit}, no limits"
        far = not bounds[0] / FAR_OFF <= median <= bounds[1] * FAR_OFF
        return (
            f"  {what}: median {median:.3g} {unit}, limits {bounds[0]:g} to {bounds[1]:g} {unit}"
            f"{': is the unit right?' if far else ''} (--{name.replace('_', '-')} LOW HIGH, or --no-limits)"
        )

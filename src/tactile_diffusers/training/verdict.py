"""What an adaptation is worth, in words: errors of surfaces that were left out, and what one can tell from them."""

from dataclasses import dataclass

import numpy as np
from scipy import stats

#: Below, an interval over surfaces says nothing.
TOO_FEW = 8


@dataclass(frozen=True)
class Errors:
    """Errors of the mean spectra of n surfaces from their ratings, dB, of a method and of the given checkpoint."""

    own: np.ndarray
    given: np.ndarray

    def words(self, name):
        """The mean error, with its interval where there are enough surfaces."""
        interval = "" if len(self.own) < TOO_FEW else " [{:.2f}, {:.2f}]".format(*_interval(self.own))
        return (
            f"{name}: mean spectra of {len(self.own)} surfaces from their ratings are off by {self.own.mean():.2f} dB"
            f"{interval}."
        )

    def against(self, name):
        """A sentence on whether it is better than the given checkpoint, and whether one can tell."""
        gain, count = self.given - self.own, len(self.own)
        better = int((self.own < self.given).sum())
        text = f"{name} is better than the given checkpoint on {better} of {count} surfaces left out"
        text += f" ({self.own.mean():.2f} against {self.given.mean():.2f} dB)"
        if count < TOO_FEW:
            return f"{text}; too few to say more."
        low, high = _interval(gain)
        if low > 0:
            return f"{text}: by {gain.mean():.2f} dB [{low:.2f}, {high:.2f}]."
        told = "it is worse" if high < 0 else "no difference that can be told"
        return f"{text}: {told} ({low:.2f} to {high:.2f} dB)."


def _interval(values):
    """95 % interval of the mean of values (n,), by Student's t."""
    reach = stats.t.ppf(0.975, len(values) - 1) * values.std(ddof=1) / len(values) ** 0.5
    return values.mean() - reach, values.mean() + reach


def verdict_of(judged):
    """What the recalibration is worth, a paragraph in words."""
    return (
        f"{judged['recalibrated'].against('Recalibrated, it')} A ridge regression on the same surfaces is off by "
        f"{judged['ridge'].own.mean():.2f} dB, their mean spectrum by {judged['mean spectrum'].own.mean():.2f} dB."
    )

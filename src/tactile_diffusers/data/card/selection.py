"""What preparation kept of the recordings, and why it dropped the rest."""

import numpy as np

#: Reason of the time that segments are cut from; all others are reasons why time was dropped.
KEPT = "used"
#: Lengths of a recording (s) that differ by more are of different ones: less than a sample, more than rounding.
SAME_SECONDS = 1e-5


def check_same(source, data):
    """Checks that a data set was prepared from these recordings.

    Args:
        source (`RecordingsFile`): open.
        data (`PreparedDataset`): any view.

    Raises:
        ValueError: naming both files and the first difference.
    """
    names = data.account["recordings"]
    differing = [f"recording {name}" for name in sorted(set(names) ^ set(source.names))]
    if not differing:
        told = dict(zip(names, data.account["seconds"]["filtered"].sum(axis=1), strict=True))
        lasts = {name: length / source.rate(name) for name, length in zip(source.names, source.lengths, strict=True)}
        differing = [f"the length of {name}" for name in names if abs(told[name] - lasts[name]) > SAME_SECONDS]
    if str(source.attributes.get("source")) != data.source:
        differing.append(f"source {data.source!r} against {str(source.attributes.get('source'))!r}")
    if differing:
        raise ValueError(
            f"{data.path} was not prepared from {source.path}: they differ in {differing[0]}. Prepare these "
            "recordings with examples/prepare_data.py, or leave out --prepared."
        )


def describe_selection(data):
    """Seconds kept and dropped, by reason, in the filtered subset.

    Args:
        data (`PreparedDataset`): any view.

    Returns:
        `tuple[dict, dict]`: "reasons" in the order in which they are asked, "seconds" of each, the same per explorer,
        and the share kept; and for each surface its seconds, those kept, and the reason of most of the rest.
    """
    reasons, seconds = list(data.account["reasons"]), np.asarray(data.account["seconds"]["filtered"])
    kept = reasons.index(KEPT)
    by_surface, by_explorer = (
        _sums([name.split("/")[place] for name in data.account["recordings"]], seconds) for place in (0, 1)
    )
    surfaces = {
        surface: {
            "seconds": sums.sum(),
            "kept_seconds": sums[kept],
            "mostly_dropped": reasons[int(np.argmax(np.where(np.arange(len(sums)) == kept, -1, sums)))],
        }
        for surface, sums in by_surface.items()
    }
    total = seconds.sum(axis=0)
    selection = {
        "reasons": reasons,
        "seconds": dict(zip(reasons, total, strict=True)),
        "kept_share": total[kept] / total.sum(),
        "explorers": {who: dict(zip(reasons, sums, strict=True)) for who, sums in by_explorer.items()},
    }
    return selection, surfaces


def _sums(owners, seconds):
    """Seconds by reason, summed over the recordings of each owner."""
    names, numbers = np.unique(owners, return_inverse=True)
    sums = np.zeros((len(names), seconds.shape[1]))
    np.add.at(sums, numbers, seconds)
    return dict(zip(names.tolist(), sums, strict=True))

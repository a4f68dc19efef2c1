"""What is known of an LCTG's training, from the folders that the training scripts leave behind."""

from pathlib import Path

from ..training.record import phases, read_losses, read_record

#: A loss has flattened where its mean changes by less than this share from the fourth to the last fifth of a run.
FLAT = 0.01
# only training DALE has this argument
_DALE_ARGUMENT = "condition_dropout"


def training_facts(folders):
    """Facts of one training of LCTG, summed over its phases.

    Args:
        folders (`Sequence[str` or `Path]`): output folders of its phases, in order. A single folder is followed back
            through what it was trained from; phases that trained DALE are left out.

    Returns:
        `dict`: "phases" (names of folders), "optimiser_steps", "seconds" (wall time), "machines", and of the last phase
        "last_loss" and "flattening", the relative change of the mean training loss from the fourth to the last fifth
        of its steps. None is what is not known, sums of which a phase is not known among them.
    """
    folders = [Path(folder) for folder in folders]
    of_training = phases(folders[0]) if len(folders) == 1 else [(folder, read_record(folder)) for folder in folders]
    known = [(folder, record) for folder, record in of_training if not _is_dale(record)]
    logs = [read_losses(folder) for folder, _ in known]
    steps = [log[-1]["step"] if log else record.get("steps") for log, (_, record) in zip(logs, known, strict=True)]
    seconds = [log[-1].get("seconds") if log else None for log in logs]
    last = logs[-1] if logs else []
    return {
        "phases": [folder.name for folder, record in known if record],
        "optimiser_steps": _sum(steps),
        "seconds": _sum(seconds),
        "machines": sorted({record["machine"] for _, record in known if "machine" in record}),
        "last_loss": last[-1]["train/loss"] if last else None,
        "flattening": flattening(last),
    }


def flattening(log):
    """Relative change of the mean training loss from the fourth to the last fifth of a run; None for too short a run.

    Args:
        log (`list[dict]`): entries with "step" and "train/loss".

    Returns:
        `float` or `None`: negative = still falling.
    """
    if not log:
        return None
    end = log[-1]["step"]
    fourth = [entry["train/loss"] for entry in log if 3 * end < 5 * entry["step"] <= 4 * end]
    last = [entry["train/loss"] for entry in log if 4 * end < 5 * entry["step"]]
    if not fourth:
        return None
    before, after = sum(fourth) / len(fourth), sum(last) / len(last)
    return after / before - 1 if before else None


def _is_dale(record):
    return _DALE_ARGUMENT in record.get("arguments", {})


def _sum(values):
    return None if not values or None in values else sum(values)

"""What is known of an LCTG's training, from the folders that the training scripts leave behind."""

from pathlib import Path

from ..training.record import phases, read_losses, read_record

# only training DALE has this argument
_DALE_ARGUMENT = "condition_dropout"


def training_facts(folders):
    """Cost of one training of LCTG, summed over its phases.

    Args:
        folders (`Sequence[str` or `Path`]): output folders of its phases, in order. A single folder is followed back
            through what it was trained from; phases that trained DALE are left out.

    Returns:
        `dict`: "phases" (names of folders), "optimiser_steps" and "seconds" (wall time); None where a phase is not
        known.
    """
    folders = [Path(folder) for folder in folders]
    of_training = phases(folders[0]) if len(folders) == 1 else [(folder, read_record(folder)) for folder in folders]
    known = [(folder, record) for folder, record in of_training if _DALE_ARGUMENT not in record.get("arguments", {})]
    logs = [read_losses(folder) for folder, _ in known]
    steps = [log[-1]["step"] if log else record.get("steps") for log, (_, record) in zip(logs, known, strict=True)]
    seconds = [log[-1].get("seconds") if log else None for log in logs]
    return {
        "phases": [folder.name for folder, record in known if record],
        "optimiser_steps": _sum(steps),
        "seconds": _sum(seconds),
    }


def _sum(values):
    return None if not values or None in values else sum(values)

"""Make a trained pipeline small and documented: `python examples/publish.py --help`."""

import argparse
import os
import re
import shutil
import sys
from fnmatch import fnmatchcase
from pathlib import Path

from tactile_diffusers.cli.program import Parser, command, existing_file, existing_folder, refuse, warn
from tactile_diffusers.io.files import clear_left_behind, whole_folder
from tactile_diffusers.io.reading import read_json, reading

#: Folder of a checkpoint with the pictures of its report.
REPORT = "report"


def _folder_with(file, writer):
    """A type of argument: a folder with the file `file`, which `writer` writes."""

    def folder(word):
        if not (Path(word) / file).is_file():
            raise argparse.ArgumentTypeError(f"{word} has no {file}; it is written by {writer}")
        return Path(word)

    return folder


def _hub_id(word):
    if not re.fullmatch(r"[\w.-]+/[\w.-]+", word):
        raise argparse.ArgumentTypeError(f"must be USER/NAME, got {word!r}")
    return word


def parse_arguments(argv=None):
    """Arguments of the command."""
    parser = Parser(prog="publish.py", description="Store a trained pipeline small and documented.")
    add = parser.add_argument
    run = _folder_with("training.json", "the training scripts")
    add("--checkpoint", type=existing_folder, required=True, metavar="FOLDER", help="the trained pipeline")
    add(
        "--runs", type=run, nargs="+", required=True, metavar="FOLDER", help="output folders of its trainings, in order"
    )
    add("--data", type=existing_file, required=True, metavar="PREPARED.h5", help="what the pipeline was trained on")
    add("--output", type=Path, required=True, metavar="FOLDER", help="new, or published before: then it is replaced")
    add("--note", default="", help="a sentence on how the trainings were run, for the card")
    add("--report", type=_folder_with("report.json", "examples/evaluate.py"), metavar="FOLDER", help="output folder of "
        "evaluate.py: its tables and pictures, for the card")  # fmt: skip
    add("--data_card", type=_folder_with("card.json", "examples/inspect_data.py"), metavar="FOLDER", help="output "
        "folder of inspect_data.py: its warnings, for the card")  # fmt: skip
    add("--licence", help="of the weights, as the Hub names it; default: that of the data")
    add("--push_to_hub", type=_hub_id, metavar="USER/NAME", help="send the folder there; log in with `hf auth login`")
    arguments = parser.parse_args(argv)
    try:
        _check_output(arguments)
    except (ValueError, OSError) as error:
        parser.error(f"argument --output: {error}")
    return arguments


def _check_output(arguments):
    """Refuses an output that is no folder, or whose replacement would remove what it reads or anything foreign."""
    output = arguments.output.resolve()
    if output.exists() and not output.is_dir():
        raise ValueError(f"{arguments.output} is not a folder")
    read = (getattr(arguments, name) for name in ("checkpoint", "data", "report", "data_card"))
    for path in filter(None, [*read, *arguments.runs, Path.cwd()]):
        if output in (path.resolve(), *path.resolve().parents):
            raise ValueError(
                f"{arguments.output} would be replaced as a whole, and {path} lies in it; give another folder"
            )
    _check_replaceable(output)


def _check_replaceable(output):
    """Refuses a folder that holds anything but a published checkpoint."""
    from tactile_diffusers.pipelines.hub import BESIDE

    found = {path.name for path in output.iterdir()} if output.is_dir() else set()
    known = set()
    if "model_index.json" in found:
        index = read_json(output / "model_index.json", "the index of a checkpoint")
        known = {"model_index.json", *index}
        known |= {name for name in found for pattern in BESIDE if fnmatchcase(name, pattern.split("/")[0])}
    if foreign := sorted(found - known):
        raise ValueError(
            f"{output} would be replaced as a whole, and holds {foreign[:3]}, which no publish.py wrote; give a new "
            "folder, or move what is in it"
        )


def _data_warnings(folder, data):
    """The warnings of a data card of these data as Markdown."""
    with reading(folder / "card.json", "a data card", "Write it again with examples/inspect_data.py."):
        card = read_json(folder / "card.json", "JSON")
        source = card["recordings"]["attributes"].get("source")
        surfaces = card["recordings"]["surfaces"]
        warnings = [f"- **{warning['name']}**: {warning['text']}" for warning in card["warnings"]]
    if source != data.source or surfaces != len(data.surfaces):
        raise ValueError(
            f"--data_card {folder} describes {surfaces} surfaces of {source!r}, --data holds {len(data.surfaces)} of "
            f"{data.source!r}: write the card of these data with examples/inspect_data.py."
        )
    return "\n".join(warnings) or "None."


def _report(folder, digests, output, known):
    """The results of an evaluation of one of the checkpoints `digests` as Markdown; copies its pictures into `output`.

    Warns on stderr, and in the results, of test surfaces that the checkpoint was trained on (`known`).
    """
    from report.page import report_markdown

    from tactile_diffusers.training.record import count_seen, warning

    path, text = folder / "report.json", ""
    with reading(path, "a report", "Run examples/evaluate.py again."):
        report = read_json(path, "JSON")
        if report["checkpoint"]["sha256"] not in digests:
            raise ValueError(
                f"--report {path} is of another checkpoint ({report['checkpoint']['name']}): evaluate this one with "
                "examples/evaluate.py."
            )
        if (judged := report.get("judged")) is not None:
            report["seen_in_training"] = count_seen(judged, known)
            text = warning(report["seen_in_training"], len(judged["surfaces"]))
        markdown = re.sub(r"^#", "###", report_markdown(report), flags=re.M)  # below the headings of the card
        markdown = markdown.replace("](./", f"]({REPORT}/")
    if text:
        warn("publish.py", f"--report {folder}: {text}")
    pictures = re.findall(rf"\]\({REPORT}/([^)]+)\)", markdown)
    if missing := [name for name in pictures if not (folder / name).is_file()]:
        raise ValueError(f"--report {folder} lacks {missing}: run examples/evaluate.py again, it goes on where it was.")
    for name in pictures:
        (output / REPORT).mkdir(exist_ok=True)
        shutil.copyfile(folder / name, output / REPORT / name)
    return markdown


def _fill(arguments, temporary):
    """Writes the whole checkpoint into a new, empty folder; a `ValueError` if its parts do not belong together."""
    import torch

    from tactile_diffusers import TactileTexturePipeline
    from tactile_diffusers.data import PreparedDataset
    from tactile_diffusers.pipelines.folders import folder_digest
    from tactile_diffusers.pipelines.hub import forget_folders
    from tactile_diffusers.training.card import write_card
    from tactile_diffusers.training.record import surfaces_of, trained_on, write_surfaces

    pipe = TactileTexturePipeline.from_pretrained(str(arguments.checkpoint), dtype=torch.float16)
    data = PreparedDataset(arguments.data, "train")
    warnings = None if arguments.data_card is None else _data_warnings(arguments.data_card, data)
    pipe.save_pretrained(str(temporary))
    forget_folders(temporary)
    digests = {folder_digest(arguments.checkpoint), folder_digest(temporary)}
    found, complete = trained_on(arguments.runs)
    write_surfaces(temporary, found, complete)
    # trainings that did not record their surfaces had those of --data
    known = [*found, surfaces_of(data)]
    report = None if arguments.report is None else _report(arguments.report, digests, temporary, known)
    write_card(
        temporary,
        pipe,
        data,
        arguments.runs,
        place=arguments.push_to_hub or arguments.output.resolve().name,
        licence=arguments.licence,
        warnings=warnings,
        report=report,
        note=arguments.note,
    )


@command("publish.py")
def main(argv=None):
    """Writes the folder under a temporary name, renames it, and sends it to the Hub if asked.

    Returns:
        `int`: 1 if the folder is written, but the Hub refused it.
    """
    arguments = parse_arguments(argv)
    output = Path(os.path.realpath(arguments.output))
    replaced = output.is_dir() and any(output.iterdir())
    output.parent.mkdir(parents=True, exist_ok=True)
    clear_left_behind(output)
    # again: files may have appeared since
    with whole_folder(output, lambda: _check_replaceable(output)) as temporary:
        _fill(arguments, temporary)
    size = sum(path.stat().st_size for path in output.rglob("*") if path.is_file())
    print(f"{arguments.output}: {size / 1e6:.1f} MB" + (", in place of what the folder held" if replaced else ""))
    if arguments.push_to_hub is None:
        return 0
    from tactile_diffusers.pipelines.hub import upload_checkpoint

    try:
        upload_checkpoint(output, arguments.push_to_hub)
    except OSError as error:
        refuse("publish.py", f"{arguments.output} is written, but the Hub refused it: {error}")
        return 1
    print(f"sent to https://huggingface.co/{arguments.push_to_hub}")
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""`python examples/publish.py`: a trained pipeline as a small, documented checkpoint folder."""

import os
import re
import shutil
import sys
from fnmatch import fnmatchcase
from pathlib import Path

from ..checkpoints import DISTILLED
from ..io.files import clear_left_behind, whole_folder
from ..io.reading import read_json, reading
from .program import Parser, program, refuse

#: Folder of a checkpoint with the pictures of its report.
REPORT = "report"


def parse_arguments(argv=None):
    """Arguments of the command.

    Raises:
        SystemExit: on bad arguments, with exit code 2 and a line that says what is wrong.
    """
    parser = Parser(prog=program("publish.py"), description="Store a trained pipeline small and documented.")
    parser.add_argument("--checkpoint", type=Path, required=True, metavar="FOLDER", help="trained pipeline")
    parser.add_argument(
        "--runs",
        type=Path,
        nargs="+",
        required=True,
        metavar="FOLDER",
        help="output folders of its trainings, in order",
    )
    parser.add_argument("--lctg", type=Path, metavar="FOLDER", help="take LCTG from here: same encoder, better decoder")
    parser.add_argument("--distilled", type=Path, metavar="FOLDER", help="output folder of distill_lctg.py, goes along")
    parser.add_argument("--data", type=Path, required=True, metavar="PREPARED.h5", help="what it was trained on")
    parser.add_argument("--output", type=Path, required=True, metavar="FOLDER")
    parser.add_argument("--note", default="", help="a sentence on how the trainings were run, for the card")
    parser.add_argument(
        "--report",
        type=Path,
        metavar="FOLDER",
        help="output folder of evaluate.py: its tables and figures, for the card",
    )
    parser.add_argument(
        "--data_card", type=Path, metavar="FOLDER", help="output folder of inspect_data.py: its warnings, for the card"
    )
    parser.add_argument("--licence", help="of the weights, as the Hub names it; default: that of the data")
    parser.add_argument("--push_to_hub", metavar="USER/NAME", help="send the folder there; log in with `hf auth login`")
    arguments = parser.parse_args(argv)
    for run in [*arguments.runs, *([arguments.distilled] if arguments.distilled else [])]:
        if not (run / "training.json").is_file():
            parser.error(f"argument --runs: {run} has no training.json; it is written by the training scripts")
    for name, file, command in (("report", "report.json", "evaluate"), ("data_card", "card.json", "inspect_data")):
        folder = getattr(arguments, name)
        if folder is not None and not (folder / file).is_file():
            parser.error(f"argument --{name}: {folder} has no {file}; it is written by examples/{command}.py")
    if arguments.push_to_hub is not None and not re.fullmatch(r"[\w.-]+/[\w.-]+", arguments.push_to_hub):
        parser.error(f"argument --push_to_hub: must be USER/NAME, got {arguments.push_to_hub!r}")
    _check_output(parser, arguments)
    return arguments


def _check_output(parser, arguments):
    """Refuses an output that is no folder, or whose replacement would take what was given, or all, with it."""
    output = arguments.output.resolve()
    if output.exists() and not output.is_dir():
        parser.error(f"argument --output: {arguments.output} is not a folder")
    given = ("checkpoint", "lctg", "distilled", "data", "report", "data_card")
    kept = [*(getattr(arguments, name) for name in given), *arguments.runs, Path.cwd()]
    for path in filter(None, kept):
        if output in (path.resolve(), *path.resolve().parents):
            parser.error(
                f"argument --output: {arguments.output} would be replaced as a whole, and {path} lies in it; give "
                "another folder"
            )
    try:
        _check_replaceable(output)
    except (ValueError, OSError) as error:
        parser.error(f"argument --output: {error}")


def _check_replaceable(output):
    """Refuses a folder that holds anything which this command did not write: it is replaced as a whole.

    Raises:
        ValueError: naming what is foreign, if the folder is neither absent, empty nor a published checkpoint.
    """
    from ..pipelines.hub import BESIDE

    found = {path.name for path in output.iterdir()} if output.is_dir() else set()
    known = set()
    if "model_index.json" in found:
        index = read_json(output / "model_index.json", "the index of a checkpoint")
        known = {"model_index.json", *index}
        known |= {name for name in found for pattern in BESIDE if fnmatchcase(name, pattern.split("/")[0])}
    foreign = sorted(found - known)
    if foreign:
        raise ValueError(
            f"{output} would be replaced as a whole, and holds {foreign[:3]}, which no publish.py wrote; give a new "
            "folder, or move what is in it"
        )


def _replace_lctg(pipe, folder):
    """Gives `pipe` the LCTG of another pipeline folder.

    Raises:
        ValueError: if its encoder differs: DALE was trained on the latents of the one that `pipe` has; or if it does
            not fit the other components.
    """
    from tactile_diffusers import LCTGModel
    from tactile_diffusers.models.lctg import same_encoder
    from tactile_diffusers.pipelines.inputs import check_components

    other = LCTGModel.from_pretrained(folder, subfolder="lctg", dtype=pipe.lctg.dtype)
    if not same_encoder(other, pipe.lctg):
        raise ValueError(f"--lctg {folder} has another encoder than --checkpoint: DALE would speak another language.")
    pipe.register_modules(lctg=other)
    check_components(pipe.lctg, pipe.feature_extractor, pipe.dale)  # what the weights of an encoder do not tell


def _add_distilled(pipe, folder, output):
    """Stores the distilled LCTG of a training beside the pipeline.

    Raises:
        ValueError: if its encoder is not the pipeline's.
    """
    from tactile_diffusers import LCTGModel
    from tactile_diffusers.models.lctg import same_encoder

    lctg = LCTGModel.from_pretrained(folder, subfolder=DISTILLED, dtype=pipe.lctg.dtype)
    if not same_encoder(lctg, pipe.lctg):
        raise ValueError(f"--distilled {folder} has another encoder than --checkpoint: DALE's latents do not fit it.")
    lctg.save_pretrained(str(output / DISTILLED))


def _warnings(folder, data):
    """The warnings of a data card as Markdown.

    Raises:
        ValueError: if the card is of other data.
    """
    from ..data.card.markdown import warnings_in_words

    with reading(folder / "card.json", "a data card", "Write it again with examples/inspect_data.py."):
        card = read_json(folder / "card.json", "JSON")
        described, given = card["recordings"]["attributes"].get("source"), data.source
        surfaces = (card["recordings"]["surfaces"], len(data.surfaces))
        warnings = warnings_in_words(card)
    if described != given or surfaces[0] != surfaces[1]:
        raise ValueError(
            f"--data_card {folder} describes {surfaces[0]} surfaces of {described!r}, --data holds {surfaces[1]} of "
            f"{given!r}: write the card of these data with examples/inspect_data.py."
        )
    return warnings


def _report(folder, digests, output, known):
    """The results of an evaluation as Markdown; its pictures are copied into `output`.

    Surfaces that judged the checkpoint though it was trained on them are told on stderr and in the results.

    Args:
        folder (`Path`): output folder of evaluate.py.
        digests (`set[str]`): of the checkpoints, either of which may have been evaluated.
        output (`Path`): the folder of the model card.
        known (`list[dict]`): surfaces of its training, as `trained_on` finds them.

    Raises:
        ValueError: if another checkpoint was evaluated, or a picture is missing.
    """
    from ..evaluation.summary import readme_markdown
    from ..training.surfaces import count_seen, warning

    told, path = "", folder / "report.json"
    with reading(path, "a report", "Run examples/evaluate.py again."):
        report = read_json(path, "JSON")
        if report["checkpoint"]["sha256"] not in digests:
            raise ValueError(
                f"--report {path} is of another checkpoint ({report['checkpoint']['name']}): evaluate this one with "
                "examples/evaluate.py."
            )
        judged = report.get("judged")  # an older report does not name them
        if judged is not None:
            report["seen_in_training"] = count_seen(judged, known)
            told = warning(report["seen_in_training"], len(judged["surfaces"]))
        markdown = readme_markdown(report, REPORT)
    if told:
        print(f"{program('publish.py')}: warning: --report {folder}: {told}", file=sys.stderr)
    pictures = re.findall(rf"\]\({REPORT}/([^)]+)\)", markdown)
    missing = [name for name in pictures if not (folder / name).is_file()]
    if missing:
        raise ValueError(f"--report {folder} lacks {missing}: run examples/evaluate.py again, it goes on where it was.")
    for name in pictures:
        (output / REPORT).mkdir(exist_ok=True)
        shutil.copyfile(folder / name, output / REPORT / name)
    return markdown


def _fill(arguments, temporary):
    """Writes the whole checkpoint into a new, empty folder.

    Raises:
        ValueError: if what was given does not belong together.
    """
    import torch

    from tactile_diffusers import TactileTexturePipeline

    from ..data import PreparedDataset
    from ..evaluation.report import folder_digest
    from ..pipelines.hub import forget_folders
    from ..training.card import write_card
    from ..training.surfaces import surfaces_of, trained_on, write_surfaces

    pipe = TactileTexturePipeline.from_pretrained(str(arguments.checkpoint), dtype=torch.float16)
    if arguments.lctg is not None:
        _replace_lctg(pipe, arguments.lctg)
    data = PreparedDataset(arguments.data, "train")
    warnings = None if arguments.data_card is None else _warnings(arguments.data_card, data)
    pipe.save_pretrained(str(temporary))
    forget_folders(temporary)
    digests = {folder_digest(arguments.checkpoint), folder_digest(temporary)}
    if arguments.distilled is not None:
        _add_distilled(pipe, arguments.distilled, temporary)
        forget_folders(temporary)
        digests.add(folder_digest(temporary))
    distilled = [arguments.distilled] if arguments.distilled else []
    found, complete = trained_on([*arguments.runs, *distilled, *([arguments.lctg] if arguments.lctg else [])])
    write_surfaces(temporary, found, complete)
    # trainings of old kept no names: those of --data, which they trained on by what the user says, stand in
    known = [*found, surfaces_of(data)]
    report = None if arguments.report is None else _report(arguments.report, digests, temporary, known)
    write_card(
        temporary,
        pipe,
        data,
        [*arguments.runs, *distilled],
        place=arguments.push_to_hub or arguments.output.resolve().name,
        licence=arguments.licence,
        warnings=warnings,
        report=report,
        note=arguments.note,
    )


def main(argv=None):
    """Runs the command: writes the folder under a temporary name, renames it, and sends it if asked.

    Returns:
        `int`: 0; 1 if the folder is written, but the Hub refused it; or 2 if something was refused before (one line on
        stderr, nothing written).
    """
    arguments = parse_arguments(argv)
    output = Path(os.path.realpath(arguments.output))
    replaced = output.is_dir() and any(output.iterdir())
    try:
        output.parent.mkdir(parents=True, exist_ok=True)
        clear_left_behind(output)
        # again: files may have appeared since
        with whole_folder(output, lambda: _check_replaceable(output)) as temporary:
            _fill(arguments, temporary)
    except (ValueError, OSError) as error:
        return refuse("publish.py", error)
    size = sum(path.stat().st_size for path in output.rglob("*") if path.is_file())
    print(f"{arguments.output}: {size / 1e6:.1f} MB" + (", in place of what the folder held" if replaced else ""))
    if arguments.push_to_hub is None:
        return 0
    from ..pipelines.hub import upload_checkpoint

    try:
        upload_checkpoint(output, arguments.push_to_hub)
    except OSError as error:
        told = f"{arguments.output} is written, but the Hub refused it: {error}"
        print(f"{program('publish.py')}: error: {told}", file=sys.stderr)
        return 1
    print(f"sent to https://huggingface.co/{arguments.push_to_hub}")
    return 0

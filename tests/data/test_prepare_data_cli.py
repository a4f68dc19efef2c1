"""The command line: what it makes, and how it refuses."""

import pytest
from export_folder import export_folder

from tactile_diffusers.cli.prepare_data import main
from tactile_diffusers.data import PreparedDataset, RecordingsFile


def run(words, **paths):
    return main(words.format(**paths).split())


def refused(words, **paths):
    """Whether a command ends with exit code 2, by argparse or by itself."""
    try:
        return run(words, **paths) == 2
    except SystemExit as stop:
        return stop.code == 2


def test_virtual_then_again_from_its_recordings(tmp_path, capsys):
    recordings, prepared, again = (tmp_path / name for name in ("r.h5", "p.h5", "again.h5"))
    run(
        "--surfaces 4 --seconds 10 --explorers 1 --seed 2 --output {r} --prepared {p} --quiet", r=recordings, p=prepared
    )
    output = capsys.readouterr()
    assert "filtered segments: train" in output.out and not output.err
    assert "ratings in z-scores, as `generate` takes them (first 4 of 4):\n" in output.out
    notes = sum(line.startswith("note: ") for line in output.out.splitlines())
    assert notes and f"wrote {prepared}; {notes} note" in output.out  # one surface each is held out of four
    run("--source recordings --recordings {r} --prepared {p} --quiet", r=recordings, p=again)
    a, b = (PreparedDataset(path, "all", "full") for path in (prepared, again))
    assert len(a) == len(b) and (a.levels == b.levels).all()
    with RecordingsFile(recordings) as file:
        assert len(file) == 4 and file.attributes["seed"] == 2


def test_flags_reach_the_preparation(tmp_path, virtual_recordings):
    prepared = tmp_path / "p.h5"
    flags = "--no-limits --band 30 500 --segment-seconds 1 --overlap 0 --validation 2 --test 1 --split-seed 4 --quiet"
    flags += " --turnarounds keep"
    run(f"--source recordings --recordings {{r}} --prepared {{p}} {flags}", r=virtual_recordings, p=prepared)
    data = PreparedDataset(prepared, "all")
    assert data.band == (30, 500) and data.segment_samples == 10_000
    assert data.attributes["turnarounds"] == "keep"
    assert len(data) == len(PreparedDataset(prepared, "all", "full"))
    assert len(set(PreparedDataset(prepared, "validation").surface_ids)) == 2


def test_flags_reach_the_virtual_collection(tmp_path):
    recordings, prepared = tmp_path / "r.h5", tmp_path / "p.h5"
    flags = "--surfaces 6 --seconds 8 --explorers 3 --raters 5 --rating-correlation 0.3 -0.7 -0.1 --impulsiveness 0.5"
    flags += " --no-limits --hold-out-explorers explorer-2 --hold-out-raters rater-3 rater-4"
    flags += " --hold-out-surfaces 0005-*"
    run(f"{flags} --validation 1 --test 1 --output {{r}} --prepared {{p}} --quiet", r=recordings, p=prepared)
    with RecordingsFile(recordings) as file:
        assert len(file) == 18 and file.ratings.values.shape == (5, 6, 3)
        assert file.attributes["rating_correlation"].tolist() == [0.3, -0.7, -0.1]
    hard, train = PreparedDataset(prepared, "hard"), PreparedDataset(prepared, "train")
    assert {hard.recordings[i].split("/")[1] for i in hard.recording_ids} == {"explorer-2"}
    assert {train.recordings[i].split("/")[1] for i in train.recording_ids} == {"explorer-0", "explorer-1"}
    assert set(hard.surface_ids) == {5} and 5 not in set(train.surface_ids)


def test_why_no_segment_meets_the_limits_is_listed(tmp_path, virtual_recordings, capsys):
    flags = "--source recordings --recordings {r} --prepared {p} --speed 900 950 --quiet"
    assert refused(flags, r=virtual_recordings, p=tmp_path / "p.h5")
    lines = capsys.readouterr().err.splitlines()
    assert "no segment meets the limits" in lines[0] and any(line.startswith("  speed: median") for line in lines)


def test_inspect_lists_and_drafts_but_never_over_an_older_draft(tmp_path, virtual_recordings, capsys):
    folder, draft = tmp_path / "folder", tmp_path / "layout.toml"
    export_folder(virtual_recordings, folder, quiet=True)
    run("--inspect {f} --draft {d} --quiet", f=folder, d=draft)
    assert "TODO" in capsys.readouterr().out and "[[files]]" in draft.read_text()
    assert refused("--inspect {f} --draft {d} --quiet", f=folder, d=draft)
    assert "exists" in capsys.readouterr().err


FOLDER = "--source folder --root {tmp} --layout " + __file__ + " --output {tmp}/r.h5 --prepared {tmp}/p.h5"


@pytest.mark.parametrize(
    "flags, message",
    [
        ("", "--source virtual needs --output"),
        ("--output {tmp}/nowhere/r.h5", "nowhere of r.h5 does not exist"),
        ("--output {tmp}/r.h5 --prepared {tmp}/r.h5", "must differ"),
        ("--output {tmp}/r.h5 --root {tmp}", "--root belongs to --source"),
        ("--source recordings --prepared {tmp}/p.h5", "needs --recordings"),
        ("--source recordings --recordings " + __file__, "needs --prepared"),
        ("--source folder --root {tmp} --output {tmp}/r.h5", "Write one with --inspect"),
        ("--source folder --root {tmp}/no --layout " + __file__ + " --output {tmp}/r.h5", "is not a folder"),
        ("--source recordings --workers 2 --recordings " + __file__, "--workers belongs to --source virtual"),
        ("--draft {tmp}/l.toml --output {tmp}/r.h5", "--draft belongs to --inspect"),
        ("--inspect {tmp} --prepared {tmp}/p.h5 --seed 1", "--inspect does one thing, and stops: leave out"),
        ("--inspect {tmp} --draft {tmp}/nowhere/l.toml", "nowhere of l.toml does not exist"),
        ("--inspect {tmp}", "there is no file that can be read as a table"),
        ("--root {tmp} --output {tmp}/r.h5", "not to virtual. Files of your own: --source folder."),
        ("--output {tmp}/r.h5 --seconds 0.2", "`seconds`"),
        ("--output {tmp}/r.h5 --prepared {tmp}/p.h5 --band 500 20", "--band must satisfy"),
        ("--output {tmp}/r.h5 --prepared {tmp}/p.h5 --overlap 1", "`overlap`"),
        ("--output {tmp}/r.h5 --prepared {tmp}/p.h5 --surfaces 2", "leave none of 2 surfaces"),
        (f"{FOLDER} --split-seed -1", "`split_seed` must be"),
        (f"{FOLDER} --validation 1.5", "`validation` must be"),
        ("--output {tmp}/r.h5 --prepared {tmp}/p.h5 --no-limits --speed 10 20", "contradicts"),
        ("--output {tmp}/r.h5 --prepared {tmp}/p.h5 --hold-out-explorers explorer-2", "matches none of the 2"),
        ("--output {tmp}/r.h5 --prepared {tmp}/p.h5 --hold-out-raters rater-12", "matches none of the 12"),
        ("--output {tmp}/r.h5 --prepared {tmp}/p.h5 --hold-out-surfaces *-velvet", "matches none of the 50"),
    ],
)
def test_refusals_come_before_any_work(tmp_path, capsys, flags, message):
    assert refused(flags, tmp=tmp_path)
    assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())

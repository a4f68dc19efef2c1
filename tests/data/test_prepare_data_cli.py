"""The command line: what it makes, and how it refuses."""

import pytest

from tactile_diffusers.cli.prepare_data import main
from tactile_diffusers.data import PreparedDataset, RecordingsFile


def test_virtual_then_again_from_its_recordings(tmp_path, capsys):
    recordings, prepared, again = (tmp_path / name for name in ("r.h5", "p.h5", "again.h5"))
    main(
        f"--surfaces 4 --seconds 10 --explorers 1 --seed 2 --output {recordings} --prepared {prepared} --quiet".split()
    )
    output = capsys.readouterr()
    assert "filtered segments: train" in output.out and not output.err
    main(f"--source recordings --recordings {recordings} --prepared {again} --quiet".split())
    a, b = (PreparedDataset(path, "all", "full") for path in (prepared, again))
    assert len(a) == len(b) and (a.levels == b.levels).all()
    with RecordingsFile(recordings) as file:
        assert len(file) == 4 and file.attributes["seed"] == 2


def test_flags_reach_the_preparation(tmp_path, virtual_recordings):
    prepared = tmp_path / "p.h5"
    flags = "--no-limits --band 30 500 --segment-seconds 1 --overlap 0 --validation 2 --test 1 --split-seed 4 --quiet"
    main(f"--source recordings --recordings {virtual_recordings} --prepared {prepared} {flags}".split())
    data = PreparedDataset(prepared, "all")
    assert data.band == (30, 500) and data.segment_samples == 10_000
    assert len(data) == len(PreparedDataset(prepared, "all", "full"))
    assert len(set(PreparedDataset(prepared, "validation").surface_ids)) == 2


@pytest.mark.parametrize(
    "flags, message",
    [
        ("", "--source virtual needs --output"),
        ("--output {tmp}/nowhere/r.h5", "nowhere of r.h5 does not exist"),
        ("--output {tmp}/r.h5 --prepared {tmp}/r.h5", "must differ"),
        ("--output {tmp}/r.h5 --root x.h5", "--root belongs to --source biotac"),
        ("--source recordings --prepared {tmp}/p.h5", "needs --recordings"),
        ("--source recordings --recordings {tmp}/no.h5 --prepared {tmp}/p.h5", "there is no file"),
        ("--source biotac --root {tmp}/no.h5 --output {tmp}/r.h5", "there is no file"),
        ("--output {tmp}/r.h5 --surfaces 0", "`surfaces`"),
        ("--output {tmp}/r.h5 --seconds 1", "`seconds`"),
        ("--output {tmp}/r.h5 --prepared {tmp}/p.h5 --band 500 20", "--band must satisfy"),
        ("--output {tmp}/r.h5 --prepared {tmp}/p.h5 --overlap 1", "`overlap`"),
        ("--output {tmp}/r.h5 --prepared {tmp}/p.h5 --surfaces 2", "leave none of 2 surfaces"),
        ("--output {tmp}/r.h5 --prepared {tmp}/p.h5 --no-limits --speed 10 20", "contradicts"),
    ],
)
def test_refusals_come_before_any_work(tmp_path, capsys, flags, message):
    with pytest.raises(SystemExit) as exit_info:
        main(flags.format(tmp=tmp_path).split())
    assert exit_info.value.code == 2
    assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_help_names_every_source(capsys):
    with pytest.raises(SystemExit):
        main(["--help"])
    output = capsys.readouterr().out
    assert all(source in output for source in ("--source virtual", "--source recordings", "--source biotac"))

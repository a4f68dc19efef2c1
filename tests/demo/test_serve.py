"""The command: its arguments, and what it refuses."""

import socket
import sys
from pathlib import Path

import app as serve
import pytest
import yaml


def test_listens_on_this_machine_alone_unless_told_otherwise():
    assert serve.parse_arguments([]).host == "127.0.0.1"


@pytest.mark.parametrize("line", ["--port 0", "--port 70000", "--checkpoint nowhere", "--what"])
def test_bad_arguments_are_refused(line):
    with pytest.raises(SystemExit) as stop:
        serve.parse_arguments(line.split())
    assert stop.value.code == 2


def test_without_gradio_it_says_what_to_install(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "gradio", None)
    monkeypatch.setattr(serve.os, "environ", {})
    assert serve.main([]) == 2
    assert 'pip install "tactile-diffusers[demo]"' in capsys.readouterr().err


def test_a_port_in_use_is_told(capsys):
    pytest.importorskip("gradio")
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        assert serve.main(["--port", str(port)]) == 2
    told = capsys.readouterr().err.strip().splitlines()[-1]
    assert told.startswith("app.py: error: ") and str(port) in told


def test_the_folder_is_a_space():
    folder = Path(serve.__file__).parent
    header = yaml.safe_load((folder / "README.md").read_text(encoding="utf-8").split("---\n")[1])
    assert header["sdk"] == "gradio" and (folder / header["app_file"]).is_file()
    assert (folder / "requirements.txt").read_text().startswith("tactile-diffusers[demo]")


def test_a_space_says_where_to_listen(monkeypatch):
    monkeypatch.setenv("GRADIO_SERVER_NAME", "0.0.0.0")
    monkeypatch.setenv("GRADIO_SERVER_PORT", "7000")
    arguments = serve.parse_arguments([])
    assert (arguments.host, arguments.port) == ("0.0.0.0", 7000)

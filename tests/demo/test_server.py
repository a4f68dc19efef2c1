"""The running demo by plain HTTP: its pages, what gradio's settings refuse, and visitors apart from each other."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("gradio")
import app as serve

HOW = [2, 5, 2, 1.0, 0, 1.6, 1]  # steps, steps of DALE, order, guidance, seed, seconds, takes
CSV = b"0.1\n-0.1\n0.2\n" * 2000
META = {"meta": {"_type": "gradio.FileData"}}


def test_the_page_answers(visitor):
    status, page, _ = visitor.ask("GET", "/")
    assert status == 200 and b"Tactile textures from ratings" in page
    assert visitor.ask("GET", "/theme.css")[0] == 200


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have one loopback address")
def test_it_listens_on_one_address(page, port):
    for host, answers in (("127.0.0.1", True), ("127.0.0.2", False)):
        with socket.socket() as asking:
            assert (asking.connect_ex((host, port)) == 0) == answers


def test_gradio_is_told_to_delete_files_and_to_share_nothing(page):
    assert page.delete_cache == (serve.CLEANING_SECONDS, serve.FILE_SECONDS)
    assert page.share is False and page.share_url is None and page.allowed_paths == []
    assert page.max_file_size == serve.UPLOAD_MIB * 2**20


@pytest.mark.parametrize("path", ["/etc/passwd", "../../etc/passwd", "..%2f..%2fetc%2fpasswd", __file__])
def test_files_of_the_server_are_not_served(visitor, path):
    status, body, _ = visitor.ask("GET", f"/gradio_api/file={path}")
    assert status in (403, 404) and b"root:" not in body


def test_an_upload_is_reconstructed_and_other_paths_are_not(visitor, tmp_path):
    [path] = json.loads(visitor.upload(("a.csv", CSV))[1])
    success, output = visitor.call("reconstruct", [{"path": path, **META}, 10_000, 1, "z", *HOW])
    assert success and "Nine-band error" in output["data"][2]
    (tmp_path / "secret.csv").write_bytes(CSV)
    assert not visitor.call("reconstruct", [{"path": str(tmp_path / "secret.csv"), **META}, 10_000, 1, "z", *HOW])[0]


def test_large_uploads_are_refused(visitor, monkeypatch):
    status, body = visitor.upload(("a.csv", bytes((serve.UPLOAD_MIB + 1) * 2**20)))
    assert status == 413, body


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("download", [None, 0, "../../etc/passwd", 0.15]),
        ("download", [{"textures": [{"samples": [0.0], "sampling_rate": 1}]}, 0, ".npz", 0.15]),
        ("generate", ["percentile", 50, 50, 50, False, False, False, *HOW[:5], 9000, 1]),
        ("generate", ["percentile", 50, 50, 50, False, False, False, *HOW[:5], 9.0, 8]),
        ("generate", ["z", None, "x", {}, False, False, False, *HOW]),
    ],
)
def test_more_than_the_page_offers_is_refused(visitor, name, values):
    success, output = visitor.call(name, values)
    assert not success and "root:" not in json.dumps(output)


@pytest.mark.slow
def test_visitors_at_once_get_their_own(visit):
    visitors = [visit() for _ in range(3)]
    with ThreadPoolExecutor(len(visitors)) as pool:
        paths = list(pool.map(lambda asked: asked[0].make(asked[1]), zip(visitors, (10, 40, 90), strict=True)))
    assert len({path.parent for path in paths}) == len(visitors)
    found = []
    for visitor, path in zip(visitors, paths, strict=True):
        status, body, _ = visitor.ask("GET", f"/gradio_api/file={path}")
        with np.load(path) as file:
            found.append(float(file["ratings"][0]))
        assert status == 200 and body == path.read_bytes()
    assert found == sorted(found) and len(set(found)) == len(found)
    success, output = visit().download()
    assert not success and "no texture yet" in output["error"]


@pytest.mark.slow
def test_states_of_no_more_than_some_visitors_are_kept(page, visit):
    visitors = [visit() for _ in range(serve.SESSIONS + 5)]
    for visitor in visitors:
        visitor.download()
    kept = page.app.state_holder.session_data
    assert len(kept) <= serve.SESSIONS and visitors[-1].session in kept and visitors[0].session not in kept


@pytest.mark.slow
def test_who_asks_too_often_waits_or_is_refused(visit):
    values = ["percentile", 50, 50, 50, False, False, False, *HOW]
    visitors = [visit() for _ in range(serve.WAITING + 8)]
    with ThreadPoolExecutor(len(visitors)) as pool:
        statuses = list(pool.map(lambda visitor: visitor.join("generate", values)[0], visitors))
    assert set(statuses) <= {200, 503} and statuses.count(200) >= serve.WAITING
    until = time.monotonic() + 60
    while json.loads(visitors[0].ask("GET", "/gradio_api/queue/status")[1])["queue_size"]:
        assert time.monotonic() < until
        time.sleep(0.1)


@pytest.mark.slow
def test_nothing_is_left_when_it_is_stopped(tmp_path, visitor_at):
    """As a process of its own, with an upload and a texture in its folder."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    script = Path(serve.__file__)
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    command = [sys.executable, script, "--port", str(port)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, env=environment, text=True) as process:
        assert "ready at" in process.stdout.readline()
        visitor = visitor_at(port)
        assert visitor.upload(("a.csv", b"1"))[0] == 200
        assert visitor.make(50).is_file()
        process.send_signal(signal.SIGTERM)
        assert process.wait(60) == 0
    assert not list(tmp_path.glob("tactile-app-*"))

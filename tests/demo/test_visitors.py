"""Visitors of the running demo at the same time, and what is left of them."""

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("gradio")
import app as serve
import guard

HOW = [2, 5, 2, 1.0, 0, 1.6, 1]  # steps, steps of DALE, order, guidance, seed, seconds, takes


def _files(folder):
    return [path for path in folder.rglob("*") if path.is_file()]


@pytest.mark.slow
def test_visitors_at_once_get_their_own(visit, folder):
    visitors = [visit() for _ in range(4)]
    with ThreadPoolExecutor(len(visitors)) as pool:
        paths = list(pool.map(lambda asked: asked[0].make(asked[1]), zip(visitors, (10, 40, 70, 90), strict=True)))
    assert len({path.parent for path in paths}) == len(visitors)
    found = []
    for visitor, path in zip(visitors, paths, strict=True):
        status, body, headers = visitor.ask("GET", f"/gradio_api/file={path}")
        assert status == 200 and headers["content-disposition"].startswith("attachment")
        with np.load(path) as file:
            found.append(float(file["ratings"][0]))
        assert body == path.read_bytes()
    assert found == sorted(found) and len(set(found)) == len(found)
    # a path holds more than 40 random bits; neither folders nor other sessions can be listed
    assert all(len(path.parent.name) >= 8 for path in paths)
    for guess in (folder, paths[0].parent, f"{paths[0].parent}/..", f"{folder}/*/{paths[0].name}"):
        assert visitors[1].ask("GET", f"/gradio_api/file={guess}")[0] in (403, 404)


@pytest.mark.slow
def test_a_session_has_nothing_of_another(visit):
    first, second = visit(), visit()
    first.make(30)
    success, output = second.download()
    assert not success and "no texture yet" in output["error"]
    shown = first.call("show", [None, 0, "percentile"])[1]["data"][0]
    second.make(80)
    assert shown == first.call("show", [None, 0, "percentile"])[1]["data"][0]
    assert shown != second.call("show", [None, 0, "percentile"])[1]["data"][0]
    status, _, _ = second.ask("GET", "/gradio_api/queue/status")
    assert status == 200
    assert first.session.encode() not in second.ask("GET", "/config")[1]


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
    assert visit().download()[1]["error"]  # who comes later is answered


def test_files_are_removed_by_age_whoever_left_them(visitor, folder):
    visitor.upload(("old.csv", os.urandom(99)))
    visitor.make(60)
    assert len(_files(folder)) >= 2
    guard.clean(folder, 60)
    assert len(_files(folder)) >= 2
    time.sleep(0.02)
    guard.clean(folder, 0.01)
    guard.clean(folder, -1)  # the folders' own age begins when their last file goes
    assert not list(folder.iterdir())


def test_cleaning_runs_while_the_page_does(tmp_path, monkeypatch):
    class Page:
        is_running = True

    (tmp_path / "left").write_bytes(b"1")
    monkeypatch.setattr(serve, "FILE_SECONDS", -1)
    monkeypatch.setattr(serve, "CLEANING_SECONDS", 0.01)
    thread = threading.Thread(target=serve._keep_clean, args=(Page, tmp_path))
    thread.start()
    until = time.monotonic() + 5
    while list(tmp_path.iterdir()) and time.monotonic() < until:
        time.sleep(0.01)
    Page.is_running = False
    thread.join(5)
    assert not list(tmp_path.iterdir()) and not thread.is_alive()


@pytest.mark.slow
def test_nothing_is_left_when_it_is_stopped(tmp_path, visitor_at):
    """As a process of its own, with an upload and a texture in its folder."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    script = Path(__file__).parents[2] / "examples" / "app.py"
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

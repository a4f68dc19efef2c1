"""The running demo under attack, by plain HTTP: what the page would never send, and two visitors at once."""

import contextlib
import json
import os
import re
import socket
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from http.client import HTTPConnection
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("gradio")
from tactile_diffusers.cli.app import guard, serve
from tactile_diffusers.cli.app.downloads import FORMATS

UPLOAD_MIB = 1
HOW = [2, 5, 2, 1.0, 0, 1.6, 1]  # steps, steps of DALE, order, guidance, seed, seconds, takes
CSV, NPZ = b"0.1\n-0.1\n0.2\n" * 2000, next(name for name in FORMATS if "npz" in name)
META = {"meta": {"_type": "gradio.FileData"}}


class Visitor:
    """Somebody with a session of his own, and no browser."""

    def __init__(self, port, functions):
        self.port, self.functions, self.session = port, functions, os.urandom(8).hex()

    def ask(self, method, path, body=None, headers=None):
        """Status, body and headers of an answer."""
        connection = HTTPConnection("127.0.0.1", self.port, timeout=30)
        try:
            connection.request(method, path, body, headers or {})
            answer = connection.getresponse()
            return answer.status, answer.read(), dict(answer.getheaders())
        finally:
            connection.close()

    def upload(self, *files, path="/gradio_api/upload"):
        """Status and answer; `files` are (name, content)."""
        parts = [
            b'--b\r\nContent-Disposition: form-data; name="files"; filename="%s"\r\n\r\n%s\r\n'
            % (name.encode(), content)
            for name, content in files
        ]
        status, body, _ = self.ask("POST", path, b"".join(parts) + b"--b--\r\n", _form())
        return status, body

    def join(self, name, values, session=None):
        number = self.functions[name] if isinstance(name, str) else name
        asked = {"data": values, "fn_index": number, "session_hash": session or self.session}
        return self.ask("POST", "/gradio_api/queue/join", json.dumps(asked), {"content-type": "application/json"})

    def call(self, name, values):
        """What a function of the page answers: success, output."""
        status, body, _ = self.join(name, values)
        assert status == 200, body
        _, stream, _ = self.ask("GET", f"/gradio_api/queue/data?session_hash={self.session}")
        messages = (json.loads(line[5:]) for line in stream.splitlines() if line.startswith(b"data:"))
        last = next(message for message in messages if message["msg"] == "process_completed")
        return last["success"], last["output"]

    def make(self, percentile):
        """Generates a texture and has it written: path of the file on the server."""
        assert self.call("generate", ["percentile", percentile, 50, 50, False, False, False, *HOW])[0]
        success, written = self.call("download", [None, 0, NPZ])
        assert success
        return Path(written["data"][0]["value"][0]["path"])


def _form():
    return {"content-type": "multipart/form-data; boundary=b"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("uploads")


@pytest.fixture(scope="module")
def visit(studio, folder):
    """A function that gives a new visitor of the running page."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("GRADIO_TEMP_DIR", str(folder))
        patch.setenv("GRADIO_ANALYTICS_ENABLED", "False")
        page = serve.launch(studio, folder, "127.0.0.1", port, UPLOAD_MIB)
        functions = {}
        for function in json.loads(Visitor(port, {}).ask("GET", "/config")[1])["dependencies"]:
            functions.setdefault(function["api_name"], function["id"])
        yield lambda: Visitor(port, functions)
        page.close()


@pytest.fixture
def visitor(visit):
    return visit()


@pytest.fixture
def secret(tmp_path):
    """A file that is no visitor's business."""
    path = tmp_path / "secret.csv"
    path.write_bytes(CSV)
    return path


def _files(folder):
    return [path for path in folder.rglob("*") if path.is_file()]


def test_page_and_its_parts_are_there(visitor):
    status, page, headers = visitor.ask("GET", "/")
    assert status == 200 and headers["content-security-policy"] == guard.CONTENT_POLICY
    assert headers["x-content-type-options"] == "nosniff"
    for path in [*set(re.findall(r'(?:src|href)="\.?(/[\w./-]+)"', page.decode())), "/theme.css", "/gradio_api/info"]:
        assert visitor.ask("GET", path)[0] == 200, path


@pytest.mark.parametrize(
    "path",
    """/gradio_api/file=/etc/passwd /gradio_api/file=../../etc/passwd /gradio_api/file=..%2f..%2fetc%2fpasswd
    /gradio_api/file=http://127.0.0.1:9/ /gradio_api/file=https://example.com/ /gradio_api/file=file:///etc/passwd
    /gradio_api/file=%00 /gradio_api/file//etc/passwd /gradio_api/file= /static/%2e%2e/%2e%2e/package.json
    /assets/..%2f..%2fpackage.json /svelte/..%2f..%2fpackage.json /gradio_api/proxy=http://127.0.0.1:9/
    /gradio_api/deep_link?session_hash=x /monitoring /monitoring/summary /gradio_api/runs /gradio_api/vibe-code/
    /gradio_api/custom_component/0/client/component/..%2f..%2fpackage.json /gradio_api/openapi.json /openapi.json
    /gradio_api/stream/a/b/1/playlist-file /gradio_api/run-history/buckets /docs""".split(),
)
def test_nothing_else_can_be_read(visitor, path):
    status, body, _ = visitor.ask("GET", path)
    assert status in (403, 404) and b"root:" not in body and b"dependencies" not in body


@pytest.mark.parametrize(
    "path",
    "call/generate call/v2/generate run/predict api/predict component_server process_recording vibe-edit/ vibe-code/ "
    "undo-vibe-edit stream/x run-history/connect".split(),
)
def test_nothing_else_can_be_called(visitor, path):
    body = json.dumps({"data": [], "fn_index": 0, "session_hash": "x"})
    assert visitor.ask("POST", f"/gradio_api/{path}", body, {"content-type": "application/json"})[0] == 404
    assert visitor.ask("PUT", f"/gradio_api/{path}", body)[0] == 404


def test_a_file_of_the_folder_itself_is_nobodys(visitor, folder):
    loose = folder / "half-upload"
    loose.write_bytes(b"1")
    assert visitor.ask("GET", f"/gradio_api/file={loose}")[0] == 404
    assert visitor.ask("GET", f"/gradio_api/file={folder}/x/../half-upload")[0] == 404


def test_a_link_out_of_the_folder_is_not_followed(visitor, folder, secret):
    (folder / "own").mkdir()
    (folder / "own" / "link.csv").symlink_to(secret)
    assert visitor.ask("GET", f"/gradio_api/file={folder}/own/link.csv")[0] == 404


@pytest.mark.parametrize(
    "forged",
    [
        {"path": "/etc/passwd", **META},
        {"path": "SECRET", **META},
        {"path": "SECRET", "url": "/gradio_api/file=x", **META},
        {"path": "http://127.0.0.1:LISTENER/x.csv", **META},
        {"path": "https://example.com/x.csv", **META},
        {"path": "file:///etc/passwd", **META},
        {"path": "FOLDER/../secret.csv", "orig_name": "a.csv", **META},
        {"path": "SECRET", "is_stream": True, **META},
        {"path": "\u0000", **META},
        {"path": "", **META},
        [{"path": "SECRET", **META}],
        {"value": {"path": "SECRET", **META}},
    ],
)
def test_no_file_but_an_upload_can_be_named(visitor, folder, secret, forged):
    named = json.dumps(forged).replace("SECRET", str(secret)).replace("FOLDER", str(folder))
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen()
        listener.settimeout(0.05)
        named = named.replace("LISTENER", str(listener.getsockname()[1]))
        status, body, _ = visitor.join("reconstruct", [json.loads(named), 10_000, 1, "z", *HOW])
        assert status == 403 and str(folder).encode() not in body
        with pytest.raises(TimeoutError):
            listener.accept()


def test_an_address_beside_an_upload_is_not_fetched(visitor):
    """Gradio would prefer the address of a file to its path in some places."""
    [path] = json.loads(visitor.upload(("a.csv", CSV))[1])
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen()
        listener.settimeout(0.05)
        address = f"http://127.0.0.1:{listener.getsockname()[1]}/x"
        forged = {"path": path, "url": address, "orig_name": "../../x", "mime_type": "x", **META}
        success, output = visitor.call("reconstruct", [forged, 10_000, 1, "z", *HOW])
        assert success and "Nine-band error" in output["data"][2]
        for odd in ({"url": address, **META}, address, [address], {"url": address}):
            assert not visitor.call("reconstruct", [odd, 10_000, 1, "z", *HOW])[0]
        with pytest.raises(TimeoutError):
            listener.accept()


@pytest.mark.parametrize("name", ["../../../evil.csv", "..\\..\\evil.csv", "/etc/evil.csv", "%2e%2e%2fevil.csv"])
def test_names_lead_nowhere(visitor, folder, name):
    status, body = visitor.upload((name, os.urandom(9)))
    assert status == 200
    [path] = map(Path, json.loads(body))
    assert path.resolve().parent.parent == folder.resolve() and path.is_file()


@pytest.mark.parametrize("name", ["a.html", "a.svg", "a.csv.exe", "a", "csv", "x" * 400, "a.zip", "a.wav\t.js", ".csv"])
def test_other_types_are_refused_and_not_kept(visitor, folder, name):
    before = set(_files(folder))
    assert visitor.upload((name, os.urandom(9)), ("b.csv", CSV))[0] == 415
    assert {path.suffix for path in set(_files(folder)) - before} <= {".csv"}


@pytest.mark.parametrize("name", ["..", "."])
def test_names_that_are_folders_are_refused(visitor, name):
    assert visitor.upload((name, CSV))[0] in (400, 415)


@pytest.mark.parametrize("content", [b"PK\x03\x04" + bytes(999), b"\x1f\x8b\x08" + bytes(999), b"RIFF" + bytes(999)])
def test_content_of_another_type_is_refused_in_words(visitor, content):
    [path] = json.loads(visitor.upload(("a.csv", content))[1])
    success, output = visitor.call("reconstruct", [{"path": path, **META}, 10_000, 1, "z", *HOW])
    assert not success and "file" in output["error"]


def test_size_is_bounded_of_each_file_and_of_all(visitor, folder):
    half = bytes(6 * 2**17)
    before = sum(path.stat().st_size for path in _files(folder))
    for files in ([("a.csv", bytes(2 * 2**20))], [("a.csv", half), ("b.csv", half)]):
        with contextlib.suppress(ConnectionError):  # refused before all of it was sent
            assert visitor.upload(*files)[0] == 413
    assert sum(path.stat().st_size for path in _files(folder)) == before


def test_length_must_be_told(visitor, folder):
    """In chunks, a request has no length that could be looked at before."""
    before = len(_files(folder))
    for path in ("upload", "queue/join"):
        with contextlib.suppress(ConnectionError):
            assert visitor.ask("POST", f"/gradio_api/{path}", iter([b"1" * 999] * 9), _form())[0] == 411
    assert len(_files(folder)) == before


def test_many_uploads_fill_no_disk(visitor, folder, monkeypatch):
    monkeypatch.setattr(guard, "_size", lambda folder: serve.SESSIONS * UPLOAD_MIB * 2**20 + 1)
    assert visitor.upload(("a.csv", CSV))[0] == 507


@pytest.mark.parametrize(
    "body", [b"", b"no json", b"[" * 50_000, b'{"data": ', b"\xff\xfe", b"1" * 70_000], ids=lambda body: str(body[:9])
)
def test_malformed_requests_are_refused(visitor, body):
    headers = {"content-type": "application/json"}
    assert visitor.ask("POST", "/gradio_api/queue/join", body, headers)[0] in (400, 413, 422)


def test_requests_of_the_wrong_type_are_refused(visitor):
    for headers in ({"content-type": "application/json"}, {"content-type": "multipart/form-data"}, {}):
        assert visitor.ask("POST", "/gradio_api/upload", CSV, headers)[0] in (400, 422)


def test_a_state_cannot_be_brought(visitor):
    """What was made lies on the server; a request that brings one of its own is answered as if it had none."""
    made = {"textures": [{"samples": [0.0], "sampling_rate": 1}]}
    success, output = visitor.call("download", [made, 0, NPZ])
    assert not success and "no texture yet" in output["error"]


@pytest.mark.parametrize("name", ["../../etc/passwd", "", "exe", {"path": "x"}, None])
def test_a_format_is_no_path(visitor, name):
    if isinstance(name, dict):
        assert visitor.join("download", [None, 0, name])[0] == 403
    else:
        assert not visitor.call("download", [None, 0, name])[0]


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
    success, output = second.call("download", [None, 0, NPZ])
    assert not success and "no texture yet" in output["error"]
    shown = first.call("show", [None, 0, "percentile"])[1]["data"][0]
    second.make(80)
    assert shown == first.call("show", [None, 0, "percentile"])[1]["data"][0]
    assert shown != second.call("show", [None, 0, "percentile"])[1]["data"][0]
    status, _, _ = second.ask("GET", "/gradio_api/queue/status")
    assert status == 200
    assert first.session.encode() not in second.ask("GET", "/config")[1]


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
    assert visit().call("download", [None, 0, NPZ])[1]["error"]  # who comes later is answered


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

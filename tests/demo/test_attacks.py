"""The running demo under attack, by plain HTTP: what the page would never send."""

import contextlib
import json
import os
import re
import socket
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip("gradio")
import app as serve
import guard
from downloads import FORMATS

UPLOAD_MIB = 1
HOW = [2, 5, 2, 1.0, 0, 1.6, 1]  # steps, steps of DALE, order, guidance, seed, seconds, takes
CSV, NPZ = b"0.1\n-0.1\n0.2\n" * 2000, next(name for name in FORMATS if "npz" in name)
META = {"meta": {"_type": "gradio.FileData"}}


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


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have one loopback address")
def test_another_address_of_the_machine_is_not_listened_on(page, port):
    for host, answers in (("127.0.0.1", True), ("127.0.0.2", False)):
        with socket.socket() as asking:
            assert (asking.connect_ex((host, port)) == 0) == answers


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


@pytest.mark.parametrize(
    "content",
    [b"1\n" * 2**19, b"1," * 2**19, b'"' * 2**20, b"\n" * 2**20, b"1" * 2**20, b"\0" * 2**20, b'"1\n' * 2**18],
    ids=lambda content: repr(content[:3]),
)
def test_no_table_of_the_largest_size_takes_long(visitor, content):
    [path] = json.loads(visitor.upload(("a.csv", content))[1])
    begin = time.process_time()
    visitor.call("reconstruct", [{"path": path, **META}, 200_000, 1, "z", *HOW])
    assert time.process_time() - begin < 10


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
            assert visitor.ask("POST", f"/gradio_api/{path}", iter([b"1" * 999] * 9))[0] == 411
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
    success, output = visitor.call("download", [made, 0, NPZ, 0.15])
    assert not success and "no texture yet" in output["error"]


@pytest.mark.parametrize("name", ["../../etc/passwd", "", "exe", {"path": "x"}, None])
def test_a_format_is_no_path(visitor, name):
    if isinstance(name, dict):
        assert visitor.join("download", [None, 0, name, 0.15])[0] == 403
    else:
        assert not visitor.call("download", [None, 0, name, 0.15])[0]

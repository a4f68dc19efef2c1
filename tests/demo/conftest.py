"""What the tests of the demo share: the checkpoint, loaded once; the running page, and visitors without a browser."""

import json
import os
import socket
from http.client import HTTPConnection
from pathlib import Path

import app as serve
import pytest
from downloads import FORMATS
from studio import Studio

NPZ = next(name for name in FORMATS if "npz" in name)
HOW = [2, 5, 2, 1.0, 0, 1.6, 1]  # steps, steps of DALE, order, guidance, seed, seconds, takes


@pytest.fixture(scope="session")
def studio():
    return Studio()


class Visitor:
    """Somebody with a session of his own, and no browser."""

    def __init__(self, port):
        self.port, self.session, self.functions = port, os.urandom(8).hex(), {}
        for function in json.loads(self.ask("GET", "/config")[1])["dependencies"]:
            self.functions.setdefault(function["api_name"], function["id"])

    def ask(self, method, path, body=None, headers=None):
        """Status, body and headers of an answer."""
        connection = HTTPConnection("127.0.0.1", self.port, timeout=30)
        try:
            connection.request(method, path, body, headers or {})
            answer = connection.getresponse()
            return answer.status, answer.read(), dict(answer.getheaders())
        finally:
            connection.close()

    def upload(self, *files):
        """Status and answer; `files` are (name, content)."""
        parts = [
            b'--b\r\nContent-Disposition: form-data; name="files"; filename="%s"\r\n\r\n%s\r\n'
            % (name.encode(), content)
            for name, content in files
        ]
        headers = {"content-type": "multipart/form-data; boundary=b"}
        return self.ask("POST", "/gradio_api/upload", b"".join(parts) + b"--b--\r\n", headers)[:2]

    def join(self, name, values):
        asked = {"data": values, "fn_index": self.functions[name], "session_hash": self.session}
        return self.ask("POST", "/gradio_api/queue/join", json.dumps(asked), {"content-type": "application/json"})

    def call(self, name, values):
        """What a function of the page answers: success, output."""
        status, body, _ = self.join(name, values)
        assert status == 200, body
        _, stream, _ = self.ask("GET", f"/gradio_api/queue/data?session_hash={self.session}")
        messages = (json.loads(line[5:]) for line in stream.splitlines() if line.startswith(b"data:"))
        last = next(message for message in messages if message["msg"] == "process_completed")
        return last["success"], last["output"]

    def download(self):
        """Has the texture of the session written: success, output."""
        return self.call("download", [None, 0, NPZ, 0.15])

    def make(self, percentile):
        """Generates a texture and has it written: path of the file on the server."""
        assert self.call("generate", ["percentile", percentile, 50, 50, False, False, False, *HOW])[0]
        success, written = self.download()
        assert success
        return Path(written["data"][0]["value"][0]["path"])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("uploads")


@pytest.fixture(scope="module")
def port():
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]


@pytest.fixture(scope="module")
def page(studio, folder, port):
    """The running page, in threads of this process."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("GRADIO_TEMP_DIR", str(folder))
        patch.setenv("GRADIO_ANALYTICS_ENABLED", "False")
        page = serve.launch(studio, folder, "127.0.0.1", port)
        yield page
        page.close()


@pytest.fixture(scope="module")
def visit(page, port):
    """A function that gives a new visitor of the page."""
    return lambda: Visitor(port)


@pytest.fixture(scope="session")
def visitor_at():
    return Visitor


@pytest.fixture
def visitor(visit):
    return visit()

"""What the tests of the demo share: the checkpoint, loaded once, and a running page."""

import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from http.client import HTTPConnection
from pathlib import Path
from urllib.parse import urlparse

import pytest
from studio import Studio

DEMO = Path(__file__).parents[2] / "examples" / "demo"
#: Seconds that the page may take to be ready (8 on two idle cores), with room for a busy machine.
LOADS_IN = 90


class Visitor:
    """Somebody with a session of his own, and no browser."""

    def __init__(self, address):
        self.port, self.session, self.functions = urlparse(address).port, os.urandom(8).hex(), {}
        config = json.loads(self.ask("GET", "/config")[1])
        for function in config["dependencies"]:
            self.functions.setdefault(function["api_name"], function)
        values = {one["id"]: one["props"].get("value") for one in config["components"]}
        self.values = {name: [values.get(key) for key in one["inputs"]] for name, one in self.functions.items()}

    def ask(self, method, path, body=None, headers=None):
        """Status and body of an answer."""
        connection = HTTPConnection("127.0.0.1", self.port, timeout=60)
        try:
            connection.request(method, path, body, headers or {})
            answer = connection.getresponse()
            return answer.status, answer.read()
        finally:
            connection.close()

    def upload(self, name, content):
        head = b'--b\r\nContent-Disposition: form-data; name="files"; filename="%s"\r\n\r\n' % name.encode()
        kind = {"content-type": "multipart/form-data; boundary=b"}
        return self.ask("POST", "/gradio_api/upload", head + content + b"\r\n--b--\r\n", kind)

    def call(self, name, values):
        """What a function of the page answers: success, output."""
        asked = {"data": values, "fn_index": self.functions[name]["id"], "session_hash": self.session}
        if not self.functions[name]["queue"]:
            body = json.dumps(asked)
            status, body = self.ask("POST", "/gradio_api/run/predict", body, {"content-type": "application/json"})
            return status == 200, json.loads(body)
        status, body = self.ask(
            "POST", "/gradio_api/queue/join", json.dumps(asked), {"content-type": "application/json"}
        )
        assert status == 200, body
        stream = self.ask("GET", f"/gradio_api/queue/data?session_hash={self.session}")[1]
        messages = (json.loads(line[5:]) for line in stream.splitlines() if line.startswith(b"data:"))
        last = next(message for message in messages if message["msg"] == "process_completed")
        return last["success"], last["output"]

    def move(self, roughness):
        """Moves the first slider: the strip's value."""
        values = list(self.values["live"])
        values[3] = roughness
        success, output = self.call("live", values)
        assert success, output
        return json.loads(output["data"][0])


@pytest.fixture(scope="session")
def visitor_at():
    return Visitor


@pytest.fixture(scope="session")
def studio():
    return Studio()


@pytest.fixture(scope="session")
def server(tmp_path_factory):
    """Address of a running `app.py` with an adapted checkpoint; when it ends, what it wrote must be gone."""
    from tactile_diffusers import bundled_checkpoint

    folder = tmp_path_factory.mktemp("server")
    (folder / "mine").symlink_to(bundled_checkpoint())
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [sys.executable, DEMO / "app.py", "--port", str(port), "--surfaces", folder / "mine"]
    log, begin = folder / "log", time.monotonic()
    with log.open("w") as file:
        process = subprocess.Popen(command, stdout=file, stderr=file, env={**os.environ, "TMPDIR": str(folder)})
    try:
        while "ready at" not in log.read_text():
            assert process.poll() is None and time.monotonic() < begin + LOADS_IN, log.read_text()
            time.sleep(0.1)
        print(f"the server is ready after {time.monotonic() - begin:.1f} s")
        yield re.search(r"http://\S+[0-9]", log.read_text())[0]
    finally:
        process.send_signal(signal.SIGTERM)
        assert process.wait(60) == 0
    assert not list(folder.glob("tactile-app-*")), "temporary files were left behind"

"""What the tests of the demo share: the checkpoint, loaded once, and a running page."""

import os
import re
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
from studio import Studio

DEMO = Path(__file__).parents[2] / "examples" / "demo"
#: Seconds that the page may take to be ready (8 on two idle cores), with room for a busy machine.
LOADS_IN = 90


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

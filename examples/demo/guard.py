"""What the server answers at all: the page's own requests, of bounded size, that name no file but a visitor's.

Gradio serves more than the page needs: calls past the queue, fetching of addresses, recordings, monitoring, links to
states. None of it is wanted here, so what the page asks for is listed, and the rest is not found.
"""

import contextlib
import json
import re
import time
from pathlib import Path

#: Nothing is fetched from elsewhere, whatever gradio would like to. Its own scripts are inline, and compile templates.
CONTENT_POLICY = (
    "default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:; connect-src 'self' data: blob:; form-action 'self'"
)
_HEADERS = [(b"content-security-policy", CONTENT_POLICY.encode()), (b"x-content-type-options", b"nosniff")]
_FILE, _UPLOAD = "/gradio_api/file=", "/gradio_api/upload"
_READ = re.compile(
    r"/|/(config|theme\.css|favicon\.ico|robots\.txt|manifest\.json)/?|/pwa_icon(/\d+)?|/(static|assets|svelte)/.+"
    r"|/gradio_api/(app_id|heartbeat/\w+|info|queue/data|queue/status|startup-events|upload_progress)/?"
)
_WRITE = re.compile(r"/gradio_api/(upload|queue/join|cancel|reset)/?")
#: Files that are taken, bytes of a request without one, and of the frame around one.
SUFFIXES, REQUEST_BYTES, FRAME_BYTES = (".csv", ".wav"), 2**16, 2**13


class Refused(Exception):
    """A request that is not answered: status code and words."""


class Guard:
    """Middleware between gradio and the world.

    Args:
        app: what is guarded.
        folder (`Path`): gradio's folder of temporary files; no other file can be named.
        upload_bytes (`int`): of the largest upload.
        uploads (`int`): as many of the largest lie in the folder at most.
    """

    def __init__(self, app, folder, upload_bytes, uploads):
        self.app, self.folder, self.upload_bytes, self.uploads = app, folder.resolve(), upload_bytes, uploads

    async def __call__(self, scope, receive, send):
        if scope["type"] != "http":
            return await self.app(scope, receive, send)

        async def send_with_policy(message):
            if message["type"] == "http.response.start":
                message["headers"] = [*message.get("headers", []), *_HEADERS]
            await send(message)

        try:
            await self._answer(scope, receive, send_with_policy)
        except Refused as refused:
            status, words = refused.args
            headers = [(b"content-type", b"text/plain; charset=utf-8"), (b"connection", b"close")]
            await send_with_policy({"type": "http.response.start", "status": status, "headers": headers})
            await send_with_policy({"type": "http.response.body", "body": words.encode()})

    async def _answer(self, scope, receive, send):
        path, method = scope["path"], scope["method"]
        if method in ("GET", "HEAD"):
            if not (self._is_ours(path.removeprefix(_FILE)) if path.startswith(_FILE) else _READ.fullmatch(path)):
                raise Refused(404, "Not found.")
            return await self.app(scope, receive, send)
        if method != "POST" or not _WRITE.fullmatch(path):
            raise Refused(404, "Not found.")
        if path.startswith(_UPLOAD):
            _check_length(scope, self.upload_bytes + FRAME_BYTES)
            return await self._upload(scope, receive, send)
        _check_length(scope, REQUEST_BYTES)
        body = self._checked(await _body(receive))
        pending = iter([{"type": "http.request", "body": body, "more_body": False}])

        async def receive_checked():
            return next(pending, None) or await receive()

        await self.app(scope, receive_checked, send)

    def _is_ours(self, path):
        """Whether a path is that of a file that a visitor brought or had made: each has a folder of its own."""
        try:
            return Path(path).resolve().parent.parent == self.folder
        except (OSError, ValueError):
            return False

    def _checked(self, body):
        """The request without addresses, which gradio might fetch.

        Raises:
            Refused: if it names a file of somebody else, or is no JSON.
        """

        def check(value):
            if isinstance(value, dict):
                if isinstance(value.get("path"), str) and not self._is_ours(value["path"]):
                    raise Refused(403, "No such upload.")
                return {key: check(inner) for key, inner in value.items() if key != "url"}
            return [check(inner) for inner in value] if isinstance(value, list) else value

        try:
            return json.dumps(check(json.loads(body))).encode()
        except (ValueError, RecursionError) as error:
            raise Refused(400, "No valid request.") from error

    async def _upload(self, scope, receive, send):
        """An upload, whose answer is held until it is seen what was brought."""
        if _size(self.folder) > self.uploads * self.upload_bytes:
            raise Refused(507, "Too many files are being used: try again in some minutes.")
        held = []

        async def hold(message):
            held.append(message)

        await self.app(scope, receive, hold)
        if held[0]["status"] == 200:
            brought = [Path(path) for path in json.loads(b"".join(message.get("body", b"") for message in held))]
            wrong = [path for path in brought if path.suffix.lower() not in SUFFIXES]
            for path in wrong:
                with contextlib.suppress(OSError):  # "." makes gradio name a folder
                    path.unlink()
            if wrong:
                raise Refused(415, f"Only {' and '.join(SUFFIXES)} files are taken.")
        for message in held:
            await send(message)


def _check_length(scope, most):
    length = dict(scope["headers"]).get(b"content-length", b"")
    if not length.isdigit():
        raise Refused(411, "The length of the request must be told.")
    if int(length) > most:
        raise Refused(413, f"The request exceeds the maximum allowed size of {most} bytes.")


async def _body(receive):
    """All of a request; the server holds it to the length that was told."""
    body, more = b"", True
    while more:
        message = await receive()
        body += message.get("body", b"")
        more = message.get("more_body", False)
    return body


def _size(folder):
    """Bytes in a folder, while others write into it and remove from it."""
    size = 0
    for path in folder.rglob("*"):
        with contextlib.suppress(OSError):
            size += path.lstat().st_size
    return size


def clean(folder, age):
    """Removes what lies in a folder for more than `age` seconds: also what gradio forgets, such as half uploads."""
    for path in sorted(folder.rglob("*"), reverse=True):  # files before their folders
        with contextlib.suppress(OSError):  # somebody was quicker, or a folder is not empty
            if time.time() - path.lstat().st_ctime > age:
                path.rmdir() if path.is_dir() else path.unlink()

"""`python examples/demo/app.py`: a page, on this machine, to try ratings, see and hear textures and take them away."""

import errno
import ipaddress
import os
import signal
import socket
import sys
import tempfile
import threading
import time
from pathlib import Path

from guard import Guard, clean

from tactile_diffusers.cli.program import Parser, program, refuse

#: Visitors at a time whose last result (a few megabytes) and recording are kept, and requests that may wait.
SESSIONS, WAITING = 50, 20
#: Seconds after which a file of a visitor is deleted, and between two looks for such files.
FILE_SECONDS, CLEANING_SECONDS = 900, 300


def parse_arguments(argv=None):
    """Arguments of the command.

    Raises:
        SystemExit: on bad arguments, with exit code 2 and a line that says what is wrong.
    """
    parser = Parser(prog=program("app.py"), description="Ratings to textures in a browser, without internet.")
    parser.add_argument("--checkpoint", type=Path, metavar="FOLDER", help="default: the bundled checkpoint")
    parser.add_argument(
        "--host", default="127.0.0.1", help="address to listen on; default: 127.0.0.1, this machine only"
    )
    parser.add_argument("--port", type=int, default=7860, help="default: 7860")
    parser.add_argument("--max_upload_mib", type=int, default=8, metavar="N", help="largest recording; default: 8")
    arguments = parser.parse_args(argv)
    if arguments.checkpoint is not None and not arguments.checkpoint.is_dir():
        parser.error(f"argument --checkpoint: {arguments.checkpoint} is not a folder")
    if not 1 <= arguments.port <= 65535:
        parser.error(f"argument --port: must be between 1 and 65535, got {arguments.port}")
    if not 1 <= arguments.max_upload_mib <= 1024:
        parser.error(f"argument --max_upload_mib: must be between 1 and 1024, got {arguments.max_upload_mib}")
    return arguments


def main(argv=None):
    """Runs the command until it is stopped.

    Returns:
        `int`: 0; or 2 if gradio is missing, the checkpoint cannot be used or the port is taken (one line on stderr).
    """
    arguments = parse_arguments(argv)
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # stopped in whatever way, the folder is removed
    with tempfile.TemporaryDirectory(prefix="tactile-app-") as folder:
        # before gradio is imported: uploads and files to take away lie there
        os.environ["GRADIO_TEMP_DIR"] = folder
        os.environ["GRADIO_ANALYTICS_ENABLED"] = "False"
        os.environ["HF_HUB_OFFLINE"] = "1"
        try:
            _serve(arguments, Path(folder))
        except ImportError as error:
            return _refuse(f'{error}. Install what the page needs: pip install "tactile-diffusers[demo]"')
        except (ValueError, OSError) as error:
            return _refuse(error)
        except KeyboardInterrupt:
            pass
    return 0


def _refuse(reason):
    return refuse("app.py", reason)


def _check_port(host, port):
    """Before the checkpoint is loaded; what else is wrong with an address, gradio says.

    Raises:
        ValueError: if another program listens there.
    """
    with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as asking:
        asking.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # as the server does: one that ended is no bar
        try:
            asking.bind((host, port))
        except OSError as error:
            if error.errno == errno.EADDRINUSE:
                raise ValueError(f"port {port} is in use; give --port") from error


def _serve(arguments, folder):
    _check_port(arguments.host, arguments.port)
    from diffusers.utils import logging
    from studio import Studio

    logging.disable_progress_bar()
    page = launch(Studio(arguments.checkpoint), folder, arguments.host, arguments.port, arguments.max_upload_mib)
    print(f"ready at {page.local_url} (Ctrl+C stops it)", flush=True)
    if not _is_loopback(arguments.host):
        print("Whoever reaches this machine reaches the page: it has no password.", flush=True)
    page.block_thread()


def launch(studio, folder, host, port, upload_mib):
    """Serves the page from threads of its own, and keeps the folder clean.

    Args:
        studio ([`Studio`]): answers.
        folder (`Path`): where the environment variable `GRADIO_TEMP_DIR` points.
        host (`str`), port (`int`): to listen on.
        upload_mib (`int`): largest recording.

    Returns:
        `gradio.Blocks`: `close()` ends it.
    """
    import gradio as gr
    from page import CSS, HEAD, build
    from starlette.middleware import Middleware

    page = build(studio, folder)
    page.queue(max_size=WAITING, default_concurrency_limit=1)
    font, mono = (gr.themes.utils.fonts.Font(name) for name in ("sans-serif", "monospace"))  # others are fetched
    theme = gr.themes.Default(primary_hue="blue", font=[font], font_mono=[mono])
    theme.set(block_info_text_color="*neutral_600", block_info_text_color_dark="*neutral_300")  # readable, not pale
    guard = Middleware(Guard, folder=folder, upload_bytes=upload_mib * 2**20, uploads=SESSIONS)
    page.launch(
        server_name=host,
        server_port=port,
        share=False,
        ssr_mode=False,
        theme=theme,
        css=CSS,
        head=HEAD,
        max_file_size=f"{upload_mib}mb",
        state_session_capacity=SESSIONS,
        footer_links=[],
        app_kwargs={"middleware": [guard]},
        prevent_thread_lock=True,
        quiet=True,
    )
    threading.Thread(target=_keep_clean, args=(page, folder), daemon=True).start()
    return page


def _keep_clean(page, folder):
    while page.is_running:
        clean(folder, FILE_SECONDS)
        time.sleep(CLEANING_SECONDS)


def _is_loopback(host):
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


if __name__ == "__main__":
    sys.exit(main())

"""A page to try ratings, see and hear textures and take them away: `python examples/demo/app.py`.

The folder also works as a Hugging Face Space, see README.md.
"""

import os
import signal
import sys
import tempfile
from pathlib import Path

from tactile_diffusers.cli.program import Parser, add_checkpoint_argument, refuse

#: Visitors at a time whose last result (a few megabytes) is kept, requests that may wait, and that share one call.
SESSIONS, WAITING, AT_ONCE = 50, 20, 8
#: Files of visitors are deleted after these seconds, s.
FILE_SECONDS, CLEANING_SECONDS = 900, 300
UPLOAD_MIB = 8


def parse_arguments(argv=None):
    """Arguments of the command; bad ones end it with exit code 2 and a line that names the argument."""
    parser = Parser(prog="app.py", description="Ratings to textures in a browser, without internet.")
    add_checkpoint_argument(parser)
    host = os.environ.get("GRADIO_SERVER_NAME", "127.0.0.1")  # a Space sets it
    parser.add_argument("--host", default=host, help="to listen on; default: 127.0.0.1, this machine only")
    parser.add_argument("--surfaces", nargs="+", default=[], metavar="FOLDER", help="adapted checkpoints to compare")
    port = int(os.environ.get("GRADIO_SERVER_PORT", 7860))
    parser.add_argument("--port", type=int, default=port, help="default: 7860")
    arguments = parser.parse_args(argv)
    if not 1 <= arguments.port <= 65535:
        parser.error(f"argument --port: must be between 1 and 65535, got {arguments.port}")
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
        try:
            page = _launch(arguments, Path(folder))
            print(f"ready at {page.local_url} (Ctrl+C stops it)", flush=True)
            if arguments.host not in ("127.0.0.1", "localhost", "::1"):
                print("Everyone who reaches this machine can use the page: it has no password.", flush=True)
            page.block_thread()
        except ImportError as error:
            return refuse("app.py", f'{error}. Install what the page needs: pip install "tactile-diffusers[demo]"')
        except (ValueError, OSError) as error:
            return refuse("app.py", error)
        except KeyboardInterrupt:
            pass
    return 0


def _launch(arguments, folder):
    """The page, served from threads of its own."""
    import gradio as gr
    import torch
    from diffusers.utils import logging
    from page import CSS, build
    from strip import PARTS
    from studio import Studio

    torch.set_num_threads(1)  # the networks are small: several threads wait for each other longer than they work
    logging.disable_progress_bar()
    studio = Studio(arguments.checkpoint, arguments.surfaces)
    page = build(studio, folder, delete_cache=(CLEANING_SECONDS, FILE_SECONDS))
    page.queue(max_size=WAITING, default_concurrency_limit=AT_ONCE)
    font, mono = (gr.themes.utils.fonts.Font(name) for name in ("sans-serif", "monospace"))  # others are fetched
    theme = gr.themes.Default(primary_hue="blue", font=[font], font_mono=[mono])
    theme.set(block_info_text_color="*neutral_600", block_info_text_color_dark="*neutral_300")  # readable, not pale
    theme.set(button_primary_background_fill="*primary_700", button_primary_background_fill_dark="*primary_700")
    page.launch(
        server_name=arguments.host,
        server_port=arguments.port,
        share=False,
        ssr_mode=False,
        theme=theme,
        head=f"<style>{CSS}{PARTS['style']}</style>",
        allowed_paths=[],
        max_file_size=f"{UPLOAD_MIB}mb",
        state_session_capacity=SESSIONS,
        footer_links=[],
        prevent_thread_lock=True,
        quiet=True,
    )
    return page


if __name__ == "__main__":
    sys.exit(main())

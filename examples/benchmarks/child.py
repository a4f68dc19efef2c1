"""Code in a fresh process, for what one process can measure only once: its peak memory, its first call."""

import platform
import subprocess
import sys

#: not getrusage: on Linux a child's maximum begins at its parent's
_PEAK = "print(open('/proc/self/status').read().split('VmHWM:')[1].split()[0])"


def run_child(code, *arguments):
    """Runs Python code in a fresh process.

    Args:
        code (`str`): it sees `arguments` in `sys.argv[1:]`.
        arguments (`str`).

    Returns:
        `tuple[str, float | None]`: what it printed, and its peak resident memory in MiB; `None` anywhere but on Linux.

    Raises:
        RuntimeError: if it fails, with the end of what it wrote to stderr.
    """
    linux = platform.system() == "Linux"
    code = f"{code}\n{_PEAK if linux else 'print(0)'}"
    done = subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"A process that was measured failed with {done.returncode}:\n{done.stderr[-2000:]}")
    *printed, kibibytes = done.stdout.splitlines()
    return "\n".join(printed), int(kibibytes) / 2**10 if linux else None

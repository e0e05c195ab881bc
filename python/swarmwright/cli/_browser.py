"""Open a file in the browser of the person at this machine."""

import os
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

PATIENCE_S = 5.0
"""Seconds to wait for a browser that stays in the foreground; it is left running."""
_PROGRAM = "import sys, webbrowser; sys.exit(not webbrowser.open(sys.argv[1]))"


def has_display() -> bool:
    """Whether a person would see a window of this process: not in CI, nor over SSH without a display."""
    display = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    return bool(display) and os.environ.get("CI", "").lower() in {"", "0", "false"}


def open_in_browser(file: Path) -> bool:
    """Open a file in a browser, where there is a display; return False where that is not possible.

    `webbrowser` runs in a process of its own without this terminal: browsers print warnings, some of them
    stay in the foreground, and browsers for text would take the terminal. Ctrl-C does not close the browser.
    """
    if not has_display():
        return False
    environment = {name: value for name, value in os.environ.items() if name != "TERM"}
    with suppress(OSError):
        process = subprocess.Popen(
            [sys.executable, "-I", "-c", _PROGRAM, file.absolute().as_uri()],
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        try:
            return process.wait(PATIENCE_S) == 0
        except subprocess.TimeoutExpired:
            process.returncode = 0  # not ours to wait for: without this, Python would warn of it
            return True
    return False

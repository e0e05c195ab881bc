"""Progress in notebooks: a text below the cell that is replaced as the work goes on."""

import sys
import time
from typing import Any

from swarmwright.common.untrusted import one_line

INTERVAL_S = 0.25
"""Seconds between two changes."""


def in_notebook() -> bool:
    """Whether this process is the kernel of a notebook."""
    ipython = sys.modules.get("IPython")
    if ipython is None or "ipykernel" not in sys.modules:
        return False
    return hasattr(ipython.get_ipython(), "kernel")


class Text:
    """A text that can be replaced: below the cell in a notebook, else a line on standard error."""

    def __init__(self) -> None:
        self._handle: Any = None
        self._notebook = in_notebook()
        self._shown = 0.0
        self._width = 0

    def show(self, text: str, *, at_once: bool = False) -> None:
        """Show a text instead of the last one, unless that was just now and this is not the last."""
        now = time.monotonic()
        if not at_once and now - self._shown < INTERVAL_S:
            return
        self._shown = now
        text = one_line(text)
        if not self._notebook:
            sys.stderr.write("\r" + text.ljust(self._width))
            sys.stderr.flush()
            self._width = len(text)
            return
        content = {"text/plain": text}
        if self._handle is None:
            from IPython.display import display  # noqa: PLC0415 - only in notebooks

            self._handle = display(  # type: ignore[no-untyped-call]
                content, raw=True, display_id=True
            )
        else:
            self._handle.update(content, raw=True)

    def close(self) -> None:
        """End the line where it is one."""
        if not self._notebook and self._width:
            sys.stderr.write("\n")

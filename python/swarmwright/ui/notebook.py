"""The window in a notebook: in this process's background, shown in a frame."""

import atexit
import os
import secrets
import threading
from collections.abc import Collection, Sequence
from html import escape
from pathlib import Path

from swarmwright.common.errors import InputError
from swarmwright.ui.index import STORE
from swarmwright.ui.server import Settings, Window

LOOPBACK = ("http://localhost:*", "http://127.0.0.1:*")
"""Origins of notebooks on this machine, or reached by `ssh -L`."""
HEIGHT = 800
END_S = 5.0


class NotebookWindow:
    """A window that this process serves in a thread; notebooks show it in a frame.

    Its token is a new one for each window: a notebook is saved with the address of the frame, which is of no
    use after the process has ended.

    Attributes:
        address: for a tab of the browser on this machine.

    Args:
        folder: whose runs are shown.
        settings: how it is reached.
        base: address under which a browser reaches it; empty for 127.0.0.1 and its port.
    """

    def __init__(self, folder: Path, settings: Settings, base: str) -> None:
        self.folder = folder
        self._page = "#/run/." if (folder / STORE).is_file() else ""
        self._base = base
        self._window = Window(folder, settings)
        self._thread = threading.Thread(target=self._window.run, name="swarmwright ui", daemon=True)
        self._thread.start()

    @property
    def address(self) -> str:
        """The address with its token. Anyone who has it sees these runs."""
        return f"{self._window.address}{self._page}"

    @property
    def is_open(self) -> bool:
        """Whether the window is served."""
        return self._thread.is_alive()

    def close(self) -> None:
        """Stop serving it."""
        self._window.end()
        self._thread.join(END_S)

    def _repr_html_(self) -> str:
        """Return a frame with the window, for notebooks.

        The token is in the path: browsers keep no cookies of a frame on another site, as which `localhost`
        and `127.0.0.1` count.
        """
        base = (
            self._base.replace("{port}", str(self._window.port)) or f"http://127.0.0.1:{self._window.port}/"
        )
        address = f"{base.rstrip('/')}/~{self._window.token}/{self._page}"
        return (
            f'<iframe src="{escape(address)}" title="Swarmwright" width="100%" height="{HEIGHT}" '
            'frameborder="0" allowfullscreen></iframe>'
        )

    def __repr__(self) -> str:
        """Return folder and address."""
        return f"<Swarmwright on {self.folder}: {self.address if self.is_open else 'closed'}>"


_windows: dict[tuple[object, ...], NotebookWindow] = {}
_lock = threading.Lock()


def show(
    folder: str | os.PathLike[str],
    *,
    read_only: bool = True,
    frame_ancestors: str | Sequence[str] = LOOPBACK,
    base: str = "",
    hosts: Collection[str] = (),
) -> NotebookWindow:
    """Show the runs below a folder in a window that this process serves, until `close` or its end.

    In a notebook, the result shows itself as a frame; elsewhere, open its `address`. A folder has one window:
    the next call returns the same.

    Args:
        folder: of runs, or of a single one.
        read_only: refuse what changes or starts a run.
        frame_ancestors: origins of the pages that may show the window in a frame, as
            `https://hub.example`. Default: `http://localhost:*` and `http://127.0.0.1:*`.
        base: address under which the browser reaches it, if that is not this machine: with
            jupyter-server-proxy on a hub `/user/ada/proxy/{port}/`, where `{port}` is replaced.
        hosts: with `base`, names of the host in the browser's address.

    Raises InputError when the folder does not exist, an origin is none, or the libraries of the extra `ui`
    are missing.
    """
    path = Path(folder)
    if not path.is_dir():
        raise InputError(f"folder: {path} is not a folder")
    ancestors = (frame_ancestors,) if isinstance(frame_ancestors, str) else tuple(frame_ancestors)
    if base:  # a frame of the same origin
        ancestors = ("'self'", *ancestors)
    settings = Settings(
        port=0,
        token=secrets.token_urlsafe(24),
        hosts=tuple(hosts),
        read_only=read_only,
        frame_ancestors=ancestors,
    )
    key = (path.resolve(), read_only, ancestors, base, tuple(hosts))
    with _lock:
        window = _windows.get(key)
        if window is None or not window.is_open:
            window = _windows[key] = NotebookWindow(path.resolve(), settings, base)
    return window


@atexit.register
def close_windows() -> None:
    """Stop serving all windows of this process."""
    for window in _windows.values():
        window.close()

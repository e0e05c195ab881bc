"""The server of the window: its port, its address, its token."""

import os
import secrets
import socket
import stat
from collections.abc import Callable, Collection
from pathlib import Path

from swarmwright.common.errors import InputError
from swarmwright.common.files import state_folder
from swarmwright.experiment.broker_address import DEFAULT_BROKER

PORT = 8501
ATTEMPTS = 20
"""Ports after the first that are tried, unless one is given."""


CHARTS = Path(__file__).parent / "static" / "vendor" / "uPlot.esm.js"
"""The library that draws charts; wheels have it, a clone gets it by `make ui`."""


def missing_library() -> str | None:
    """Return what to install where the libraries of the window are missing."""
    try:
        import starlette
        import uvicorn
    except ImportError as error:
        return f"swarmwright ui needs {error.name}; install it with pip install 'swarmwright[ui]'"
    del starlette, uvicorn
    return None if CHARTS.is_file() else f"{CHARTS}: is missing; `make ui` fetches it"


def read_token() -> str:
    """Return this user's token: the same at each start, so that an address stays what it is.

    It is in `ui-token` in the state folder. A file that others can read or write is not trusted; where none
    can be kept, the token is a new one.
    """
    new = secrets.token_urlsafe(24)
    folder = state_folder()
    if folder is None:
        return new
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        file = folder / "ui-token"
        try:
            descriptor = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        except FileExistsError:
            descriptor = os.open(file, os.O_RDONLY | os.O_NOFOLLOW)
            with os.fdopen(descriptor, "rb") as stored:
                status = os.fstat(descriptor)
                token = stored.read(100).decode("ascii").strip()
            is_private = stat.S_ISREG(status.st_mode) and not status.st_mode & 0o077
            return token if is_private and status.st_uid == os.getuid() and len(token) >= len(new) else new
        with os.fdopen(descriptor, "w", encoding="ascii") as stored:
            stored.write(new)
    except (OSError, ValueError):
        pass
    return new


def listen(host: str, port: int | None) -> socket.socket:
    """Return a listening socket. Raises InputError when the port is taken or the host is not here."""
    ports = range(PORT, PORT + ATTEMPTS) if port is None else (port,)
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    for candidate in ports:
        listener = socket.socket(family, socket.SOCK_STREAM)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind((host, candidate))
            listener.listen(128)
        except OSError as error:
            listener.close()
            reason = error.strerror or str(error)
        else:
            return listener
    ports_text = f"ports {ports[0]} to {ports[-1]}" if len(ports) > 1 else f"--port {ports[0]}"
    raise InputError(f"{ports_text}: the window cannot listen on {host}: {reason}")


def serve(
    folder: Path,
    *,
    host: str = "127.0.0.1",
    port: int | None = None,
    token: str | None = None,
    hosts: Collection[str] = (),
    read_only: bool = False,
    broker: str = DEFAULT_BROKER,
    prefix: str = "",
    on_ready: Callable[[str], object],
) -> None:
    """Show the runs below a folder in browsers, until SIGINT or SIGTERM.

    Args:
        folder: that exists; runs may come later.
        host: address to listen on, of loopback.
        port: to listen on, 0 for a free one; default: the first free one from 8501 on.
        token: secret of the address; default: that of this user.
        hosts: other names by which it is reached, as behind a proxy.
        read_only: refuse what changes something.
        broker: address of the broker whose servers are shown first.
        prefix: of its topics.
        on_ready: called with the address, token included, when it listens.

    Raises InputError when it cannot listen or a library is missing.
    """
    missing = missing_library()
    if missing is not None:
        raise InputError(missing)
    import uvicorn

    from swarmwright.ui.app import create_app

    token = token or read_token()
    with listen(host, port) as listener:
        actual = listener.getsockname()[1]
        app = create_app(
            folder,
            token=token,
            port=actual,
            hosts=hosts,
            read_only=read_only,
            broker=broker,
            prefix=prefix,
        )
        configuration = uvicorn.Config(
            app,
            log_level="warning",
            access_log=False,
            server_header=False,
            ws="none",
            timeout_graceful_shutdown=1,
            limit_concurrency=200,
        )
        shown = f"[{host}]" if ":" in host else host
        on_ready(f"http://{shown}:{actual}/?token={token}")
        uvicorn.Server(configuration).run(sockets=[listener])

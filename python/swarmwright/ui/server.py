"""The server of the window: its port, its address, its token."""

import ipaddress
import os
import secrets
import socket
import ssl
import stat
from collections.abc import Callable, Collection
from dataclasses import dataclass
from pathlib import Path

from swarmwright.common.errors import InputError
from swarmwright.common.files import state_folder
from swarmwright.common.processes import allow_more_open_files
from swarmwright.experiment.broker_address import DEFAULT_BROKER

PORT = 8501
ATTEMPTS = 20
"""Ports after the first that are tried, unless one is given."""
MOST_CONNECTIONS = 500


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
    raise InputError(f"{ports_text}: the window cannot listen on {host}: {reason}; choose another --port")


@dataclass(frozen=True, kw_only=True)
class Settings:
    """How a window is reached, and what it may do.

    Attributes:
        host: address to listen on.
        port: to listen on, 0 for a free one; None: the first free one from 8501 on.
        token: secret of the address; None: that of this user.
        hosts: other names by which it is reached, as behind a proxy.
        read_only: refuse what changes something.
        broker: address of the broker whose servers are shown first.
        prefix: of its topics.
        certificate: PEM file for TLS.
        key: of the certificate.
        password_file: its first line is a password, which takes the place of the token.
        frame_ancestors: origins of pages that may show the window in a frame.
    """

    host: str = "127.0.0.1"
    port: int | None = None
    token: str | None = None
    hosts: Collection[str] = ()
    read_only: bool = False
    broker: str = DEFAULT_BROKER
    prefix: str = ""
    certificate: Path | None = None
    key: Path | None = None
    password_file: Path | None = None
    frame_ancestors: Collection[str] = ()


class Window:
    """A window that listens; `run` shows it.

    Attributes:
        token: secret of its address; empty where it asks for a password.
        port: that it listens on.
        address: for browsers, with the token.

    Args:
        folder: that exists; runs may come later.
        settings: how it is reached.

    Raises InputError when it cannot listen, a library is missing, or other machines would reach it without
    password and TLS.
    """

    def __init__(self, folder: Path, settings: Settings) -> None:
        missing = missing_library()
        if missing is not None:
            raise InputError(missing)
        check_exposure(settings)
        import uvicorn

        from swarmwright.ui.app import create_app
        from swarmwright.ui.protocol import Connection, Server
        from swarmwright.ui.sessions import Sessions, read_password_file

        sessions = None
        if settings.password_file is not None:
            sessions = Sessions(read_password_file(settings.password_file))
        self.token = "" if sessions else settings.token or read_token()
        allow_more_open_files()
        self._listener = listen(settings.host, settings.port)
        try:
            self.port = self._listener.getsockname()[1]
            app = create_app(
                folder,
                token=self.token or None,
                sessions=sessions,
                port=self.port,
                hosts=settings.hosts,
                is_public=not is_loopback(settings.host),
                ancestors=settings.frame_ancestors,
                read_only=settings.read_only,
                broker=settings.broker,
                prefix=settings.prefix,
            )
        except InputError:
            self._listener.close()
            raise
        configuration = uvicorn.Config(
            app,
            http=Connection,
            log_level="error",
            access_log=False,
            server_header=False,
            ws="none",
            timeout_graceful_shutdown=1,
            limit_concurrency=MOST_CONNECTIONS,
            ssl_certfile=settings.certificate,
            ssl_keyfile=settings.key,
        )
        self._server = Server(configuration, app.state.window.end_events)
        self._scheme = "http" if settings.certificate is None else "https"
        self._host = settings.host

    @property
    def address(self) -> str:
        """The address for browsers of this machine, or of others where it listens for those."""
        host = socket.gethostname() if self._host in {"0.0.0.0", "::"} else self._host  # noqa: S104
        shown = f"[{host}]" if ":" in host else host
        return f"{self._scheme}://{shown}:{self.port}/" + (f"?token={self.token}" if self.token else "")

    def run(self) -> None:
        """Answer until `end`, or in the main thread until SIGINT or SIGTERM."""
        with self._listener:
            self._server.run(sockets=[self._listener])

    def end(self) -> None:
        """Let `run` return."""
        self._server.should_exit = True


def serve(folder: Path, settings: Settings, *, on_ready: Callable[[str], object]) -> None:
    """Show the runs below a folder in browsers, until SIGINT or SIGTERM.

    on_ready: called with the address, including the token, once the server listens.

    Raises InputError as `Window` does.
    """
    window = Window(folder, settings)
    on_ready(window.address)
    window.run()


def is_loopback(host: str) -> bool:
    """Whether an address is reached from this machine alone; other names than `localhost` are not."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def check_exposure(settings: Settings) -> None:
    """Refuse to be reached by other machines without password and TLS, and a certificate that is none."""
    options = {
        "--password-file FILE": settings.password_file,
        "--certificate FILE": settings.certificate,
        "--key FILE": settings.key,
    }
    missing = [option for option, value in options.items() if value is None]
    if missing and not is_loopback(settings.host):
        raise InputError(
            f"--host {settings.host}: other machines reach the window only with a password and TLS; add "
            f"{' and '.join(missing)}, or leave --host out and use ssh -L"
        )
    if settings.certificate is None and settings.key is None:
        return
    if settings.certificate is None or settings.key is None:
        raise InputError(f"TLS needs both --certificate and --key; {missing[-1]} is missing")

    def refuse() -> str:  # otherwise OpenSSL asks on the terminal
        raise InputError(
            f"--key {settings.key}: has a passphrase; use a key without one "
            "(`openssl pkey -in FILE -out FILE` removes it)"
        )

    try:
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(settings.certificate, settings.key, password=refuse)
    except OSError as error:  # ssl.SSLError is one
        raise InputError(
            f"--certificate {settings.certificate}, --key {settings.key}: cannot be used: "
            f"{error.strerror or error}"
        ) from None

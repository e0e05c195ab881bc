"""The server of the window: its port, its address, its token."""

import contextlib
import errno
import ipaddress
import logging
import os
import re
import secrets
import socket
import ssl
import stat
from collections.abc import Callable, Collection
from dataclasses import dataclass
from pathlib import Path

from swarmwright.common.errors import InputError
from swarmwright.common.files import make_private_folder, state_folder
from swarmwright.common.processes import allow_more_open_files
from swarmwright.experiment.broker_address import DEFAULT_BROKER

PORT = 8501
ATTEMPTS = 20
"""Ports after the first that are tried, unless one is given."""
MOST_CONNECTIONS = 500
TOKEN_BYTES = 24
TOKEN = re.compile(r"[A-Za-z0-9_-]{32,100}")

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

    It is in `ui-token` in the state folder. One that others could read or write is replaced; where none can
    be kept, each start has a token of its own.
    """
    folder = state_folder()
    if folder is None:
        return secrets.token_urlsafe(TOKEN_BYTES)
    file = folder / "ui-token"
    former = read_kept_token(file)
    if former is not None:
        return former
    token = secrets.token_urlsafe(TOKEN_BYTES)
    part = folder / f".ui-token-{secrets.token_hex(8)}"
    try:
        make_private_folder(folder)
        try:
            with os.fdopen(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as stream:
                stream.write(token)
            part.replace(file)
        finally:
            part.unlink(missing_ok=True)
    except OSError as error:
        logging.getLogger("swarmwright").warning(
            "%s: cannot be written: %s; this address is valid until the window ends", file, error.strerror
        )
    return token


def read_kept_token(file: Path) -> str | None:
    """Return the token in a file that only this user can read or write; None where there is no such file."""
    try:
        descriptor = os.open(file, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    except OSError:
        return None
    try:
        status = os.fstat(descriptor)
        if not stat.S_ISREG(status.st_mode) or status.st_mode & 0o077 or status.st_uid != os.getuid():
            return None
        token = os.read(descriptor, 101).decode("latin-1").strip()
    finally:
        os.close(descriptor)
    return token if TOKEN.fullmatch(token) else None


def listen(host: str, port: int | None) -> socket.socket:
    """Return a listening socket. Raises InputError, with the option that helps, where there can be none."""
    ports = range(PORT, PORT + ATTEMPTS) if port is None else (port,)
    for candidate in ports:
        with contextlib.ExitStack() as stack:
            try:
                family = socket.AF_INET6 if ":" in host else socket.AF_INET
                listener = stack.enter_context(socket.socket(family, socket.SOCK_STREAM))
                listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                listener.bind((host, candidate))
                listener.listen(128)
            except (OSError, ValueError) as error:  # ValueError: of a name that is none
                if getattr(error, "errno", None) == errno.EADDRINUSE:
                    continue
                raise InputError(explain_refusal(host, candidate, error)) from None
            stack.pop_all()
            return listener
    if port is None:
        raise InputError(f"ports {ports[0]} to {ports[-1]} are taken; choose another port with --port")
    raise InputError(f"--port {port}: is taken; choose another port, or leave --port out")


def explain_refusal(host: str, port: int, error: OSError | ValueError) -> str:
    """Return why it is not possible to listen at an address, and the option that helps."""
    code = getattr(error, "errno", None)
    if code == errno.EACCES:
        return f"--port {port}: this user may not listen there; choose one from 1024 on"
    if code == errno.EADDRNOTAVAIL:
        return f"--host {host}: is not an address of this machine; choose one that is, or leave --host out"
    if isinstance(error, socket.gaierror | ValueError):
        return f"--host {host[:200]!r}: is not known; choose an address of this machine, or leave --host out"
    return f"--host {host}, --port {port}: cannot be used: {error.strerror or error}"


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
            address, self.port = self._listener.getsockname()[:2]
            self._host = settings.host
            if ipaddress.ip_address(address).is_unspecified:
                self._host = [*settings.hosts, socket.gethostname()][0]
            app = create_app(
                folder,
                token=self.token or None,
                sessions=sessions,
                port=self.port,
                hosts=[*settings.hosts, self._host],
                is_public=not is_loopback(settings.host),
                ancestors=settings.frame_ancestors,
                read_only=settings.read_only,
                broker=settings.broker,
                prefix=settings.prefix,
            )
        except BaseException:
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

    @property
    def address(self) -> str:
        """The address for browsers of this machine, or of others where it listens for those."""
        host = f"[{self._host}]" if ":" in self._host else self._host
        return f"{self._scheme}://{host}:{self.port}/" + (f"?token={self.token}" if self.token else "")

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

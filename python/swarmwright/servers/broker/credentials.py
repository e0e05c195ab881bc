"""The password of the broker's account from the system's keyring, where environment and file have none.

https://keyring.readthedocs.io; `pip install 'swarmwright[keyring]'`. The order: SWARMWRIGHT_PASSWORD, then
SWARMWRIGHT_PASSWORD_FILE, then the keyring, for the user of SWARMWRIGHT_USERNAME.
"""

import errno
import ipaddress
import logging
import os
import re
from pathlib import Path

from swarmwright.common.errors import InputError

SERVICE = "swarmwright"
"""Under this name the keyring has the passwords, of `USER@HOST:PORT` (`USER@PATH` for a Unix socket) or, for
every broker, of `USER`."""

CREDENTIALS = (
    "SWARMWRIGHT_USERNAME",
    "SWARMWRIGHT_PASSWORD",
    "SWARMWRIGHT_PASSWORD_FILE",
    "SWARMWRIGHT_CA_FILE",
    "SWARMWRIGHT_CERTIFICATE_FILE",
    "SWARMWRIGHT_KEY_FILE",
)
"""Environment variables of what a client needs to be admitted by a broker."""
_KEEP_ALIVE = "SWARMWRIGHT_KEEP_ALIVE"
_LONGEST_KEEP_ALIVE_S = 3600

_LOGGER = logging.getLogger("swarmwright")
_warned: set[str] = set()

_PORTS = {"mqtt": 1883, "tcp": 1883, "mqtts": 8883, "ssl": 8883, "tls": 8883, "ws": 80, "wss": 443}


def prepare(broker: str) -> None:
    """Check the environment, look up a broker's password, and warn once if it would be sent unencrypted.

    Raises:
        InputError: As `check_environment` and `from_keyring`.
    """
    check_environment()
    from_keyring(broker)
    for url in broker.split(","):
        there = place(url)
        if there not in _warned and has_password() and in_clear(url):
            _warned.add(there)
            _LOGGER.warning(
                "the password for %s travels unencrypted and can be read on the network path; use a broker "
                "with TLS, mqtts://",
                there,
            )


def check_environment(*, credentials: bool = True) -> None:
    """Check the variables that connections read, before anything is started that would end with their errors.

    credentials: also those for an external broker.

    Raises:
        InputError: SWARMWRIGHT_KEEP_ALIVE is not a number of seconds; a password without a user; a password
            file that cannot be read, or without a password; one of SWARMWRIGHT_CERTIFICATE_FILE and
            SWARMWRIGHT_KEY_FILE only.
    """
    seconds = os.environ.get(_KEEP_ALIVE)
    is_number = seconds and re.fullmatch("[+]?0*[0-9]{1,4}", seconds)
    if seconds and not (is_number and 1 <= int(seconds) <= _LONGEST_KEEP_ALIVE_S):
        raise InputError(
            f"{_KEEP_ALIVE} (environment): expected whole seconds from 1 to {_LONGEST_KEEP_ALIVE_S}, "
            f"not {seconds!r}"
        )
    if not credentials:
        return
    file = os.environ.get("SWARMWRIGHT_PASSWORD_FILE")
    if file and not os.environ.get("SWARMWRIGHT_PASSWORD"):
        reason = _no_password(Path(file))
        if reason is not None:
            raise InputError(f"SWARMWRIGHT_PASSWORD_FILE (environment): {file} {reason}")
    if has_password() and not os.environ.get("SWARMWRIGHT_USERNAME"):
        raise InputError(
            "a password is set but SWARMWRIGHT_USERNAME is not (environment); set both or neither"
        )
    pair = ("SWARMWRIGHT_CERTIFICATE_FILE", "SWARMWRIGHT_KEY_FILE")
    there = [name for name in pair if os.environ.get(name)]
    if len(there) == 1:
        (unset,) = set(pair) - set(there)
        raise InputError(
            f"{there[0]} is set but {unset} is not (environment); a client certificate needs both (PEM)"
        )


def _no_password(file: Path) -> str | None:
    """Return why a file has no password, None if it has; a pipe keeps its content for the connection."""
    reason: str | None = None
    try:
        if file.is_file():
            if not file.read_text(encoding="utf-8").partition("\n")[0].rstrip("\r"):
                return "has no password in its first line"
        elif not file.exists():
            reason = os.strerror(errno.ENOENT)
        elif file.is_dir():
            reason = os.strerror(errno.EISDIR)
        elif not os.access(file, os.R_OK):
            reason = os.strerror(errno.EACCES)
    except OSError as error:
        reason = error.strerror
    except ValueError:
        reason = "is not UTF-8 text"
    return None if reason is None else f"cannot be read: {reason}"


def has_password() -> bool:
    """Whether the environment has a password for brokers."""
    return any(os.environ.get(name) for name in ("SWARMWRIGHT_PASSWORD", "SWARMWRIGHT_PASSWORD_FILE"))


def in_clear(broker: str) -> bool:
    """Whether what is sent to a broker leaves this machine without TLS."""
    if _scheme(broker) in {"mqtts", "ssl", "tls", "wss", "unix"}:
        return False
    host = re.sub(r":\d+$", "", place(broker)).strip("[]").lower()
    if host == "localhost" or host.endswith(".localhost"):
        return False
    try:
        return not ipaddress.ip_address(host).is_loopback
    except ValueError:
        return True


def from_keyring(broker: str) -> None:
    """Look the password up, if a user is named and nothing else says it; child processes get it, too.

    broker: URL, or several, separated by commas. Nothing is done where the package keyring is not installed,
    or has no such password.

    Raises:
        InputError: The keyring is there and cannot be read: locked, or its file is damaged.
    """
    user = os.environ.get("SWARMWRIGHT_USERNAME")
    if not user or os.environ.get("SWARMWRIGHT_PASSWORD") or os.environ.get("SWARMWRIGHT_PASSWORD_FILE"):
        return
    try:
        import keyring  # noqa: PLC0415 - optional
        from keyring.errors import NoKeyringError  # noqa: PLC0415 - optional
    except ImportError:
        return
    try:
        for account in (*(f"{user}@{place(url)}" for url in broker.split(",")), user):
            password = keyring.get_password(SERVICE, account)
            if password:
                # The engine reads its environment, and so do the servers that a run starts.
                os.environ["SWARMWRIGHT_PASSWORD"] = password
                return
    except NoKeyringError:
        return
    except Exception as error:  # third-party backends may raise anything
        raise InputError(
            f"the password of {user} cannot be read from the keyring ({type(error).__name__}); unlock it, or "
            "set SWARMWRIGHT_PASSWORD_FILE"
        ) from error


def place(broker: str) -> str:
    """Host and port of a broker's URL, or the path of its Unix socket: mqtts://lab -> lab:8883."""
    rest = broker.strip().rpartition("://")[2]
    if _scheme(broker) == "unix":
        return rest.partition("?")[0]
    authority = re.split("[/?]", rest, maxsplit=1)[0]
    if re.search(r":\d+$", authority):
        return authority
    return f"{authority}:{_PORTS.get(_scheme(broker), 1883)}"


def _scheme(broker: str) -> str:
    """The scheme of a URL in lower case, "" where it has none."""
    return broker.strip().rpartition("://")[0].lower()

"""Credentials for brokers, from the environment, a file or the system's keyring.

The password of SWARMWRIGHT_USERNAME comes from SWARMWRIGHT_PASSWORD, else SWARMWRIGHT_PASSWORD_FILE, else the
keyring (https://keyring.readthedocs.io, `pip install 'swarmwright[keyring]'`).
"""

import errno
import ipaddress
import logging
import os
import re
from pathlib import Path

from swarmwright.common.errors import InputError

SERVICE = "swarmwright"
"""Service name in the keyring; accounts are `USER@HOST:PORT` (`USER@PATH` for a Unix socket) or, for every
broker, `USER`."""

CREDENTIALS = (
    "SWARMWRIGHT_USERNAME",
    "SWARMWRIGHT_PASSWORD",
    "SWARMWRIGHT_PASSWORD_FILE",
    "SWARMWRIGHT_CA_FILE",
    "SWARMWRIGHT_CERTIFICATE_FILE",
    "SWARMWRIGHT_KEY_FILE",
)
"""Environment variables with a client's credentials."""
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
    load_from_keyring(broker)
    for url in broker.split(","):
        location = location_of(url)
        if location not in _warned and has_password() and is_sent_in_clear(url):
            _warned.add(location)
            _LOGGER.warning(
                "the password for %s is sent unencrypted over the network; use a broker with TLS, mqtts://",
                location,
            )


def check_environment(*, credentials: bool = True) -> None:
    """Check the environment variables of connections before anything is started.

    credentials: also those for an external broker.

    Raises:
        InputError: SWARMWRIGHT_KEEP_ALIVE is not a number of seconds; a password is set without a user; the
            password file is unreadable or empty; or only one of SWARMWRIGHT_CERTIFICATE_FILE and
            SWARMWRIGHT_KEY_FILE is set.
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
        reason = _explain_missing_password(Path(file))
        if reason is not None:
            raise InputError(f"SWARMWRIGHT_PASSWORD_FILE (environment): {file} {reason}")
    if has_password() and not os.environ.get("SWARMWRIGHT_USERNAME"):
        raise InputError(
            "a password is set but SWARMWRIGHT_USERNAME is not (environment); set both or neither"
        )
    pair = ("SWARMWRIGHT_CERTIFICATE_FILE", "SWARMWRIGHT_KEY_FILE")
    present = [name for name in pair if os.environ.get(name)]
    if len(present) == 1:
        (unset,) = set(pair) - set(present)
        raise InputError(
            f"{present[0]} is set but {unset} is not (environment); a client certificate needs both (PEM)"
        )


def _explain_missing_password(file: Path) -> str | None:
    """Return why a file provides no password, or None; does not read from pipes."""
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
    """Whether the environment sets a password for brokers."""
    return any(os.environ.get(name) for name in ("SWARMWRIGHT_PASSWORD", "SWARMWRIGHT_PASSWORD_FILE"))


def is_sent_in_clear(broker: str) -> bool:
    """Whether messages to a broker leave this machine without TLS."""
    if _scheme(broker) in {"mqtts", "ssl", "tls", "wss", "unix"}:
        return False
    host = re.sub(r":\d+$", "", location_of(broker)).strip("[]").lower()
    if host == "localhost" or host.endswith(".localhost"):
        return False
    try:
        return not ipaddress.ip_address(host).is_loopback
    except ValueError:
        return True


def load_from_keyring(broker: str) -> None:
    """Set SWARMWRIGHT_PASSWORD from the keyring if a user but no password is set; child processes inherit it.

    broker: URL, or several, separated by commas. Without the package keyring or a stored password, nothing
    happens.

    Raises:
        InputError: The keyring cannot be read, because it is locked or damaged.
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
        for account in (*(f"{user}@{location_of(url)}" for url in broker.split(",")), user):
            password = keyring.get_password(SERVICE, account)
            if password:
                # The engine reads its environment, and so do the servers that a run starts.
                os.environ["SWARMWRIGHT_PASSWORD"] = password
                return
    except NoKeyringError:
        return
    except Exception as error:  # third-party backends may raise anything
        raise InputError(
            f"the password of {user} cannot be read from the keyring ({type(error).__name__}); unlock it or "
            "set SWARMWRIGHT_PASSWORD_FILE"
        ) from error


def location_of(broker: str) -> str:
    """Return host and port of a broker's URL, or the path of its Unix socket: mqtts://lab -> lab:8883."""
    remainder = broker.strip().rpartition("://")[2]
    if _scheme(broker) == "unix":
        return remainder.partition("?")[0]
    authority = re.split("[/?]", remainder, maxsplit=1)[0]
    if re.search(r":\d+$", authority):
        return authority
    return f"{authority}:{_PORTS.get(_scheme(broker), 1883)}"


def _scheme(broker: str) -> str:
    """Return the scheme of a URL in lower case, or an empty text."""
    return broker.strip().rpartition("://")[0].lower()

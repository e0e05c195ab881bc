"""Checks of broker addresses and topic prefixes."""

import os
import sys
from urllib.parse import urlsplit

from swarmwright.common.errors import InputError

PREFIX_VARIABLE = "SWARMWRIGHT_PREFIX"
"""Environment variable of the default topic prefix."""

DEFAULT_BROKER = "mqtt://localhost:1883"
"""Address of the broker of commands that need one."""

SCHEMES = ("mqtt", "mqtts", "ws", "wss", "unix")
VERSIONS = ("3", "5")

LONGEST_SOCKET_PATH = 107 if sys.platform.startswith("linux") else 103
"""Maximum length of the path of a Unix socket, bytes."""


def broker_problem(urls: str) -> str | None:
    """Return the problem of a broker's URL, or of several separated by commas; None if they are valid.

    Messages never repeat a URL, as it may contain secrets.
    """
    addresses = urls.split(",")
    for number, url in enumerate(addresses, 1):
        problem = _problem(url.strip())
        if problem is not None:
            return problem if len(addresses) == 1 else f"(address {number} of {len(addresses)}) {problem}"
    return None


def _problem(url: str) -> str | None:
    example = "write it like mqtt://host:1883"
    try:
        parts = urlsplit(url)
    except ValueError:
        return f"is not a broker address; {example}"
    if parts.scheme not in SCHEMES:
        schemes = ", ".join(f"{scheme}://" for scheme in SCHEMES)
        return f"must begin with one of {schemes}; {example}"
    if parts.username is not None or parts.password is not None:
        return (
            "must not contain a user or a password; set SWARMWRIGHT_USERNAME and SWARMWRIGHT_PASSWORD "
            "(or SWARMWRIGHT_PASSWORD_FILE) in the environment instead"
        )
    if parts.scheme == "unix":
        path = url.partition("://")[2].partition("?")[0]
        return _socket_problem(path) or _option_problem(parts.query, web=False)
    if not parts.hostname:
        return f"has no host; {example}"
    try:
        port = parts.port
    except ValueError:
        port = 0
    if port == 0:
        return f"has an invalid port, which must be from 1 to 65535; {example}"
    return _option_problem(parts.query, web=parts.scheme in {"ws", "wss"})


def _socket_problem(path: str) -> str | None:
    """Return the problem of a Unix socket's path, or None; does not check whether it exists."""
    if sys.platform == "win32":
        return "is a Unix socket, which is not supported on this system; use mqtt://localhost"
    if not path.startswith("/"):
        return "must have the absolute path of a Unix socket; write it like unix:///run/mosquitto.sock"
    length = len(os.fsencode(path))
    if length > LONGEST_SOCKET_PATH:
        return (
            f"has a path of {length} bytes, more than the {LONGEST_SOCKET_PATH} of a Unix socket on this "
            "system; use a shorter path"
        )
    return None


def drop_unix_sockets(urls: str) -> str:
    """Return a broker's addresses without Unix sockets, which other machines cannot use; may be empty."""
    return ",".join(url for url in urls.split(",") if not url.strip().startswith("unix:"))


def _option_problem(query: str, *, web: bool) -> str | None:
    """Return the problem of a URL's options, or None; websockets may have further options."""
    for option in filter(None, query.split("&")):
        name, _, value = option.partition("=")
        if name == "mqtt" and value not in VERSIONS:
            return "asks for an unsupported version of MQTT; write ?mqtt=3 (for 3.1.1) or ?mqtt=5"
        if name != "mqtt" and not web:
            return "has an unknown option; known options: ?mqtt=3 (for 3.1.1), ?mqtt=5"
    return None


def prefix_problem(prefix: str) -> str | None:
    """Return the problem of a topic prefix; None if it is valid."""
    if any(sign in prefix for sign in "#+\0"):
        return "must not contain '#', '+' or NUL, which have a special meaning in MQTT"
    if prefix.startswith(("/", "$")) or prefix.endswith("/"):
        return "must begin with neither '/' nor '$' and not end with '/'; write it like lab/minisim"
    if len(prefix.encode()) > 1000:
        return "must be at most 1000 bytes long"
    return None


def environment_prefix() -> str:
    """Return the topic prefix of the environment, or an empty text.

    Raises:
        InputError: It is invalid.
    """
    prefix = os.environ.get(PREFIX_VARIABLE, "")
    problem = prefix_problem(prefix)
    if problem is not None:
        raise InputError(f"{PREFIX_VARIABLE} (environment): {prefix!r} {problem}")
    return prefix

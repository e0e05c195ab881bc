"""A ready-made Mosquitto configuration: TLS with a new certificate authority, and an account for each role.

Roles:
    tool     asks for servers, configures and steers them, reads what they answer
    server   answers; reads what tools send, and publishes none of it
    watcher  reads everything, publishes nothing

Each topic prefix has separate accounts, which reach no other one. docs/reference/protocol.md has the topics.
"""

import ipaddress
import logging
import os
import pwd
import re
import secrets
import shlex
import socket
import stat
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from swarmwright import _engine
from swarmwright.common.errors import InputError
from swarmwright.experiment.broker_address import PREFIX_VARIABLE

_LOGGER = logging.getLogger("swarmwright")

CERTIFICATE_DAYS = 730
"""Term of the broker's certificate; the authority's is ten years."""

ITERATIONS = 210_000
"""Rounds of PBKDF2 with HMAC-SHA-512, as OWASP's Password Storage Cheat Sheet advises."""

LARGEST_PACKET_BYTES = (64 << 20) + (1 << 20)
"""What the built-in broker accepts, too."""

_TO_SERVERS = ("discovery", "parameters", "control", "actuator", "swarmwright/v1/server/+")
_TO_TOOLS = ("server", "sensor", "fitness", "swarmwright/v1/tool/+")
_PRESENCE = ("swarmwright/v1/presence/+",)
_STATUS = ("swarmwright/v1/status/+",)

ROLES: dict[str, dict[str, tuple[str, ...]]] = {
    "tool": {"write": (*_TO_SERVERS, *_STATUS), "read": (*_TO_TOOLS, *_PRESENCE)},
    # It reads presence too, to notice another server with its id.
    "server": {"write": (*_TO_TOOLS, *_PRESENCE), "read": (*_TO_SERVERS, *_PRESENCE)},
    "watcher": {"write": (), "read": (*_TO_SERVERS, *_TO_TOOLS, *_PRESENCE, *_STATUS)},
}
"""What each role may publish and read, without prefix."""

_CONFIGURATION = """\
# Made by `swarmwright broker --init`. `passwords` has the accounts, `acl` what they may do; after SIGHUP both
# are read again.
listener {port}
cafile {folder}/ca.pem
certfile {folder}/broker.pem
keyfile {folder}/broker-key.pem
tls_version tlsv1.2
max_connections 4096

allow_anonymous false
password_file {folder}/passwords
acl_file {folder}/acl

# Without it every step of an episode waits 40 ms for delayed acknowledgements.
set_tcp_nodelay true
# Sensor and actuator messages are not repeated: none may be dropped.
max_queued_messages 0
# Bytes: the longest message of the protocol, 64 MiB, and its heading. Clients are told; `message_size_limit`
# drops larger messages without a notice.
max_packet_size {largest_packet}
"""


@dataclass(frozen=True)
class Account:
    """One account of the broker: its user name, its role, its topic prefix ("" for none)."""

    user: str
    role: str
    prefix: str


def accounts(prefixes: Sequence[str]) -> list[Account]:
    """The accounts for topic prefixes: `tool`, or `lab-1-tool` under the prefix `lab/1`.

    Raises:
        InputError: A prefix that an access file cannot hold; two that lead to the same user names.
    """
    made: dict[str, Account] = {}
    for prefix in dict.fromkeys(prefix.removesuffix("/") for prefix in prefixes or [""]):
        if not prefix.isprintable() or prefix != prefix.strip():
            raise InputError(
                f"the prefix {prefix!r} cannot be used in an access file; use letters, digits, '-' and '/'"
            )
        stem = re.sub(r"[^\w.-]+", "-", prefix, flags=re.ASCII)
        for role in ROLES:
            account = Account(f"{stem}-{role}" if stem else role, role, prefix)
            other = made.setdefault(account.user, account)
            if other is not account:
                raise InputError(
                    f"the prefixes {other.prefix!r} and {prefix!r} would share the user {account.user}; "
                    "use letters, digits, '-' and '_'"
                )
    return list(made.values())


def access_rules(of: Sequence[Account]) -> str:
    """The access file: what is not allowed is denied."""
    return f"# What each account may read and write; all else is denied.\n{_rules(of)}"


def _rules(of: Sequence[Account]) -> str:
    parts = []
    for account in of:
        under = f"{account.prefix}/" if account.prefix else ""
        lines = [
            f"topic {right} {under}{topic}"
            for right, topics in ROLES[account.role].items()
            for topic in topics
        ]
        parts.append("\n".join([f"\nuser {account.user}", *lines, ""]))
    return "".join(parts)


def hosts(given: Sequence[str]) -> list[str]:
    """Names and addresses for the certificate: those given, or this machine's name; and loopback's.

    Raises:
        InputError: Something that is neither a host name nor an IP address.
    """
    found = list(given) or [socket.gethostname()]
    for host in found:
        if _is_address(host):
            if ipaddress.ip_address(host).is_unspecified:
                raise InputError(f"{host} means every address; name those by which clients reach the broker")
        elif not re.fullmatch(r"(?!-)[A-Za-z0-9_-]{1,63}(\.[A-Za-z0-9_-]{1,63})*", host):
            raise InputError(f"{host!r} is neither a host name nor an IP address")
    return list(dict.fromkeys([*found, "localhost", "127.0.0.1", "::1"]))


def write_configuration(
    folder: Path,
    *,
    given: Sequence[str],
    port: int,
    prefixes: Sequence[str],
    iterations: int | None = None,
) -> list[Account]:
    """Write configuration, certificates, accounts and access rules into a folder; secrets have the mode 0600.

    A folder that exists keeps its mode: Mosquitto's user must be able to enter it, and is warned of if not.

    given: names and addresses by which clients reach the broker. port: of the listener, TLS. iterations: of
    PBKDF2 for each password, None for `ITERATIONS`.

    Raises:
        InputError: A file that would be written is there already (then none is), or cannot be written.
    """
    folder = folder.resolve()
    if "\n" in str(folder):
        raise InputError("the path of the folder has a line break in it")
    made = accounts(prefixes)
    names = hosts(given)
    rounds = iterations or ITERATIONS
    passwords = {account.user: secrets.token_urlsafe(24) for account in made}
    authority, authority_key, certificate, key = _engine.certificates(names, CERTIFICATE_DAYS)
    public = {
        "mosquitto.conf": _CONFIGURATION.format(
            folder=folder, port=port, largest_packet=LARGEST_PACKET_BYTES
        ),
        "ca.pem": authority,
        "broker.pem": certificate,
    }
    of_broker = {
        "acl": access_rules(made),
        "broker-key.pem": key,
        "passwords": "".join(
            f"{user}:{_engine.hash_for_mosquitto(word, rounds)}\n" for user, word in passwords.items()
        ),
    }
    secret = {"ca-key.pem": authority_key}
    host = f"[{names[0]}]" if ":" in names[0] else names[0]
    address = f"mqtts://{host}:{port}"
    for account in made:
        secret[f"{account.user}.password"] = passwords[account.user] + "\n"
        public[f"{account.user}.env"] = _variables(folder, account, address)
    there = sorted(name for name in (*public, *of_broker, *secret) if (folder / name).exists())
    if there:
        adding = "; `--prefix P` alone adds accounts for another prefix" if can_add(folder) else ""
        raise InputError(
            f"{folder}: {', '.join(there)} already exist; nothing is overwritten. Name another folder, or "
            f"move them away first{adding}"
        )
    is_new = not folder.exists()
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        for name, text in {**secret, **of_broker}.items():
            _write(folder / name, text, 0o600)
        for name, text in public.items():
            _write(folder / name, text, 0o644)
        _give_to_mosquitto([folder / name for name in of_broker], folder if is_new else None)
    except (OSError, UnicodeError) as error:
        for name in (*public, *of_broker, *secret):  # none was there before
            with suppress(OSError):
                (folder / name).unlink(missing_ok=True)
        if is_new:
            with suppress(OSError):
                folder.rmdir()
        if isinstance(error, OSError):
            raise InputError(f"{error.filename or folder}: cannot be written: {error.strerror}") from error
        raise
    return made


def can_add(folder: Path) -> bool:
    """Whether accounts can be added to a folder: `write_configuration` has made it."""
    try:
        with (folder / "mosquitto.conf").open(encoding="utf-8", errors="replace") as file:
            first = file.readline()
    except OSError:
        return False
    return first.startswith(_CONFIGURATION.partition(" --init")[0])


def add_accounts(folder: Path, prefixes: Sequence[str], iterations: int | None = None) -> list[Account]:
    """Add accounts for further topic prefixes to a folder that `write_configuration` has made.

    Lines are added to `acl` and `passwords`, which the broker reads again on SIGHUP; other files stay.

    prefixes: at least one. iterations: as in `write_configuration`.

    Raises:
        InputError: There are accounts of these names, or a file cannot be read or written; nothing is added.
    """
    folder = folder.resolve()
    made = accounts(prefixes)
    rounds = iterations or ITERATIONS
    passwords = {account.user: secrets.token_urlsafe(24) for account in made}
    files = {f"{user}.password": (f"{word}\n", 0o600) for user, word in passwords.items()}
    lines = {
        "acl": _rules(made),
        "passwords": "".join(
            f"{user}:{_engine.hash_for_mosquitto(word, rounds)}\n" for user, word in passwords.items()
        ),
    }
    sizes: dict[str, int] = {}
    written: list[Path] = []
    try:
        address = _address(folder)
        for account in made:
            files[f"{account.user}.env"] = (_variables(folder, account, address), 0o644)
        known = {line.partition(":")[0] for line in (folder / "passwords").read_text("utf-8").splitlines()}
        there = sorted({name for name in files if (folder / name).exists()} | (known & set(passwords)))
        if there:
            raise InputError(
                f"{folder}: {', '.join(there)} already there; nothing is overwritten. Name other prefixes"
            )
        for name, (text, mode) in files.items():
            written.append(folder / name)
            _write(folder / name, text, mode)
        for name, text in lines.items():
            # Appended: another file in its place would have another owner than Mosquitto's user.
            with (folder / name).open("r+b") as file:
                before = file.read()
                sizes[name] = len(before)
                file.write((b"" if before.endswith(b"\n") or not before else b"\n") + text.encode())
    except (OSError, UnicodeError) as error:
        for name, size in sizes.items():
            with suppress(OSError):
                os.truncate(folder / name, size)
        for path in written:
            with suppress(OSError):
                path.unlink()
        where = getattr(error, "filename", None) or folder
        reason = getattr(error, "strerror", None) or "is not UTF-8 text"
        raise InputError(f"{where}: accounts cannot be added: {reason}") from error
    return made


def _address(folder: Path) -> str:
    """The broker's address, as the variables of the accounts that are there have it."""
    for path in sorted(folder.glob("*.env")):
        found = re.search(r"^export SWARMWRIGHT_BROKER=(.+)$", path.read_text("utf-8"), re.MULTILINE)
        if found:
            return "".join(shlex.split(found[1]))
    raise InputError(
        f"{folder}: accounts cannot be added: the broker's address is unknown, since the files *.env of "
        "`broker --init` are not there"
    )


def _variables(folder: Path, account: Account, address: str) -> str:
    """What a shell reads (`. FILE`) to act as the account."""
    values = {
        "SWARMWRIGHT_BROKER": address,
        "SWARMWRIGHT_CA_FILE": str(folder / "ca.pem"),
        "SWARMWRIGHT_USERNAME": account.user,
        "SWARMWRIGHT_PASSWORD_FILE": str(folder / f"{account.user}.password"),
        # Also where there is none: a shell may have read the variables of another account before.
        PREFIX_VARIABLE: account.prefix,
    }
    return "".join(f"export {name}={shlex.quote(value)}\n" for name, value in values.items())


def _write(path: Path, text: str, mode: int) -> None:
    """Create a file with restrictive permissions from the start; an existing file is an error."""
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
    with os.fdopen(descriptor, "w", encoding="utf-8") as file:
        os.fchmod(descriptor, mode)
        file.write(text)


def _give_to_mosquitto(files: Sequence[Path], new_folder: Path | None) -> None:
    """Let Mosquitto read its files: started as root, it becomes the user `mosquitto` before it reads them.

    new_folder: the files' folder where it was created for them; the mode of another is its owner's.
    """
    if os.getuid() != 0:
        return
    try:
        user = pwd.getpwnam("mosquitto")
    except KeyError:
        return
    if new_folder is not None:
        new_folder.chmod(0o711)
    for file in files:
        os.chown(file, user.pw_uid, user.pw_gid)
    for folder in reversed(files[0].parents):
        if not _can_enter(folder, user):
            _LOGGER.warning(
                "%s: the user mosquitto cannot enter it; chmod o+x %s", folder, shlex.quote(str(folder))
            )


def _can_enter(folder: Path, user: pwd.struct_passwd) -> bool:
    """Whether the mode of a folder lets a user reach files in it."""
    status = folder.stat()
    if status.st_uid == user.pw_uid:
        return bool(status.st_mode & stat.S_IXUSR)
    if status.st_gid in os.getgrouplist(user.pw_name, user.pw_gid):
        return bool(status.st_mode & stat.S_IXGRP)
    return bool(status.st_mode & stat.S_IXOTH)


def _is_address(host: str) -> bool:
    try:
        ipaddress.ip_address(host)
    except ValueError:
        return False
    return True

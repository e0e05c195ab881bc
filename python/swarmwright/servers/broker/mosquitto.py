"""Mosquitto configuration with TLS, a new certificate authority and an account for each role.

Roles:
    tool     discovers, configures and controls servers, and reads their messages
    server   publishes its own messages and reads those of tools
    watcher  reads everything, publishes nothing

Each topic prefix has separate accounts without access to others. docs/reference/protocol.md lists the topics.
"""

import contextlib
import ipaddress
import logging
import os
import pwd
import re
import secrets
import shlex
import socket
import ssl
import stat
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from swarmwright import _engine
from swarmwright.common.errors import InputError
from swarmwright.common.files import read_bytes
from swarmwright.experiment.broker_address import PREFIX_VARIABLE

_END = "-----END CERTIFICATE-----"


def is_authority_certificate(file: Path) -> bool:
    """Whether the first certificate of a PEM file belongs to an authority (CA:TRUE).

    TLS clients may refuse a broker that presents such a certificate. False for files that are not PEM.
    """
    try:
        first, end, _ = file.read_text(encoding="ascii").partition(_END)
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        context.load_verify_locations(cadata=first + end)
    except (OSError, ValueError):  # ssl.SSLError is an OSError
        return False
    return context.cert_store_stats()["x509_ca"] > 0


def check_user(name: str) -> str:
    """Return the name if it is valid in password and access files; else raise InputError."""
    if (
        not name
        or name.startswith("#")
        or ":" in name
        or not name.isprintable()
        or any(map(str.isspace, name))
    ):
        raise InputError(
            f"{name!r} is not a valid user name; it must not contain spaces or ':', nor begin with '#'"
        )
    return name


_LARGEST_FILE_BYTES = 1 << 26  # bytes


def set_password(path: Path, user: str, password: str) -> bool:
    """Set a user's password; create the file (mode 0600) and the user if necessary.

    Other lines, including comments, stay unchanged; the file is replaced atomically.

    Returns:
        Whether the user is new.

    Raises:
        InputError: The name is invalid, the password is empty, or the file cannot be read or written.
    """
    check_user(user)
    if not password:
        raise InputError("an empty password would admit every client; give one with at least one character")
    line = f"{user}:{_engine.hash_password(password)}\n"
    try:
        content = read_bytes(path, _LARGEST_FILE_BYTES).decode() if path.exists() else ""
        lines = content.splitlines(keepends=True)
        if lines and not lines[-1].endswith("\n"):
            lines[-1] += "\n"
        matches = [index for index, text in enumerate(lines) if text.lstrip().startswith(f"{user}:")]
        if matches:
            lines[matches[0]] = line
        else:
            lines.append(line)
        _replace(path, "".join(lines))
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "is not UTF-8 text"
        raise InputError(f"{path}: cannot be changed: {reason}") from error
    return not matches


def _replace(path: Path, text: str) -> None:
    path = path.resolve()
    descriptor, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")  # mode 0600
    try:
        with os.fdopen(descriptor, "w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(descriptor)
            if path.exists():
                before = path.stat()
                os.fchmod(descriptor, before.st_mode & 0o7777)
                with contextlib.suppress(PermissionError):
                    os.fchown(descriptor, before.st_uid, before.st_gid)
        Path(name).replace(path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


_LOGGER = logging.getLogger("swarmwright")

CERTIFICATE_DAYS = 730
"""Validity of the broker's certificate; the authority's is ten years."""

ITERATIONS = 210_000
"""Rounds of PBKDF2 with HMAC-SHA-512, as OWASP's Password Storage Cheat Sheet advises."""

LARGEST_PACKET_BYTES = (64 << 20) + (1 << 20)
"""Largest MQTT packet, as in the embedded broker."""

_TO_SERVERS = ("discovery", "parameters", "control", "actuator", "swarmwright/v1/server/+")
_TO_TOOLS = ("server", "sensor", "fitness", "swarmwright/v1/tool/+")
_PRESENCE = ("swarmwright/v1/presence/+",)
_STATUS = ("swarmwright/v1/status/+",)

ROLES: dict[str, dict[str, tuple[str, ...]]] = {
    "tool": {"write": (*_TO_SERVERS, *_STATUS), "read": (*_TO_TOOLS, *_PRESENCE)},
    # Servers read presence to notice another server with their id.
    "server": {"write": (*_TO_TOOLS, *_PRESENCE), "read": (*_TO_SERVERS, *_PRESENCE)},
    "watcher": {"write": (), "read": (*_TO_SERVERS, *_TO_TOOLS, *_PRESENCE, *_STATUS)},
}
"""Topics that each role may publish and read, without prefix."""

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
    """An account of the broker; `prefix` is the topic prefix or empty."""

    user: str
    role: str
    prefix: str


def make_accounts(prefixes: Sequence[str]) -> list[Account]:
    """Make the accounts of topic prefixes: `tool`, or `lab-1-tool` for the prefix `lab/1`.

    Raises:
        InputError: A prefix is invalid in an access file, or two prefixes lead to the same user names.
    """
    accounts: dict[str, Account] = {}
    for prefix in dict.fromkeys(prefix.removesuffix("/") for prefix in prefixes or [""]):
        if not prefix.isprintable() or prefix != prefix.strip():
            raise InputError(
                f"the prefix {prefix!r} cannot be used in an access file; use letters, digits, '-' and '/'"
            )
        stem = re.sub(r"[^\w.-]+", "-", prefix, flags=re.ASCII)
        for role in ROLES:
            account = Account(f"{stem}-{role}" if stem else role, role, prefix)
            existing = accounts.setdefault(account.user, account)
            if existing is not account:
                raise InputError(
                    f"the prefixes {existing.prefix!r} and {prefix!r} would share the user {account.user}; "
                    "use letters, digits, '-' and '_'"
                )
    return list(accounts.values())


def format_access_rules(accounts: Sequence[Account]) -> str:
    """Return the text of the access file, which denies everything else."""
    return f"# What each account may read and write; all else is denied.\n{_format_rules(accounts)}"


def _format_rules(accounts: Sequence[Account]) -> str:
    parts = []
    for account in accounts:
        root = f"{account.prefix}/" if account.prefix else ""
        lines = [
            f"topic {right} {root}{topic}"
            for right, topics in ROLES[account.role].items()
            for topic in topics
        ]
        parts.append("\n".join([f"\nuser {account.user}", *lines, ""]))
    return "".join(parts)


def list_hosts(names: Sequence[str]) -> list[str]:
    """List the names and addresses for the certificate: those given or this machine's name, and loopback.

    Raises:
        InputError: A name is neither a host name nor an IP address.
    """
    addresses = list(names) or [socket.gethostname()]
    for host in addresses:
        if _is_address(host):
            if ipaddress.ip_address(host).is_unspecified:
                raise InputError(f"{host} stands for every address; give the addresses that clients use")
        elif not re.fullmatch(r"(?!-)[A-Za-z0-9_-]{1,63}(\.[A-Za-z0-9_-]{1,63})*", host):
            raise InputError(f"{host!r} is neither a host name nor an IP address")
    return list(dict.fromkeys([*addresses, "localhost", "127.0.0.1", "::1"]))


def write_configuration(
    folder: Path,
    *,
    hosts: Sequence[str],
    port: int,
    prefixes: Sequence[str],
    iterations: int | None = None,
) -> list[Account]:
    """Write configuration, certificates, accounts and access rules into a folder; secrets get mode 0600.

    An existing folder keeps its mode; a warning tells if Mosquitto's user cannot enter it.

    Args:
        folder: for the files.
        hosts: names and addresses by which clients reach the broker.
        port: port of the TLS listener.
        prefixes: topic prefixes, each with its own accounts.
        iterations: of PBKDF2 for each password; None for `ITERATIONS`.

    Raises:
        InputError: A file exists already (then none is written) or cannot be written.
    """
    folder = folder.resolve()
    if "\n" in str(folder):
        raise InputError("the folder's path contains a line break")
    accounts = make_accounts(prefixes)
    names = list_hosts(hosts)
    rounds = iterations or ITERATIONS
    passwords = {account.user: secrets.token_urlsafe(24) for account in accounts}
    authority, authority_key, certificate, key = _engine.certificates(names, CERTIFICATE_DAYS)
    public = {
        "mosquitto.conf": _CONFIGURATION.format(
            folder=folder, port=port, largest_packet=LARGEST_PACKET_BYTES
        ),
        "ca.pem": authority,
        "broker.pem": certificate,
    }
    broker_files = {
        "acl": format_access_rules(accounts),
        "broker-key.pem": key,
        "passwords": "".join(
            f"{user}:{_engine.hash_for_mosquitto(password, rounds)}\n" for user, password in passwords.items()
        ),
    }
    secret = {"ca-key.pem": authority_key}
    host = f"[{names[0]}]" if ":" in names[0] else names[0]
    address = f"mqtts://{host}:{port}"
    for account in accounts:
        secret[f"{account.user}.password"] = passwords[account.user] + "\n"
        public[f"{account.user}.env"] = _format_variables(folder, account, address)
    existing = sorted(name for name in (*public, *broker_files, *secret) if (folder / name).exists())
    if existing:
        adding = "; `--prefix P` alone adds accounts for another prefix" if can_add(folder) else ""
        raise InputError(
            f"{folder}: {', '.join(existing)} already exist and are not overwritten. Choose another "
            f"folder or move them away first{adding}"
        )
    is_new = not folder.exists()
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        for name, text in {**secret, **broker_files}.items():
            _write(folder / name, text, 0o600)
        for name, text in public.items():
            _write(folder / name, text, 0o644)
        _give_to_mosquitto([folder / name for name in broker_files], folder if is_new else None)
    except (OSError, UnicodeError) as error:
        for name in (*public, *broker_files, *secret):  # none existed before
            with suppress(OSError):
                (folder / name).unlink(missing_ok=True)
        if is_new:
            with suppress(OSError):
                folder.rmdir()
        if isinstance(error, OSError):
            raise InputError(f"{error.filename or folder}: cannot be written: {error.strerror}") from error
        raise
    return accounts


def can_add(folder: Path) -> bool:
    """Whether `write_configuration` has made a folder, so that accounts can be added."""
    try:
        with (folder / "mosquitto.conf").open(encoding="utf-8", errors="replace") as file:
            first = file.readline()
    except OSError:
        return False
    return first.startswith(_CONFIGURATION.partition(" --init")[0])


def add_accounts(folder: Path, prefixes: Sequence[str], iterations: int | None = None) -> list[Account]:
    """Add accounts for further topic prefixes to a folder of `write_configuration`.

    The broker rereads `acl` and `passwords` on SIGHUP; other files stay unchanged.

    prefixes: at least one. iterations: as in `write_configuration`.

    Raises:
        InputError: Accounts of these names exist, or a file cannot be read or written; nothing is added.
    """
    folder = folder.resolve()
    accounts = make_accounts(prefixes)
    rounds = iterations or ITERATIONS
    passwords = {account.user: secrets.token_urlsafe(24) for account in accounts}
    files = {f"{user}.password": (f"{password}\n", 0o600) for user, password in passwords.items()}
    lines = {
        "acl": _format_rules(accounts),
        "passwords": "".join(
            f"{user}:{_engine.hash_for_mosquitto(password, rounds)}\n" for user, password in passwords.items()
        ),
    }
    sizes: dict[str, int] = {}
    written: list[Path] = []
    try:
        address = _find_address(folder)
        for account in accounts:
            files[f"{account.user}.env"] = (_format_variables(folder, account, address), 0o644)
        users = {line.partition(":")[0] for line in (folder / "passwords").read_text("utf-8").splitlines()}
        existing = sorted({name for name in files if (folder / name).exists()} | (users & set(passwords)))
        if existing:
            raise InputError(
                f"{folder}: {', '.join(existing)} already exist and are not overwritten. Choose other "
                "prefixes"
            )
        for name, (text, mode) in files.items():
            written.append(folder / name)
            _write(folder / name, text, mode)
        for name, text in lines.items():
            # Append in place, because a new file would not belong to Mosquitto's user.
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
        path_text = getattr(error, "filename", None) or folder
        reason = getattr(error, "strerror", None) or "is not UTF-8 text"
        raise InputError(f"{path_text}: accounts cannot be added: {reason}") from error
    return accounts


def _find_address(folder: Path) -> str:
    """Find the broker's address in the variables of existing accounts."""
    for path in sorted(folder.glob("*.env")):
        match = re.search(r"^export SWARMWRIGHT_BROKER=(.+)$", path.read_text("utf-8"), re.MULTILINE)
        if match:
            return "".join(shlex.split(match[1]))
    raise InputError(
        f"{folder}: accounts cannot be added: the broker's address is unknown, because the files *.env of "
        "`broker --init` are missing"
    )


def _format_variables(folder: Path, account: Account, address: str) -> str:
    """Return the text of a file of variables for a shell (`. FILE`)."""
    values = {
        "SWARMWRIGHT_BROKER": address,
        "SWARMWRIGHT_CA_FILE": str(folder / "ca.pem"),
        "SWARMWRIGHT_USERNAME": account.user,
        "SWARMWRIGHT_PASSWORD_FILE": str(folder / f"{account.user}.password"),
        # Set it even if empty, as a shell may have the variables of another account.
        PREFIX_VARIABLE: account.prefix,
    }
    return "".join(f"export {name}={shlex.quote(value)}\n" for name, value in values.items())


def _write(path: Path, text: str, mode: int) -> None:
    """Create a file with its permissions from the start; fail if it exists."""
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
    with os.fdopen(descriptor, "w", encoding="utf-8") as file:
        os.fchmod(descriptor, mode)
        file.write(text)


def _give_to_mosquitto(files: Sequence[Path], new_folder: Path | None) -> None:
    """Let the user `mosquitto`, under which Mosquitto runs if started as root, read the files.

    new_folder: the files' folder if it was created for them; other folders keep their mode.
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
                "%s: the user mosquitto cannot enter this folder; run chmod o+x %s",
                folder,
                shlex.quote(str(folder)),
            )


def _can_enter(folder: Path, user: pwd.struct_passwd) -> bool:
    """Whether the mode of a folder lets a user enter it."""
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

"""Sessions of those who have entered the password, and how often it may be tried."""

import hashlib
import hmac
import ipaddress
import os
import secrets
import stat
import time
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path

from swarmwright.common.errors import InputError

SESSION_S = 7 * 86400.0
MOST_SESSIONS = 1000
MOST_CLIENTS = 1000
CLIENT_ATTEMPTS, CLIENT_PAUSE_S = 5, 30.0
"""Wrong passwords that an address may send at once, and after how long it may send another one."""
ALL_ATTEMPTS, ALL_PAUSE_S = 60, 6.0
"""The same for all addresses together: attackers have many."""
SHORTEST_PASSWORD = 8
PASSWORD_BYTES = 1000


class TooManyAttemptsError(Exception):
    """The password may not be tried now.

    Attributes:
        seconds: until it may be tried again.
    """

    def __init__(self, seconds: float) -> None:
        super().__init__(seconds)
        self.seconds = seconds


class Allowance:
    """A number of attempts that comes back with time.

    Args:
        attempts: at once.
        pause: seconds after which another one is allowed.
    """

    def __init__(self, attempts: int, pause: float) -> None:
        self._attempts = attempts
        self._pause = pause
        self._used = 0.0
        self._seen = 0.0

    def seconds_left(self, now: float) -> float:
        """Return the time until an attempt is allowed, 0 for now."""
        self._used = max(0.0, self._used - (now - self._seen) / self._pause)
        self._seen = now
        return max(0.0, (self._used - self._attempts + 1) * self._pause)

    def use(self) -> None:
        """Count an attempt."""
        self._used += 1.0


class Sessions:
    """Sessions in this process; they end with it, or after a week.

    Args:
        password: that opens one.
        clock: returns seconds, from any origin.
    """

    def __init__(self, password: str, clock: Callable[[], float] = time.monotonic) -> None:
        self._password = digest(password)
        self._clock = clock
        self._opened: OrderedDict[bytes, float] = OrderedDict()
        self._clients: OrderedDict[str, Allowance] = OrderedDict()
        self._all = Allowance(ALL_ATTEMPTS, ALL_PAUSE_S)

    def open(self, client: str, password: str) -> str | None:
        """Return the secret of a new session, None for a wrong password.

        client: the address that it comes from.

        Raises TooManyAttemptsError, whatever the password, after too many wrong ones.
        """
        now = self._clock()
        network = network_of(client)
        allowance = self._clients.pop(network, None) or Allowance(CLIENT_ATTEMPTS, CLIENT_PAUSE_S)
        self._clients[network] = allowance
        while len(self._clients) > MOST_CLIENTS:
            self._clients.popitem(last=False)
        seconds = max(allowance.seconds_left(now), self._all.seconds_left(now))
        if seconds > 0:
            raise TooManyAttemptsError(max(seconds, 1.0))
        if not hmac.compare_digest(digest(password), self._password):
            allowance.use()
            self._all.use()
            return None
        session = secrets.token_urlsafe(32)
        self._opened[digest(session)] = now + SESSION_S
        while len(self._opened) > MOST_SESSIONS:
            self._opened.popitem(last=False)
        return session

    def is_open(self, session: str) -> bool:
        """Return whether there is such a session."""
        return self._opened.get(digest(session), -1.0) > self._clock()


def digest(text: str) -> bytes:
    """Return a hash of a secret, whose comparison says nothing of its length."""
    return hashlib.sha256(text.encode(errors="surrogatepass")).digest()


def network_of(client: str) -> str:
    """Return what counts as one address: of IPv6 the first 64 bits, of which a person has all others."""
    try:
        address = ipaddress.ip_address(client.partition("%")[0])
    except ValueError:
        return client
    if address.version == 4 or address.ipv4_mapped is not None:
        return client
    return str(ipaddress.ip_network((int(address) >> 64 << 64, 64)))


def read_password_file(file: Path) -> str:
    """Return the first line of a file that only this user can read.

    Raises InputError where others can read or change it, or it has no password.
    """
    try:
        descriptor = os.open(file, os.O_RDONLY | os.O_NONBLOCK)
        with os.fdopen(descriptor, "rb") as stored:
            status = os.fstat(descriptor)
            if not stat.S_ISREG(status.st_mode):
                raise InputError(f"{file}: is not a regular file")
            if status.st_mode & 0o077 or status.st_uid not in {os.getuid(), 0}:
                raise InputError(f"{file}: other users can read or change it; restrict it with chmod 600")
            line = stored.read(PASSWORD_BYTES).partition(b"\n")[0]
        password = line.decode().rstrip("\r")
    except OSError as error:
        raise InputError(f"{file}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError:
        raise InputError(f"{file}: is not UTF-8 text") from None
    if len(password) < SHORTEST_PASSWORD:
        raise InputError(
            f"{file}: its first line must be a password of at least {SHORTEST_PASSWORD} characters"
        )
    return password

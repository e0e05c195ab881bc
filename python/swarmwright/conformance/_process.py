"""A peer that the kit starts itself (`--exec`)."""

import contextlib
import os
import re
import shlex
import signal
import subprocess
import tempfile
from collections.abc import Callable, Mapping

from swarmwright.common.errors import InputError
from swarmwright.common.suggestions import did_you_mean

_PLACEHOLDER = re.compile(r"(?<!\$)\{([A-Za-z_]\w*)\}")
"""A word in braces, except for shell variables."""
GRACE_S = 10.0
"""Seconds to wait for an orderly exit."""


class Process:
    """A command with placeholders such as {broker}; started in a new process group.

    Args:
        command: as typed in a shell; no shell is involved.
        values: returns the values of the placeholders, called for each start.

    Raises InputError if the command cannot be parsed or started.

    """

    def __init__(self, command: str, values: Callable[[], Mapping[str, object]]) -> None:
        self.command = command
        self._values = values
        if not self._words({}):
            raise InputError("--exec: is empty; write the command that starts the peer")
        self._said = tempfile.TemporaryFile()  # noqa: SIM115 - closed with the process
        self._process: subprocess.Popen[bytes] | None = None
        self._marked = 0

    def _words(self, values: Mapping[str, object]) -> list[str]:
        command = self.command
        if values:
            self._check_placeholders(values)
        for name, value in values.items():
            command = command.replace(f"{{{name}}}", shlex.quote(str(value)))
        try:
            return shlex.split(command)
        except ValueError as error:
            raise InputError(f"--exec: {command!r} cannot be read: {error}") from None

    def _check_placeholders(self, values: Mapping[str, object]) -> None:
        for name in _PLACEHOLDER.findall(self.command):
            if name not in values:
                placeholders = ", ".join(f"{{{value}}}" for value in values)
                hint = did_you_mean(name, list(values))
                raise InputError(
                    f"--exec: {{{name}}} is not one of the placeholders {placeholders}{hint or ';'} "
                    "what needs braces itself goes into a script"
                )

    def another(self) -> "Process":
        """Return a second process with the same command."""
        return Process(self.command, self._values)

    def start(self) -> None:
        """Start or restart the process."""
        self.stop()
        words = self._words(self._values())
        try:
            self._process = subprocess.Popen(
                words,
                stdin=subprocess.DEVNULL,
                stdout=self._said,
                stderr=self._said,
                start_new_session=True,
            )
        except OSError as error:
            raise InputError(f"--exec: {words[0]}: {error.strerror}") from None

    @property
    def ended(self) -> str:
        """Description of the exit with the last output; empty while the process runs."""
        status = None if self._process is None else self._process.poll()
        if status is None:
            return ""
        how = f"was killed by {signal.Signals(-status).name}" if status < 0 else f"ended with {status}"
        return f"the process {how}{self.words}"

    @property
    def words(self) -> str:
        """The end of the output, to append to a sentence; empty without output."""
        return self._last_words(0)

    def mark(self) -> None:
        """Make `new_words` start at the present end of the output."""
        self._marked = self._count_printed_bytes()

    @property
    def new_words(self) -> str:
        """The end of the output since `mark`, like `words`."""
        return self._last_words(self._marked)

    def _count_printed_bytes(self) -> int:
        return os.fstat(self._said.fileno()).st_size

    def _last_words(self, start: int) -> str:
        start = max(start, self._count_printed_bytes() - 2000)
        text = os.pread(self._said.fileno(), 2000, start).decode("utf-8", "replace").strip()
        lines = [f"\n    {line}" for line in text.splitlines()[-5:]]
        return f"; it said last:{''.join(lines)}" if lines else ""

    @property
    def status(self) -> int | None:
        """Exit status; None while it runs."""
        return None if self._process is None else self._process.poll()

    def wait(self, seconds: float) -> int | None:
        """Wait for the exit status; return None if it does not end in time."""
        assert self._process is not None
        with contextlib.suppress(subprocess.TimeoutExpired):
            return self._process.wait(seconds)
        return None

    def signal(self, number: signal.Signals) -> None:
        """Send a signal to the process and its children."""
        if self._process is not None and self._process.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._process.pid, number)

    def stop(self) -> None:
        """Terminate the process; kill it if it does not exit."""
        if self._process is None:
            return
        self.signal(signal.SIGTERM)
        if self.wait(GRACE_S) is None:
            self.signal(signal.SIGKILL)
            self._process.wait()

    def close(self) -> None:
        """Stop the process and close its output file."""
        self.stop()
        self._said.close()

"""`--log FILE`: events, one JSON object per line, for programs that collect logs."""

import datetime as dt
import json
import logging
import sys
import threading
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self, TextIO

import click

from swarmwright.cli._options import WholeNumber
from swarmwright.cli._output import replace_nonfinite
from swarmwright.common.errors import InputError

if TYPE_CHECKING:
    from swarmwright.servers.evaluation.reports import Report

LEVELS = ("debug", "info", "warning", "error")
_NAMES = {logging.WARNING: "warning", logging.ERROR: "error", logging.CRITICAL: "error"}


def log_options(command: Any) -> Any:  # noqa: ANN401 - click's decorators
    """Add `--log FILE`, `--log-level LEVEL` and `--log-size MIB`."""
    file = click.option(
        "--log",
        type=click.Path(path_type=Path, dir_okay=False, allow_dash=True),
        help="Append events to FILE, one JSON object per line; - is standard error.",
    )
    level = click.option(
        "--log-level",
        type=click.Choice(LEVELS),
        default="info",
        show_default=True,
        help="Lowest level to log.",
    )
    size = click.option(
        "--log-size",
        type=WholeNumber(min=1, max=2**20),
        metavar="MIB",
        help="Rename the log to FILE.1 before it exceeds this size. Default: 64 for `broker`, else "
        "unlimited.",
    )
    return file(level(size(command)))


class Log:
    """A log of events; as a context manager, it logs the error that ends the command.

    Args:
        file: path, `-` for standard error, None for no log.
        level: lowest level to write.
        size: MiB at which the file is moved to FILE.1; None for no limit.

    The engine writes the file, including its own events, mainly of the embedded broker.
    """

    def __init__(self, file: Path | None, level: str = "info", *, size: int | None = None) -> None:
        self._least = LEVELS.index(level)
        self._lock = threading.Lock()
        self._active = False
        self._stream: TextIO | None = None
        self._handler: logging.Handler | None = None
        if file is None:
            return
        from swarmwright import _engine

        dash = str(file) == "-"
        try:
            if not dash:
                file.open("a", encoding="utf-8").close()
            _engine.log_to(None if dash else str(file), level, None if size is None else size << 20)
        except OSError as error:
            raise InputError(f"--log {file}: {error.strerror or error}") from error
        self._active = True
        self._stream = sys.stderr if dash else None

    def __bool__(self) -> bool:
        return self._active

    def __enter__(self) -> Self:
        if self:
            self._handler = _Handler(self)
            logging.getLogger("swarmwright").addHandler(self._handler)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if isinstance(error, KeyboardInterrupt):
            self.write("info", "interrupted")
        elif error is not None:
            self.write("error", "failed", message=str(error), kind=type(error).__name__)
        if self._handler is not None:
            logging.getLogger("swarmwright").removeHandler(self._handler)
        self._active = False

    def write(self, level: str, event: str, /, **fields: object) -> None:
        """Write a line, unless its level is too low; None values are left out."""
        if not self._active or LEVELS.index(level) < self._least:
            return
        moment = dt.datetime.now(dt.UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
        fields = {key: value for key, value in fields.items() if value is not None}
        line = {"time": moment, "level": level, "event": event, **fields}
        text = json.dumps(replace_nonfinite(line), default=str)
        if self._stream is None:
            from swarmwright import _engine

            _engine.log_line(text)
            return
        try:
            with self._lock:
                self._stream.write(text + "\n")
                self._stream.flush()
        except OSError:
            self._active = False  # a closed pipe does not end a run

    def report(self, report: "Report") -> None:
        """Write a pool's report, see `_engine.Pool.listen`."""
        fields = {key: value for key, value in report.items() if key != "event"}
        event = str(report["event"])
        match event:
            case "status":
                status = fields["status"]
                keys = ("run", "generation", "done", "total", "no_server")
                waits = status["waiting_for"][:1]
                self.write("debug", event, **{key: status.get(key) for key in keys}, waiting_for=waits)
            case "server":
                state = fields.pop("state")
                self.write("warning" if state == "lost" else "info", f"server_{state}", **fields)
            case "attempt" if fields["outcome"] == "done":
                self.write("debug", event, **fields)
            case "attempt" if fields["outcome"] in {"overtaken", "dropped"}:
                self.write("debug", "attempt_overtaken", **fields)
            case "attempt":
                self.write("warning", "attempt_failed", **fields)
            case "broker_back":
                self.write("info", event, **fields)
            case _:
                self.write("warning", event, **fields)


class _Handler(logging.Handler):
    """Warnings of the library."""

    def __init__(self, log: Log) -> None:
        super().__init__(logging.WARNING)
        self._log = log

    def emit(self, record: logging.LogRecord) -> None:
        self._log.write(_NAMES.get(record.levelno, "warning"), "warning", message=record.getMessage())

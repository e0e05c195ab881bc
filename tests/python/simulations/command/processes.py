"""Experiments with commands, and the processes that they must not leave."""

import os
import secrets
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from swarmwright import Experiment, RunError, simulate


class Traced:
    """Runs commands whose processes, and all below them, can be found by a variable of their environment."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.mark = secrets.token_hex(8)

    def experiment(self, command: Any, *, fitness: str | None = None, **definition: Any) -> Experiment:
        values: dict[str, Any] = {
            "simulation": {
                "command": command,
                "folder": str(self.folder),
                "work": str(self.folder / "work"),
                "environment": {"TRACED": self.mark},
                **({} if definition.get("controller") == "stepwise" else {"log": "log.csv"}),
                **definition,
            },
            "controller": {
                "kind": "parameter_set",
                "parameters": {"speed": {"type": "real", "range": [0, 1]}},
            },
            "method": {"kind": "random_search", "population": 2, "generations": 1},
            "servers": "in-process",
        }
        if fitness is not None:
            values["fitness"] = fitness
        return Experiment.from_mapping(values)

    def shell(self, script: str, **definition: Any) -> Experiment:
        return self.experiment(["sh", "-c", script], **definition)

    def fails(self, script: str, **definition: Any) -> str:
        """The reason why an episode fails, after which nothing of it is left."""
        with pytest.raises(RunError) as raised:
            simulate(self.shell(script, **definition))
        assert self.left() == []
        return str(raised.value)

    def left(self, within: float = 0.0) -> list[str]:
        """Commands of processes that still run."""
        until = time.monotonic() + within
        while (found := self._found()) and time.monotonic() < until:
            time.sleep(0.02)
        return found

    def describe(self) -> str:
        """What these processes do, for a failure that shows itself rarely."""
        lines = []
        for entry in self._entries():
            lines.append(f"process {entry.name}")
            for name in ("cmdline", "status", "wchan", "syscall", "stack"):
                with suppress(OSError):
                    text = (entry / name).read_bytes().replace(b"\0", b" ").decode("utf-8", "replace")
                    lines.append(f"{name}: {text.strip()}")
        return "\n".join(lines)

    def _found(self) -> list[str]:
        found = []
        for entry in self._entries():
            with suppress(OSError):
                found.append((entry / "cmdline").read_bytes().replace(b"\0", b" ").decode())
        return found

    def _entries(self) -> list[Path]:
        found = []
        for entry in Path("/proc").glob("[0-9]*"):
            try:
                marked = f"TRACED={self.mark}".encode() in (entry / "environ").read_bytes()
                ended = (entry / "stat").read_text().rpartition(")")[2].split()[0] in "ZX"
            except OSError:
                continue
            if marked and not ended and int(entry.name) != os.getpid():
                found.append(entry)
        return found


def running(word: str) -> list[str]:
    """Return the command lines of what runs with a word in it."""
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        with suppress(OSError):
            line = path.read_bytes().replace(b"\0", b" ").decode("utf-8", "replace")
            if word in line:
                found.append(line)
    return found


WELL = "printf 'fitness\\n1.5\\n' > log.csv"
"""What a command does that goes well."""

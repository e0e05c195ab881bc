"""Programs that compile and run what was exported."""

import os
import shlex
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.errors import InputError, RunError
from swarmwright.export.sequences import Sequences

_TIME_OUT_S = 600
_TOLD = 2000
"""Characters of a program's errors that are repeated."""


def command(
    variable: str, names: Sequence[str], install: str, *, needed_by: str = "verification"
) -> list[str]:
    """Return a program and its first arguments: what an environment variable says, or the first on the path.

    needed_by: begins the message without it.

    Raises InputError, which says what to install, when there is none.
    """
    named = os.environ.get(variable)
    if named:
        words = shlex.split(named)
        if words and shutil.which(words[0]):
            return words
        raise InputError(f"{variable}={named}: there is no such program")
    for name in names:
        if shutil.which(name):
            return [name]
    raise InputError(
        f"{needed_by} needs {names[0]}, which is not installed: {install}, or name one with {variable}"
    )


def standard_option(compiler: Sequence[str], standard: str) -> list[str]:
    """Return the option for a standard of C or C++; none where the words that name the compiler have one."""
    named = any(word == "-ansi" or word.startswith(("-std=", "--std=")) for word in compiler)
    return [] if named else [f"-std={standard}"]


def run(
    words: Sequence[str], folder: Path, what: str, data: bytes = b"", *, during: str = "verification"
) -> bytes:
    """Run a program; return what it printed. Raises RunError with its errors when it fails."""
    try:
        done = subprocess.run(
            list(words), cwd=folder, input=data, capture_output=True, timeout=_TIME_OUT_S, check=False
        )
    except subprocess.TimeoutExpired:
        raise RunError(f"{during}: {what} did not end within {_TIME_OUT_S} s") from None
    except OSError as error:
        raise RunError(f"{during}: {what}: {words[0]}: {error.strerror}") from error
    if done.returncode:
        said = (done.stderr or done.stdout).decode(errors="replace").strip()[-_TOLD:]
        said = f":\n{said}" if said else f", and printed nothing: {shlex.join(words)}"
        raise RunError(f"{during}: {what} ended with status {done.returncode}{said}")
    return done.stdout


def stepped(output: bytes, sequences: Sequences, what: str) -> NDArray[np.float32]:
    """Return the actuators that a harness wrote: a row of floats a step, first whether it was accepted.

    A step that was refused because of an overflow has the engine's actuators.

    Raises RunError when rows are missing, when a step was refused or accepted wrongly, or when a refused step
    wrote actuators.
    """
    width = 1 + sequences.actuators.shape[1]
    if len(output) != 4 * width * len(sequences):
        raise RunError(
            f"verification: {what} wrote {len(output)} bytes, expected {4 * width * len(sequences)}"
        )
    rows = np.frombuffer(output, np.float32).reshape(-1, width)
    overflowed = sequences.accepted & (rows[:, 0] == 0)
    overflowed &= False if sequences.may_overflow is None else sequences.may_overflow
    wrong = np.flatnonzero((rows[:, 0] != 0) != (sequences.accepted & ~overflowed))
    if len(wrong):
        did = "refused" if sequences.accepted[wrong[0]] else "accepted"
        raise RunError(f"verification: {what} {did} the sensors {sequences.sensors[wrong[0]].tolist()}")
    if (rows[~sequences.accepted | overflowed, 1:] != UNTOUCHED).any():
        raise RunError(f"verification: {what} wrote actuators for sensors that it refused")
    return np.where(overflowed[:, None], sequences.actuators, rows[:, 1:])


UNTOUCHED = 7.0
"""What harnesses write to actuators before each step."""


def steps(sequences: Sequences) -> bytes:
    """Return what a harness reads: a row of floats a step, first whether to reset, then the sensors."""
    rows = np.column_stack([sequences.first.astype(np.float32), sequences.sensors])
    return np.ascontiguousarray(rows, np.float32).tobytes()

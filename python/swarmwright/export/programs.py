"""Programs that compile and run exported controllers."""

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
_LONGEST_ERROR = 2000
"""Largest number of characters of a program's errors in messages."""


def find_command(
    variable: str, names: Sequence[str], install: str, *, needed_by: str = "verification"
) -> list[str]:
    """Find a program: the command of an environment variable, or the first of the names on the path.

    needed_by: beginning of the message if it is missing.

    Raises InputError, which names the package to install, if there is none.
    """
    configured = os.environ.get(variable)
    if configured:
        words = shlex.split(configured)
        if words and shutil.which(words[0]):
            return words
        raise InputError(f"{variable}={configured}: program not found")
    for name in names:
        if shutil.which(name):
            return [name]
    raise InputError(f"{needed_by} needs {names[0]}, which is not installed: {install}, or set {variable}")


def standard_option(compiler: Sequence[str], standard: str) -> list[str]:
    """Return the option for a standard of C or C++; empty if the command of the compiler has one."""
    is_set = any(word == "-ansi" or word.startswith(("-std=", "--std=")) for word in compiler)
    return [] if is_set else [f"-std={standard}"]


def run(
    words: Sequence[str], folder: Path, label: str, data: bytes = b"", *, during: str = "verification"
) -> bytes:
    """Run a program; return its output. Raises RunError with its errors when it fails."""
    try:
        done = subprocess.run(
            list(words), cwd=folder, input=data, capture_output=True, timeout=_TIME_OUT_S, check=False
        )
    except subprocess.TimeoutExpired:
        raise RunError(f"{during}: {label} did not end within {_TIME_OUT_S} s") from None
    except OSError as error:
        raise RunError(f"{during}: {label}: {words[0]}: {error.strerror}") from error
    if done.returncode:
        output = (done.stderr or done.stdout).decode(errors="replace").strip()[-_LONGEST_ERROR:]
        output = f":\n{output}" if output else f", and printed nothing: {shlex.join(words)}"
        raise RunError(f"{during}: {label} ended with status {done.returncode}{output}")
    return done.stdout


def parse_actuators(output: bytes, sequences: Sequences, label: str) -> NDArray[np.float32]:
    """Parse the actuators written by a harness: a row of floats per step, first whether it was accepted.

    Steps refused because of an overflow have the engine's actuators.

    Raises RunError when rows are missing, when a step was refused or accepted wrongly, or when a refused step
    wrote actuators.
    """
    width = 1 + sequences.actuators.shape[1]
    if len(output) != 4 * width * len(sequences):
        raise RunError(
            f"verification: {label} wrote {len(output)} bytes, expected {4 * width * len(sequences)}"
        )
    rows = np.frombuffer(output, np.float32).reshape(-1, width)
    overflowed = sequences.accepted & (rows[:, 0] == 0)
    overflowed &= False if sequences.may_overflow is None else sequences.may_overflow
    wrong = np.flatnonzero((rows[:, 0] != 0) != (sequences.accepted & ~overflowed))
    if len(wrong):
        did = "refused" if sequences.accepted[wrong[0]] else "accepted"
        raise RunError(f"verification: {label} {did} the sensors {sequences.sensors[wrong[0]].tolist()}")
    if (rows[~sequences.accepted | overflowed, 1:] != UNTOUCHED).any():
        raise RunError(f"verification: {label} wrote actuators for sensors that it refused")
    return np.where(overflowed[:, None], sequences.actuators, rows[:, 1:])


UNTOUCHED = 7.0
"""Value of actuators that harnesses set before each step."""


def format_steps(sequences: Sequences) -> bytes:
    """Format the input of a harness: a row of floats per step, first whether to reset, then the sensors."""
    rows = np.column_stack([sequences.first.astype(np.float32), sequences.sensors])
    return np.ascontiguousarray(rows, np.float32).tobytes()

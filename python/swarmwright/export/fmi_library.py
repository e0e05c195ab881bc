"""The library that FMUs of simulations hold: part of the wheel, in a checkout compiled when first needed.

Few users export such FMUs, and compiling it takes a good part of the time that the engine takes.
"""

import logging
import os
import subprocess
from pathlib import Path

from swarmwright.common.errors import InputError, RunError
from swarmwright.common.untrusted import one_line

FILE = Path(__file__).parents[1] / "simulations" / "fmu" / "libswarmwright_fmi.so"
"""The library; its source is the crate engine/bindings/fmi."""
_CHECKOUT = Path(__file__).parents[3]
_LINES = 5
"""Of the output of a failed build, the last ones, which name the cause."""
_progress = logging.getLogger("swarmwright.progress")


def read() -> bytes:
    """Return the library, after compiling it where that has not been done.

    Raises InputError where it is missing and there is no source, and RunError where it cannot be compiled.
    """
    try:
        return FILE.read_bytes()
    except FileNotFoundError:
        _build()
    return FILE.read_bytes()


def _build() -> None:
    """Compile the library, as `make` does it. Raises InputError and RunError."""
    if not (_CHECKOUT / "engine" / "bindings" / "fmi" / "Cargo.toml").is_file():
        raise InputError(
            f"{FILE}: is missing, the library that an FMU of a simulation holds; installing Swarmwright "
            "again brings it back"
        )
    _progress.info("compiling the library that FMUs of simulations hold, once: this may take a minute")
    # Of a `make` that started this process.
    environment = {key: value for key, value in os.environ.items() if not key.startswith(("MAKE", "MFLAGS"))}
    try:
        done = subprocess.run(
            ["make", "--no-print-directory", "fmi"],
            cwd=_CHECKOUT,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            check=False,
        )
    except FileNotFoundError as error:
        raise RunError(
            f"{FILE}: cannot be compiled: there is no program `make`; install it, or Swarmwright from a wheel"
        ) from error
    if done.returncode or not FILE.exists():
        said = "; ".join(one_line(line) for line in done.stdout.splitlines()[-_LINES:] if line.strip())
        raise RunError(f"{FILE}: cannot be compiled: `make fmi` failed: {said or 'it printed nothing'}")

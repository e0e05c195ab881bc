"""The example servers in JavaScript and Go, built where they are missing or older than their sources."""

import shutil
import subprocess
from functools import cache
from pathlib import Path

from tests.conftest import ROOT

EXAMPLES = ROOT / "wrappers" / "examples"
JAVASCRIPT = EXAMPLES / "javascript"
GO = EXAMPLES / "go"


def _run(folder: Path, program: str, *arguments: str) -> None:
    found = shutil.which(program)
    assert found, f"{program} is missing; `make test-peers` installs it"
    done = subprocess.run(
        [found, *arguments], cwd=folder, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr


def _install(folder: Path) -> None:
    """What package-lock.json names."""
    lock, installed = folder / "package-lock.json", folder / "node_modules" / ".package-lock.json"
    if not installed.exists() or installed.stat().st_mtime < lock.stat().st_mtime:
        _run(folder, "npm", "ci", "--no-audit", "--no-fund", "--loglevel=error")
        installed.touch()


@cache
def javascript() -> Path:
    """The server's script, with mqtt.js beside it."""
    _install(JAVASCRIPT)
    return JAVASCRIPT / "line_server.mjs"


@cache
def contract() -> Path:
    """The folder `protocol`, with AsyncAPI's tools, ajv and mqtt.js in it."""
    _install(ROOT / "protocol")
    return ROOT / "protocol"


@cache
def go() -> Path:
    """The server's program."""
    binary = GO / "line-server"
    newest = max((GO / name).stat().st_mtime for name in ("main.go", "go.mod", "go.sum"))
    if not binary.exists() or binary.stat().st_mtime < newest:
        _run(GO, "go", "build", "-o", binary.name, ".")
    return binary


def commands() -> dict[str, str]:
    """What starts each, with {broker} and {id}."""
    return {"JavaScript": f"node {javascript()} {{broker}} {{id}}", "Go": f"{go()} {{broker}} {{id}}"}

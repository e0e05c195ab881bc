"""The same records with every instruction set, and on another processor."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from swarmwright import _engine
from tests.system.records import EXPERIMENTS, METHODS, digests

ROOT = Path(__file__).parents[2]
ARM64 = os.environ.get("SWARMWRIGHT_ARM64", "")
SETS = [name for name in _engine.levels() if name != "scalar"]


@pytest.fixture(scope="module")
def expected() -> dict[str, str]:
    found = digests()
    assert len(set(found.values())) == len(METHODS) * len(EXPERIMENTS)
    return found


@pytest.mark.parametrize("instructions", SETS)
def test_runs_of_all_methods(instructions: str, expected: dict[str, str]) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "tests.system.records"],
        cwd=ROOT,
        env={**os.environ, "SWARMWRIGHT_INSTRUCTIONS": instructions},
        capture_output=True,
        check=True,
    )
    assert json.loads(done.stdout) == expected


@pytest.mark.timeout(900)
@pytest.mark.skipif(not ARM64, reason="make test-arm64 compiles the engine for it")
def test_runs_of_all_methods_on_arm64(expected: dict[str, str]) -> None:
    """Python, NumPy and the engine are those for arm64; qemu runs them."""
    folder = Path(ARM64)
    python = ["qemu-aarch64", "-L", str(folder / "root"), str(folder / "root/usr/bin/python3.11")]
    paths = os.pathsep.join(map(str, (folder / "package", folder / "site", ROOT)))
    environment = {**os.environ, "PYTHONPATH": paths}
    machine = [*python, "-c", "import platform; print(platform.machine())"]
    assert subprocess.check_output(machine, env=environment, text=True) == "aarch64\n"
    done = subprocess.run(
        [*python, "-m", "tests.system.records"],
        cwd=folder,
        env=environment,
        capture_output=True,
        check=True,
    )
    assert json.loads(done.stdout) == expected


def test_an_unknown_instruction_set() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "swarmwright", "runs"],
        env={**os.environ, "SWARMWRIGHT_INSTRUCTIONS": "mmx"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert done.stderr == (
        f"swarmwright: SWARMWRIGHT_INSTRUCTIONS=mmx: expected {' or '.join(SETS)}, "
        "the instruction sets of this processor that the library was compiled for\n"
    )

"""The wheel: its tag, its contents, and its commands on a machine without Rust."""

import email
import json
import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from tests.wheel.conftest import Installed, variables

pytestmark = pytest.mark.timeout(600)  # the first test installs it

LARGEST = 40 << 20
"""Bytes; without debug symbols it has half of that."""


def test_what_systems_it_is_for(wheel: Path) -> None:
    name = re.fullmatch(r"swarmwright-[\d.]+-cp311-abi3-([\w.]+)\.whl", wheel.name)
    assert name, wheel.name
    tags = name[1].split(".")
    shown = subprocess.run(
        [sys.executable, "-m", "auditwheel", "show", str(wheel)], capture_output=True, text=True, check=True
    ).stdout
    found = re.search(r'consistent\s+with\s+the\s+following\s+platform\s+tag:\s+"(\w+)"', shown)
    assert found, shown
    assert found[1] in tags
    glibc = re.fullmatch(r"manylinux_2_(\d+)_\w+", found[1])
    assert glibc, found[1]
    assert int(glibc[1]) <= int(os.environ.get("SWARMWRIGHT_WHEEL_GLIBC", "2.39").split(".")[1])


def test_what_is_in_it(wheel: Path) -> None:
    assert wheel.stat().st_size < LARGEST
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        (meta,) = (name for name in names if name.endswith(".dist-info/METADATA"))
        metadata = email.message_from_bytes(archive.read(meta))
    assert all(name.startswith("swarmwright") for name in names)
    assert not [name for name in names if "/tests/" in name or name.endswith((".rs", ".pyc"))]
    for name in ("_engine.abi3.so", "_engine.pyi", "py.typed", "simulations/fmu/libswarmwright_fmi.so"):
        assert f"swarmwright/{name}" in names
    assert {"swarmwright/third-party-licenses.txt", "swarmwright_files/__init__.py"} <= set(names)
    assert any(name.endswith(".dist-info/licenses/LICENSE") for name in names)
    assert metadata["License-Expression"] == "Apache-2.0"
    assert metadata["Requires-Python"] == ">=3.11"
    assert metadata.get_all("Project-URL")
    assert "swarm" in str(metadata["Summary"])
    assert metadata["Description-Content-Type"].startswith("text/markdown")


def test_programs_are_for_the_processor(wheel: Path, processor: str, home: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        libraries = {name: archive.read(name)[:20] for name in archive.namelist() if name.endswith(".so")}
    assert len(libraries) == 2
    for name, header in libraries.items():
        assert header[:4] == b"\x7fELF", name
        assert int.from_bytes(header[18:20], "little") == {"x86_64": 62, "aarch64": 183}[processor], name
    code = "import platform, swarmwright; print(platform.machine(), swarmwright.__version__)"
    command = [str(home / "python"), "-P", "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=variables(home))
    assert done.stdout.split() == [processor, wheel.name.split("-")[1]]


def test_there_is_no_rust(home: Path) -> None:
    path = variables(home)["PATH"]
    assert [shutil.which(name, path=path) for name in ("cargo", "rustc", "cc", "gcc")] == [None] * 4


def test_an_example_evolves(installed: Installed, tmp_path: Path) -> None:
    (tmp_path / "my.yaml").write_text(installed("new", "minisim").stdout)
    arguments = ("--set", "method.generations=3", "--set", "method.population=20", "--json")
    records = []
    for servers in ("local", "2"):
        done = installed("optimize", "my.yaml", "--servers", servers, "--out", f"of-{servers}", *arguments)
        assert done.returncode == 0, done.stderr
        records.append(json.loads(done.stdout.splitlines()[-1])["best"])
    assert records[0] == records[1]


def test_a_simulation_leaves_as_an_fmu(installed: Installed, tmp_path: Path) -> None:
    done = installed("export-fmu", "minisim", "--fmi", "3", "--output", "minisim.fmu")
    assert done.returncode == 0, done.stderr
    with zipfile.ZipFile(tmp_path / "minisim.fmu") as archive:
        assert any(name.endswith(".so") for name in archive.namelist())


def test_servers_on_a_broker(installed: Installed, home: Path, tmp_path: Path) -> None:
    program = str(home / "swarmwright")
    running = []

    def start(*arguments: str) -> dict[str, object]:
        process = subprocess.Popen(
            [program, *arguments, "--json"],
            stdout=subprocess.PIPE,
            text=True,
            env=variables(home),
            cwd=tmp_path,
        )
        running.append(process)
        assert process.stdout is not None
        event: dict[str, object] = json.loads(process.stdout.readline())
        return event

    try:
        url = str(start("broker", "--port", "0")["url"])
        start("serve", "minisim", "--broker", url)
        (tmp_path / "my.yaml").write_text(installed("new", "minisim").stdout)
        done = installed(
            "optimize", "my.yaml", "--broker", url, "--set", "method.generations=2", "--out", "run"
        )
        assert done.returncode == 0, done.stderr
    finally:
        for process in reversed(running):
            process.terminate()
            process.communicate()
    assert [process.returncode for process in running] == [0, 0]

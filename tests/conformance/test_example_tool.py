"""The tool of `docs/how-to/peers.md` works with servers that know nothing of Swarmwright."""

import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.conftest import ROOT
from tests.examples import commands

PAGES = ROOT / "docs" / "how-to"


def write_programs(page: str, folder: Path) -> None:
    """Write the programs of a page into a folder."""
    source = (PAGES / page).read_text(encoding="utf-8")
    for name, text in re.findall(r"^```python file=(\S+)\n(.*?)^```$", source, re.MULTILINE | re.DOTALL):
        (folder / name).write_text(text, encoding="utf-8")


@contextmanager
def running(command: str, broker: str) -> Iterator[None]:
    """A server, until the block ends."""
    words = [word.format(broker=broker, id=2**40) for word in shlex.split(command)]
    server = subprocess.Popen(words, stdout=subprocess.DEVNULL)
    try:
        yield
    finally:
        server.terminate()
        server.wait(10)


def evolved(folder: Path, broker: str) -> str:
    """What the tool prints."""
    words = [sys.executable, str(folder / "evolve.py"), broker, "line", "1", "1", "1"]
    done = subprocess.run(words, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.timeout(400)  # it may fetch and build them
def test_servers_from_d61_alone_give_the_same_fitness(embedded_broker: str, tmp_path: Path) -> None:
    write_programs("write-a-tool.md", tmp_path)
    found = []
    for command in commands().values():
        with running(command, embedded_broker):
            found.append(evolved(tmp_path, embedded_broker))
    assert found[0] == found[1]
    assert len(found[0].splitlines()) > 1, "it finds better candidates"


def test_the_server_of_the_other_page_is_used(embedded_broker: str, tmp_path: Path) -> None:
    for page in ("write-a-tool.md", "write-a-peer.md"):
        write_programs(page, tmp_path)
    with running(f"{sys.executable} {tmp_path / 'line_server.py'} {{broker}} {{id}}", embedded_broker):
        assert len(evolved(tmp_path, embedded_broker).splitlines()) > 1

import os
import signal
import time
from pathlib import Path
from typing import Any

import pytest

from swarmwright import Run
from tests.python.cli.processes import children

pytestmark = pytest.mark.slow

EXPERIMENT = """\
simulation: minisim
method: {kind: nnga, population: 30, generations: 1000000}
timeouts: {step: 30}
faults: {backup: false}
"""
GENERATION = " of 1000000 generations  best "


def test_it_is_said_who_is_waited_for(start: Any, tmp_path: Path) -> None:
    (tmp_path / "x.yaml").write_text(EXPERIMENT)
    process = start("optimize", "x.yaml", "--servers", "2", "--out", "result")
    assert GENERATION in process.stdout.readline()
    servers = children(process.pid)
    os.kill(servers[0], signal.SIGSTOP)
    began = time.monotonic()
    try:
        # On a busy machine, a server is named later than the pause is.
        line = next(line for line in process.stdout if " episodes; " in line and "server " in line)
    finally:
        os.kill(servers[0], signal.SIGCONT)
    assert 1.5 < time.monotonic() - began < 40
    assert "s" in line.split("server ")[1]
    # The server wakes up and the run goes on.
    assert next(line for line in process.stdout if GENERATION in line)


def test_a_reader_that_leaves_while_somebody_is_waited_for(start: Any, tmp_path: Path) -> None:
    (tmp_path / "x.yaml").write_text(EXPERIMENT)
    process = start("optimize", "x.yaml", "--servers", "2", "--out", "result")
    assert GENERATION in process.stdout.readline()
    server = children(process.pid)[0]
    os.kill(server, signal.SIGSTOP)
    process.stdout.close()
    time.sleep(2.5)
    os.kill(server, signal.SIGCONT)
    assert process.wait(20) == 130
    told = process.stderr.read()
    assert told.startswith("swarmwright: standard output was closed by its reader, so the run ended early")
    assert "resume result" in told
    assert len(Run.open(tmp_path / "result").history) >= 1

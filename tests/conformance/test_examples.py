"""The servers in JavaScript and Go that were written from D6.1's text alone."""

import shlex
import subprocess
from pathlib import Path

import pytest

from swarmwright import _engine
from swarmwright.conformance import check_server
from tests.conftest import Run
from tests.examples import commands

LINE = """\
simulation: line
requirements: {{dimensions: 1}}
parameters: {{start: -3.0}}
sensors: 1
actuators: 1
controller: {{kind: layered, hidden: [4]}}
method: {{kind: nnga, population: 10, generations: 3}}
broker: {broker}
"""


@pytest.mark.timeout(400)  # it may fetch and build them
@pytest.mark.parametrize("language", ["JavaScript", "Go"])
def test_it_keeps_d61s_rules(language: str) -> None:
    report = check_server(command=commands()[language], simulation="line", actuators=1, profile="d6.1")
    assert report.ok, str(report)
    assert not report.list_ids("skipped")


@pytest.mark.timeout(400)
def test_they_serve_swarmwrights_tool_and_give_the_same_record(program: Run, tmp_path: Path) -> None:
    records = {}
    for language, command in commands().items():
        broker = _engine.Broker()
        (tmp_path / "line.yaml").write_text(LINE.format(broker=broker.url))
        words = [word.format(broker=broker.url, id=7) for word in shlex.split(command)]
        server = subprocess.Popen(words, stdout=subprocess.DEVNULL)
        try:
            done = program("optimize", "line.yaml", "--out", language, "--json")
        finally:
            server.terminate()
            server.wait(10)
            broker.stop()
        assert done.returncode == 0, done.stderr
        exported = program("runs", "export", language, f"{language}.csv")
        assert exported.returncode == 0, exported.stderr
        records[language] = (tmp_path / f"{language}.csv").read_bytes()
    assert records["JavaScript"] == records["Go"]
    assert len(records["Go"].splitlines()) > 20

"""The command: exit status, what it prints, files, what is wrong with its input."""

import json
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from swarmwright import _engine
from tests.conftest import Run

SERVE = f"{sys.executable} -m swarmwright serve minisim --broker {{broker}} --id {{id}}"


def test_a_server_is_tried_and_the_results_are_written(program: Run, tmp_path: Path) -> None:
    options = ("--exec", SERVE, "--parameters", '{"maxSteps": 3}', "--rules", "S1,S2.1", "--junit", "out.xml")
    result = program("conformance", "server", *options, "--json")
    assert result.returncode == 0, result.stderr
    *results, last = [json.loads(line) for line in result.stdout.splitlines()]
    assert [one["id"] for one in results] == [*(f"S1.{number}" for number in range(1, 9)), "S2.1"]
    assert last == {"peer": "server 1 (minisim)", "ok": True, "passed": 9}
    root = ET.parse(tmp_path / "out.xml").getroot()
    assert root.attrib["tests"] == "9"
    assert [suite.attrib["name"] for suite in root] == ["S1 Discovery", "S2 Episodes"]
    assert len(root.findall(".//testcase")) == 9
    sources = {case.attrib["name"][:4]: case.find(".//property") for case in root.findall(".//testcase")}
    assert all(found is not None and found.attrib["name"] == "source" for found in sources.values())
    for one in results:
        found = sources[one["id"]]
        assert found is not None
        assert found.attrib["value"] == one["source"]
    assert results[0]["source"] == "D6.1, 5.2.3; 6.2 Discovery message"
    assert results[4]["source"] == "Swarmwright, protocol.md, An episode, 1"


def test_a_peer_that_runs_is_met_on_the_broker_of_the_environment(program: Run) -> None:
    broker = _engine.Broker()
    command = SERVE.format(broker=broker.url, id=4).split()
    server = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    where = {"SWARMWRIGHT_BROKER": broker.url}
    try:
        result = program("conformance", "server", "--id", "4", "--rules", "S1", env=where)
    finally:
        server.terminate()
        server.wait(10)
        broker.stop()
    assert result.returncode == 0, result.stderr
    assert program("conformance", "server", "--id", "4", "--rules", "S1", env=where).returncode == 1
    # One that the kit starts meets it on a broker of the kit's own.
    started = program("conformance", "server", "--exec", SERVE, "--rules", "S1.1", env=where)
    assert started.returncode == 0, started.stderr
    # Its prefix is that of its broker.
    lab = {**where, "SWARMWRIGHT_PREFIX": "lab1"}
    for more in ((), ("--prefix", "lab2")):
        started = program("conformance", "server", "--exec", SERVE, "--rules", "S1.1", *more, env=lab)
        assert started.returncode == 0, started.stderr


BROKEN = """\
import sys
from tests.conformance.broken.{module} import {name}

server = {name}(sys.argv[1])
server.client._thread.join()
"""


@pytest.mark.parametrize(
    ("module", "name", "rule"), [("messages", "DoesNotClamp", "S4.1"), ("discovery", "WrongEcho", "S1.2")]
)
def test_what_is_broken_is_said_in_full(
    program: Run, tmp_path: Path, root: Path, module: str, name: str, rule: str
) -> None:
    (tmp_path / "server.py").write_text(BROKEN.format(module=module, name=name))
    start = f"{sys.executable} server.py {{broker}}"
    result = program(
        "conformance", "server", "--exec", start, "--rules", "S1,S2,S3,S4.1", "--junit", "out.xml",
        env={"PYTHONPATH": f"{root}/python:{root}"},
    )  # fmt: skip
    assert result.returncode == 1, result.stderr
    text = result.stdout
    assert f"failed   {rule}" in text
    for label in ("came:", "expected:", "fix:"):
        assert label in text
    xml = ET.parse(tmp_path / "out.xml").getroot()
    (failure,) = xml.findall(".//failure")
    assert "fix:" in (failure.text or "")


def test_a_server_that_ends_is_told_from_one_that_fails(program: Run) -> None:
    """It is started anew for the rest, once it was there; one that never was is an error."""
    result = program(
        "conformance", "server", "--exec", f"{sys.executable} -c 'print(7); exit(3)'", "--wait", "5"
    )
    assert result.returncode == 1
    assert "the process ended with 3; it said last:\n      7" in result.stderr


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ((), "The server is missing: give its --id"),
        (("--id", "1", "--rules", "S2.99"), "no rule 'S2.99'"),
        (("--exec", "no-such-program {id}"), "no-such-program"),
        (("--exec", "'"), "cannot be read"),
        (("--exec", "serve {boker} {id}"), "{boker} is not one of the placeholders {broker}, {id}, {prefix}"),
        (("--exec", SERVE, "--vary", "{"), "--vary: is not valid JSON"),
        (("--exec", SERVE, "--parameters", "[1]"), "JSON object"),
        (("--exec", SERVE, "--parameters", "nowhere.json"), "nowhere.json"),
        (("--exec", SERVE, "--parameters", "{"), "not valid JSON"),
        (("--id", "1", "--wait", "0.2"), "name it with --simulation"),
    ],
)
def test_wrong_input(program: Run, options: tuple[str, ...], words: str) -> None:
    result = program("conformance", "server", *options)
    assert result.returncode == 2, result.stdout
    assert words in result.stderr


def test_a_tool_that_ends_at_once_is_said_to_have_sent_nothing(program: Run) -> None:
    start = f"{sys.executable} -c 'print(7); exit(3)'"
    result = program("conformance", "optimizer", "--exec", start, "--rules", "O1.1,O1.2")
    assert result.returncode == 1
    assert "came: no discovery came; the process ended with 3; it said last:" in result.stdout
    assert "not run  O1.2" in result.stdout


def test_the_rules_are_listed(program: Run) -> None:
    result = program("conformance", "server", "--list", "--rules", "S2,-S2.3")
    assert result.returncode == 0
    listed = [line.split()[0] for line in result.stdout.splitlines()]
    assert listed[:3] == ["S2.1", "S2.2", "S2.4"]


def test_a_profile_leaves_out_what_is_swarmwrights(program: Run) -> None:
    result = program("conformance", "server", "--list", "--rules", "S1", "--profile", "d6.1", "--json")
    rules = [json.loads(line) for line in result.stdout.splitlines()]
    assert [rule["id"] for rule in rules] == [f"S1.{number}" for number in (1, 2, 3, 4, 6, 7, 8)]
    assert all(rule["source"].startswith("D6.1, ") for rule in rules)
    wrong = program("conformance", "server", "--list", "--rules", "S1.5,S9", "--profile", "d6.1")
    assert wrong.returncode == 2
    assert "are not rules of D6.1" in wrong.stderr


def test_the_report_is_grouped_by_source(program: Run) -> None:
    options = ("--exec", SERVE, "--parameters", '{"maxSteps": 3}', "--rules", "S1")
    result = program("conformance", "server", *options)
    assert result.returncode == 0, result.stderr
    assert "passed   S1.5   Swarmwright It does not answer if another number" in result.stdout
    assert result.stdout.splitlines()[-3:-1] == [
        "D6.1's rules:        7 passed",
        "Swarmwright's rules: 1 passed",
    ]


def test_what_is_skipped_for_want_of_a_number_is_said(program: Run, root: Path) -> None:
    start = f"{sys.executable} {root}/tests/conformance/least.py {{broker}} {{id}}"
    options = ("--simulation", "least", "--profile", "d6.1", "--rules", "S1.1,S1.2,S2.1,S2.2")
    result = program("conformance", "server", "--exec", start, *options)
    assert result.returncode == 0, result.stderr
    assert "give --actuators N" in result.stderr

"""What peers and files say reaches no terminal as they wrote it, nor can it pose as a line of ours."""

import ast
import contextlib
import json
import os
import pty
import re
import select
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import msgpack
import pytest
from rich.table import Table
from rich.text import Text

import swarmwright.cli
from swarmwright.cli import _output
from swarmwright.cli._output import Output
from tests.conftest import PROGRAM, environment
from tests.system.peer import PRESENCE, STATUS, Peer

HOSTILE = "evil\x1b]0;owned\x07\nserver 99 is ready: x\r\x9b31m\x7f\u202e\u2028server 99 is ready"
SHOWN = r"evil\x1b]0;owned\x07\nserver 99 is ready: x\r\x9b31m\x7f\u202e\u2028server 99 is ready"
UNSAFE = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069]")
FORGED = re.compile(r"^(swarmwright: )?server 99", re.MULTILINE)

Foreign = Callable[..., AbstractContextManager[Any]]

PRESENT = {
    "version": 1,
    "server": 5,
    "state": "busy",
    "simulations": [HOSTILE],
    "capabilities": {"dimensions": 2, "swarmwright": {"version": 1, "metrics": [HOSTILE]}},
    "since": HOSTILE,
    "tool": HOSTILE,
    "host": HOSTILE,
    "pid": 1,
    "instance": "1",
}
AT_WORK = {
    "version": 1,
    "tool": HOSTILE,
    "state": "evaluating",
    "simulation": HOSTILE,
    "run": HOSTILE,
    "done": 1,
    "total": 10,
    "waiting_for": [],
    "servers": [{"server": 5, "mode": "batched", "failures": 1, "benched": 3.0, "reason": HOSTILE}],
    "no_server": {"found": HOSTILE, "seconds": 3.0},
}


def check(said: str) -> None:
    """Nothing steers, nothing is forged."""
    assert not UNSAFE.search(said), ascii(said)
    assert not FORGED.search(said), said


def test_whatever_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    output = Output()
    output.text(HOSTILE)
    output.item(HOSTILE)
    output.block(HOSTILE, indent=" ")
    output.cells([HOSTILE, "a\tb"])
    Output(as_json=True).json({"a": [HOSTILE], HOSTILE: 1})
    _output.complain(HOSTILE)
    _output.print_note(HOSTILE, [HOSTILE])
    said = capsys.readouterr()
    check(said.out)
    check(said.err)
    text, item, more, *_ = said.out.split("\n")
    assert text == SHOWN
    assert item == r"evil\x1b]0;owned\x07"
    assert more.startswith("  server 99 is ready: x"), "what may have several lines has them indented"
    assert said.out.split("\n")[-3] == SHOWN + "\ta\\tb"
    assert json.loads(said.out.split("\n")[-2]) == {"a": [HOSTILE], HOSTILE: 1}


def test_rich_tables_and_text() -> None:
    console = Output().console()
    table = Table()
    table.add_column("x")
    table.add_row(HOSTILE)
    with console.capture() as shown:
        console.print(table, Text(HOSTILE), HOSTILE)
    assert not UNSAFE.search(shown.get())
    assert r"evil\x1b]0;owned" in shown.get()


def test_commands_print_by_the_functions_that_escape() -> None:
    folder = Path(swarmwright.cli.__file__).parent
    # The command line's reference is written from what is ours alone; `replay` draws what it has computed.
    allowed = {("_reference.py", "print"), ("replay.py", "sys.stdout"), ("_main.py", "sys.stdout")}
    allowed |= {("_main.py", "sys.stderr"), ("_observing.py", "sys.stderr")}
    found = set()
    for file in sorted(folder.glob("*.py")):
        if file.name in {"_output.py", "_console.py"}:
            continue
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            words = ast.unparse(node) if isinstance(node, ast.Attribute | ast.Name) else ""
            if words in {
                "print",
                "click.echo",
                "click.secho",
                "sys.stdout.write",
                "sys.stderr.write",
                "Console",
            }:
                found.add((file.name, words.removesuffix(".write")))
            if words in {"sys.stdout", "sys.stderr"} and file.name != "broker.py":
                found.add((file.name, words))
    # Version and help are ours.
    assert found - allowed == {("_commands.py", "click.echo")}


@pytest.fixture
def crowd(embedded_broker: str) -> Iterator[str]:
    """A broker with a hostile server and a hostile tool."""
    with Peer(embedded_broker) as peer:
        peer.publish(f"{PRESENCE}5", json.dumps(PRESENT), retain=True, qos=1)
        ended = threading.Event()

        def tell() -> None:
            while not ended.wait(0.2):
                peer.publish(f"{STATUS}evil", json.dumps(AT_WORK))

        telling = threading.Thread(target=tell)
        telling.start()
        yield embedded_broker
        ended.set()
        telling.join()


def on_terminal(*arguments: str, seconds: float = 3.0) -> str:
    """What a command that ends by Ctrl-C writes to a terminal."""
    ours, its = pty.openpty()
    env = environment({"TERM": "xterm", "COLUMNS": "1000", "LINES": "60", "NO_COLOR": "1"})
    process = subprocess.Popen([*PROGRAM, *arguments], stdin=its, stdout=its, stderr=its, env=env)
    os.close(its)
    said, end = b"", time.monotonic() + 20
    while time.monotonic() < end and select.select([ours], [], [], seconds)[0]:
        with contextlib.suppress(OSError):
            if got := os.read(ours, 65536):
                said += got
                if SHOWN.encode() in said and "--watch" in arguments:
                    break
                continue
        break
    process.terminate()
    process.wait(10)
    os.close(ours)
    return said.decode()


@pytest.mark.slow
def test_servers(crowd: str, program: Any) -> None:
    shown = program("servers", "--broker", crowd)
    check(shown.stdout)
    heading, row = shown.stdout.splitlines()
    assert row.split("\t")[3] == SHOWN
    assert len(row.split("\t")) == len(heading.split("\t"))
    as_json = program("servers", "--broker", crowd, "--json")
    check(as_json.stdout)
    assert json.loads(as_json.stdout)["tool"] == HOSTILE
    drawn = on_terminal("servers", "--broker", crowd)
    assert SHOWN in drawn
    # What rich itself writes: styles.
    check(re.sub("\x1b\\[[0-9;]*m", "", drawn.replace("\r\n", "\n")))


@pytest.mark.journey
def test_the_watch(crowd: str, start: Any) -> None:
    for more in ((), ("--json",)):
        watching = start("servers", "--watch", "--every", "0.2", "--broker", crowd, *more)
        said = ""
        while said.count("evil") < 3:
            said += watching.stdout.readline()
        check(said)
        watching.terminate()
    drawn = on_terminal("servers", "--watch", "--every", "0.2", "--broker", crowd)
    assert SHOWN in drawn
    # What rich itself writes: styles, movements of the cursor, the cursor hidden.
    check(re.sub("\x1b\\[\\??[0-9;]*[a-zA-Z]", "", drawn.replace("\r", "")))


EXPERIMENT = """\
simulation: {title}
requirements: {{dimensions: 1}}
sensors: 2
actuators: 1
controller: {{hidden: [3]}}
method: {{kind: random_search, population: 4, generations: 1}}
timeouts: {{discovery: 2, step: 0.3}}
"""


@contextlib.contextmanager
def failing(broker: str, foreign: Foreign, title: str, *, every: int = 2) -> Iterator[None]:
    """A server that says of every so manieth episode that it failed, for a hostile reason."""
    asked = 0

    def trouble(topic: str, message: dict[str, Any]) -> dict[str, Any] | None:
        return None if topic == "sensor" and not asked % every else message

    with foreign(broker, title, trouble=trouble) as server, Peer(broker) as peer:
        heard = server._on_message

        def on_message(client: Any, userdata: Any, received: Any) -> None:
            nonlocal asked
            message = json.loads(received.payload)
            begins = received.topic == "control" and message.get("run", True)
            asked += begins
            heard(client, userdata, received)
            if begins and not asked % every:
                failed = {"kind": "failed", "version": 1, "server": 77, "reason": HOSTILE, "stack": HOSTILE}
                failed |= {"simulation_hash": message["simulation_hash"]}
                peer.publish(message["reply"], msgpack.packb(failed))

        server.client.on_message = on_message
        yield


@pytest.mark.slow
def test_reasons_of_a_server_in_a_run_and_after_it(
    embedded_broker: str, foreign: Foreign, program: Any, tmp_path: Path
) -> None:
    (tmp_path / "x.yaml").write_text(EXPERIMENT.format(title=json.dumps(HOSTILE)))
    with failing(embedded_broker, foreign, HOSTILE):
        done = program("optimize", "x.yaml", "--broker", embedded_broker, "--out", "run", "--log", "log")
    assert done.returncode == 0, done.stderr
    assert SHOWN in done.stderr
    shown, listed = program("runs", "show", "run"), program("runs", "list", ".")
    assert SHOWN in listed.stdout
    assert r"evil\x1b]0;owned" in shown.stdout
    for said in (done, shown, listed, program("runs", "show", "run", "--json")):
        check(said.stdout)
        check(said.stderr)
    check((tmp_path / "log").read_text())


@pytest.mark.slow
def test_errors_name_peers_and_files(
    embedded_broker: str, foreign: Foreign, program: Any, tmp_path: Path
) -> None:
    (tmp_path / "x.yaml").write_text(EXPERIMENT.format(title="line"))
    with failing(embedded_broker, foreign, "line", every=1):
        tried = [program("simulate", "x.yaml", "--broker", embedded_broker)]
    assert SHOWN in tried[0].stderr
    key = json.dumps(HOSTILE)
    (tmp_path / "keys.yaml").write_text(f"simulation: minisim\n{key}: 1\nmethod: {{kind: {key}, {key}: 2}}\n")
    tried.append(program("optimize", "keys.yaml"))
    tried.append(program("optimize", HOSTILE))
    for one in tried:
        check(one.stdout)
        check(one.stderr)
        assert one.stderr.startswith("swarmwright: ") or not one.returncode
    assert r"evil\x1b]0;owned" in tried[-1].stderr
    assert r"evil\x1b]0;owned" in tried[-2].stderr


SIMULATION = """\
from swarmwright import Simulation

class Evil(Simulation):
    agents = 1
    sensors = 1
    actuators = 1
    def done(self):
        return False
    def reset(self, parameters, seed):
        print({printed!r})
        raise ValueError({text!r})
    def step(self, actuators):
        raise ValueError({text!r})
    def sense(self):
        return [[0.0]]
    def fitness(self):
        return 0.0
"""


@pytest.mark.slow
def test_what_a_simulation_raises_and_prints(program: Any, tmp_path: Path) -> None:
    (tmp_path / "evil.py").write_text(SIMULATION.format(text=HOSTILE, printed=HOSTILE))
    experiment = "simulation: evil.py:Evil\nmethod: {kind: random_search, population: 3, generations: 1}\n"
    (tmp_path / "x.yaml").write_text(experiment + "servers: 1\n")
    done = program("optimize", "x.yaml", "--out", "run", "--server-output")
    assert done.returncode == 1
    assert "The last output of the servers" in done.stderr
    assert "ValueError: evil" in done.stderr
    check(done.stdout)
    check(done.stderr)
    shown, log = (
        program("runs", "show", "run"),
        (tmp_path / "run" / "servers.log").read_text(encoding="utf-8"),
    )
    assert SHOWN.partition("\\n")[0] in log
    check(shown.stdout)
    check(log)
    assert r"\x1e" not in log, "marks of lines are taken out"


@pytest.mark.slow
def test_serve(embedded_broker: str, start: Any, tmp_path: Path) -> None:
    (tmp_path / "evil.py").write_text(SIMULATION.format(text=HOSTILE, printed=""))
    serving = start("serve", "evil.py:Evil", "--id", "5", "--broker", embedded_broker)
    assert serving.stdout.readline().startswith("server 5 (process")
    run = {"server": 5, "simulation_hash": "a" * 64, "simulation": "evil"}
    asked = {"simulation_hash": "a" * 64, "simulation": "evil", "requirements": {"dimensions": 2}}
    with Peer(embedded_broker) as peer:
        peer.send("discovery", **asked)
        peer.send("parameters", **run)
        peer.send("control", **run, run=True, tool=HOSTILE)
        said = ""
        while "\n  ValueError" not in said:
            said += serving.stdout.readline()
    assert f"server 5: Evil.reset: ValueError: {SHOWN}" in said
    check(said)

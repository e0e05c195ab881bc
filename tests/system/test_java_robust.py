"""Simulation servers in Java amid junk, without a broker for a while, behind a password, and watched."""

import signal
import subprocess
from pathlib import Path
from typing import Any

import pytest

from tests.java import JavaServer, jar
from tests.system.brokers import BrokerProcess, Kind
from tests.system.conftest import Experiment, Launch, ServeJava
from tests.system.noise import Noise, leave_retained
from tests.system.peer import PRESENCE, Peer
from tests.system.plain_tool import PlainTool
from tests.system.recorder import Recorder, Referee, check_shapes
from tests.system.runs import record
from tests.system.test_disturbance import LONG
from tests.system.test_visual import PACE, SHOWN, STEPS, steps_of

pytestmark = pytest.mark.timeout(600)  # the first of them builds the jar

LEAVER = """\
import org.swarmwright.*;

public class Leaver implements Simulation {
  private boolean exits;
  private int step;

  public static void main(String[] arguments) {
    SimulationServer.main(arguments, Leaver::new);
  }

  @Override
  public Description description() {
    return Description.of("leaver", 1, 1, 1);
  }

  @Override
  public void reset(ParameterReader parameters) {
    exits = parameters.flag("exits", false);
    step = 0;
  }

  @Override
  public int[] acting() {
    return step < 9 ? new int[] {0} : new int[0];
  }

  @Override
  public void sense(int agent, float[] sensors) {}

  @Override
  public void step(float[] actuators) {
    System.err.println("in a step");
    if (exits) {
      System.exit(3);
    }
    try {
      Thread.sleep(1000);
    } catch (InterruptedException error) {
      throw new IllegalStateException(error);
    }
    step++;
  }

  @Override
  public double fitness() {
    return 0;
  }
}
"""
"""A simulation that ends the program in a step, or whose steps take a second."""


def test_a_run_amid_foreign_traffic(
    broker: BrokerProcess, serve_java: ServeJava, launch: Launch, connect: Any, experiment: Experiment
) -> None:
    path = experiment(LONG.replace("generations: 10", "generations: 3"))
    quiet = launch("optimize", path, "--servers", "local", "--out", "quiet")
    assert quiet.wait() == 0, quiet.stderr
    with Peer(broker.url) as peer:
        leave_retained(peer)
    server = serve_java(broker.url)
    noise: Noise = connect(Noise, broker.url)
    program = launch("optimize", path, "--broker", broker.url, "--out", "noisy")
    assert program.wait(60) == 0, program.stderr
    server.until(lambda _: noise.rounds >= 2, "two rounds of junk")
    assert record(path.parent / "noisy") == record(path.parent / "quiet")
    complaints = [line for line in server.stderr.splitlines() if line.startswith("warning")]
    assert len(complaints) == len(set(complaints)), "each complaint is made once"
    for topic in ("discovery", "parameters", "control", "actuator"):
        assert any("retained" in line and topic in line for line in complaints), complaints
        assert any("refusing" in line and topic in line for line in complaints), complaints
    assert "fault" not in server.stderr
    assert "Exception" not in server.stderr
    assert server.process.poll() is None


@pytest.mark.parametrize("options", [(), ("--plain",)], ids=["server", "plain"])
def test_a_server_comes_back_with_its_broker(
    broker: BrokerProcess, serve_java: ServeJava, connect: Any, options: tuple[str, ...]
) -> None:
    server = serve_java(broker.url, *options, server=4)
    with PlainTool(broker.url) as tool:
        assert tool.begin(4, "a" * 64)["agent"] == 0
        broker.kill()
    broker.start()
    again: PlainTool = connect(PlainTool, broker.url)
    found = None
    for attempt in range(30):
        found = again.discover(f"{attempt:064x}", 0.5)
        if found:
            break
    assert found is not None
    assert found["server"] == 4
    assert (
        "the connection to the broker broke" if options else "given up with the connection"
    ) in server.stderr


def test_a_broker_that_asks_for_a_password(kind: Kind, tmp_path: Path, cleanup: Any) -> None:
    broker = BrokerProcess(kind, tmp_path / "locked", {"lab": "correct horse"})
    cleanup.callback(broker.stop)
    broker.start()
    for password in ("battery staple", "correct horse"):
        account = {"SWARMWRIGHT_USERNAME": "lab", "SWARMWRIGHT_PASSWORD": password}
        if password == "correct horse":
            server = JavaServer(broker.url, cwd=tmp_path, env=account)
            cleanup.callback(server.stop)
        else:
            with pytest.raises(AssertionError, match="ended with 1 before 'ready'"):
                JavaServer(broker.url, cwd=tmp_path, env=account)


def test_a_server_draws_when_the_control_message_says_so(
    embedded: BrokerProcess, serve_java: ServeJava, launch: Launch, connect: Any, experiment: Experiment
) -> None:
    recorder: Recorder = connect(Recorder, embedded.url)
    server = serve_java(embedded.url)
    shown = launch("simulate", experiment(SHOWN), "--broker", embedded.url, "--visual")
    assert shown.wait() == 0, shown.stderr
    recorder.settle()
    assert len(recorder.on("sensor")) == STEPS
    assert all(pause >= 0.9 * PACE for pause in steps_of(recorder))
    assert sum("Hello there, step" in line for line in server.lines) == STEPS + 1
    check_shapes(recorder.messages)
    Referee().follow(recorder.messages)


@pytest.fixture
def leaver(tmp_path: Path) -> str:
    """The folder with the compiled class."""
    source = tmp_path / "Leaver.java"
    source.write_text(LEAVER)
    subprocess.run(["javac", "-cp", str(jar()), str(source)], check=True, timeout=60)
    return str(tmp_path)


@pytest.mark.parametrize("exits", [True, False])
def test_a_program_that_ends_in_a_step(
    broker: BrokerProcess, serve_java: ServeJava, connect: Any, leaver: str, exits: bool
) -> None:
    """One that is asked to leaves in order; one that its simulation ends is declared lost by the broker."""
    server = serve_java(broker.url, main="Leaver", classpath=leaver)
    with PlainTool(broker.url) as tool:
        tool.begin(1, "a" * 64, exits=exits)
        watcher = connect(Peer, broker.url, f"{PRESENCE}+")
        tool.send("actuator", simulation_hash="a" * 64, agent=0, actuator=[0.5])
        server.until_error("in a step")
        if not exits:
            server.signal(signal.SIGTERM)
        assert server.wait(20) == (3 if exits else 128 + signal.SIGTERM)
    seen: list[Any] = []
    while not seen or seen[-1] not in (b"", "lost"):
        message = watcher.inbox.get(timeout=10)
        seen.append(message.json["state"] if message.payload else b"")
    assert seen[-1] == ("lost" if exits else b""), seen
    assert ("could not leave in order" in server.stderr) == exits, server.stderr

"""Agents that see much: sensor messages above 1 MiB, and above what a broker takes."""

import shutil
import subprocess
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.java import jar
from tests.system.brokers import BrokerProcess
from tests.system.conftest import Experiment, Launch, ServeJava
from tests.system.runs import evaluations, warnings

EYE = '''\
import numpy as np

from swarmwright import Simulation


class Eye(Simulation):
    """One agent that sees 170,000 numbers, about 1.9 MB of JSON."""

    sensors = 170_000
    actuators = 1

    def reset(self, parameters, seed):
        self.random, self.left, self.sum = np.random.default_rng(seed), 2, 0.0
        return self.seen()

    def step(self, actions):
        self.sum += float(actions[0, 0])
        self.left -= 1
        return self.seen()

    def seen(self):
        return self.random.uniform(-1, 1, (1, self.sensors))

    def done(self):
        return self.left == 0

    def fitness(self):
        return self.sum
'''
JAVA = """\
import org.swarmwright.*;

public class Eye implements Simulation {
  private int left;
  private double sum;

  public static void main(String[] arguments) {
    SimulationServer.main(arguments, Eye::new);
  }

  public Description description() {
    return Description.of("eye", 2, 170000, 1);
  }

  public void reset(ParameterReader parameters) {
    left = 2;
    sum = 0;
  }

  public int[] acting() {
    return left > 0 ? new int[] {0} : new int[0];
  }

  public void sense(int agent, float[] sensors) {
    for (int i = 0; i < sensors.length; i++) {
      sensors[i] = 0.123456f + i;
    }
  }

  public void step(float[] actuators) {
    sum += actuators[0];
    left--;
  }

  public double fitness() {
    return sum;
  }
}
"""
EXPERIMENT = """\
simulation: eye
mode: stepwise
controller: {kind: layered, hidden: []}
method: {kind: random_search, population: 2, generations: 1}
seed: 3
"""


@pytest.fixture(autouse=True)
def eye(tmp_path: Path) -> None:
    (tmp_path / "eye.py").write_text(EYE, encoding="utf-8")


def test_sensors_of_two_megabytes_are_stepped(
    broker: BrokerProcess, launch: Launch, experiment: Experiment, tmp_path: Path
) -> None:
    launch("serve", "eye.py:Eye", "--broker", broker.url, "--json").until_event("ready")
    tool = launch("optimize", experiment(EXPERIMENT), "--broker", broker.url, "--out", "run")
    assert tool.wait(50) == 0, tool.stderr
    fitness = [value for value, _ in evaluations(tmp_path / "run")]
    assert len(fitness) == 2
    assert all(-2 <= value <= 2 for value in fitness), "none failed"
    assert not warnings(tmp_path / "run")


@pytest.fixture
def narrow(tmp_path: Path, cleanup: ExitStack) -> BrokerProcess:
    """A broker that takes 1 MB."""
    process = BrokerProcess("mosquitto", tmp_path / "narrow")
    with (tmp_path / "narrow" / "mosquitto.conf").open("a") as file:
        file.write("max_packet_size 1000000\n")
    cleanup.callback(process.stop)
    return process.start()


def refused(launch: Launch, experiment: Experiment, broker: BrokerProcess, out: str = "run") -> str:
    """What a run says that cannot be."""
    tool = launch("optimize", experiment(EXPERIMENT), "--broker", broker.url, "--out", out)
    assert tool.wait(20) == 1
    assert "no server can do this work" in tool.stderr
    return tool.stderr


def test_sensors_above_what_the_broker_takes_are_refused_at_once_with_both_figures(
    narrow: BrokerProcess, launch: Launch, experiment: Experiment
) -> None:
    launch("serve", "eye.py:Eye", "--broker", narrow.url, "--json").until_event("ready")
    said = refused(launch, experiment, narrow)
    assert "a sensor message of 1" in said
    assert "is larger than the 1000000 that the broker accepts" in said


@pytest.mark.timeout(600)  # it may have to build the jar
def test_servers_in_java_refuse_them_too(
    narrow: BrokerProcess, serve_java: ServeJava, launch: Launch, experiment: Experiment, tmp_path: Path
) -> None:
    (tmp_path / "Eye.java").write_text(JAVA)
    javac = shutil.which("javac")
    assert javac, "a Java compiler is missing; `make test-peers` installs it"
    subprocess.run([javac, "-cp", str(jar()), "Eye.java"], check=True, timeout=60, cwd=tmp_path)
    server = serve_java(narrow.url, main="Eye", classpath=str(tmp_path))
    said = refused(launch, experiment, narrow)
    assert "a sensor message of 1" in said
    assert "is larger than the 1000000 that the broker accepts" in said
    assert "lost the broker" not in server.stderr
    narrow.kill()
    narrow.start()
    server.until(lambda _: server.stderr.count("\nready") > 1, "the server back on its broker")
    assert refused(launch, experiment, narrow, "again").splitlines()[-1] == said.splitlines()[-1]
    assert server.process.poll() is None

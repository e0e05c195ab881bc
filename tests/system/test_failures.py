"""What breaks in a user's simulation reaches the tool in every mode; the server works on."""

import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.java import jar
from tests.system.brokers import BrokerProcess
from tests.system.conftest import Experiment, Launch, ServeJava
from tests.system.processes import Program
from tests.system.runs import attempts, evaluations, record, warnings

pytestmark = pytest.mark.timeout(600)  # the first of them builds the jar

JAVA = """\

import org.swarmwright.*;

public class Fragile implements Simulation {
  private long seed;
  private double x;
  private int step;

  public static void main(String[] arguments) {
    SimulationServer.main(arguments, Fragile::new);
  }

  public Description description() {
    return Description.of("fragile", 1, 1, 1);
  }

  public void reset(ParameterReader parameters) {
    seed = parameters.seed("seed");
    x = 0;
    step = 0;
  }

  public int[] acting() {
    return step < 5 ? new int[] {0} : new int[0];
  }

  public void sense(int agent, float[] sensors) {
    sensors[0] = (float) x;
  }

  public void step(float[] actuators) {
    x += actuators[0];
    step++;
    if (x > 1) {
      throw new IllegalStateException("the wheel came off");
    }
  }

  public double fitness() {
    return x;
  }
}
"""
PYTHON = """\
import swarmwright


class Fragile(swarmwright.Simulation):
    title = "fragile"
    dimensions = 1
    sensors = actuators = 1

    def reset(self, parameters, seed):
        self.x = 0.0
        self.left = 5
        return [[0.0]]

    def done(self):
        return self.left == 0

    def step(self, actions):
        self.x += float(actions[0, 0])
        self.left -= 1
        if self.x > 1:
            raise ArithmeticError("the wheel came off")
        return [[self.x]]

    def fitness(self):
        return self.x
"""
EXPERIMENT = """\
simulation: fragile
requirements: {dimensions: 1}
controller: {kind: layered, hidden: []}
method: {kind: random_search, population: 30, generations: 2}
seed: 1
"""
MODES = ["stepwise", "batched", "offloaded"]


def check(launch: Launch, experiment: Experiment, broker: str, name: str, mode: str) -> list[dict[str, str]]:
    """Evolve on the server; the attempts that failed."""
    path = experiment(f"{EXPERIMENT}mode: {mode}\n")
    program = launch("optimize", path, "--broker", broker, "--out", name)
    assert program.wait() == 0, program.stderr
    fitness = [value for value, _ in evaluations(path.parent / name)]
    failed = [value for value in fitness if value != value]
    assert 0 < len(failed) < len(fitness)
    found = [entry for entry in attempts(path.parent / name) if entry["error"]]
    assert len(found) == 3 * len(failed)
    reasons = {entry["error"] for entry in found}
    for reason in reasons:
        told = [text for text in warnings(path.parent / name) if f"failed on server 1: {reason}" in text]
        assert len(told) == 1, warnings(path.parent / name)
        assert sum(entry["error"] == reason and bool(entry["stack"]) for entry in found) == 1
    return found


@pytest.mark.parametrize("mode", MODES)
def test_in_python(
    embedded: BrokerProcess, launch: Launch, experiment: Experiment, tmp_path: Path, mode: str
) -> None:
    (tmp_path / "fragile.py").write_text(PYTHON)
    serving: Program = launch(
        "serve", "fragile.py:Fragile", "--broker", embedded.url, "--id", 1, "--count", 1, "--json"
    )
    serving.until_event("ready")
    for name in ("first", "second"):
        failed = check(launch, experiment, embedded.url, name, mode)
        line = next(number for number, text in enumerate(PYTHON.splitlines(), 1) if "raise" in text)
        reason = f"Fragile.step: ArithmeticError: the wheel came off (fragile.py:{line})"
        assert {entry["error"] for entry in failed} == {reason}
        (stack,) = filter(None, (entry["stack"] for entry in failed))
        assert stack.startswith("Traceback (most recent call last):"), stack
        assert f'fragile.py", line {line}, in step' in stack
    assert record(tmp_path / "first") == record(tmp_path / "second")
    assert serving.process.poll() is None


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> Callable[[], Path]:
    """The folder with the class in Java."""

    def make() -> Path:
        folder = tmp_path_factory.mktemp("java")
        (folder / "Fragile.java").write_text(JAVA)
        javac = shutil.which("javac")
        assert javac, "a Java compiler is missing; `make test-peers` installs it"
        subprocess.run([javac, "-cp", str(jar()), "Fragile.java"], check=True, timeout=60, cwd=folder)
        return folder

    return make


@pytest.mark.parametrize("mode", MODES)
def test_in_java(
    embedded: BrokerProcess,
    serve_java: ServeJava,
    launch: Launch,
    experiment: Experiment,
    compiled: Callable[[], Path],
    mode: str,
) -> None:
    server = serve_java(embedded.url, main="Fragile", classpath=str(compiled()))
    for name in ("first", "second"):
        failed = check(launch, experiment, embedded.url, name, mode)
        line = next(number for number, text in enumerate(JAVA.splitlines(), 1) if "throw" in text)
        reason = (
            f"the simulation threw java.lang.IllegalStateException: the wheel came off (Fragile.java:{line})"
        )
        assert {entry["error"] for entry in failed} == {reason}
        (stack,) = filter(None, (entry["stack"] for entry in failed))
        assert f"at Fragile.step(Fragile.java:{line})" in stack
    assert server.process.poll() is None


REFUSED = EXPERIMENT.replace("simulation: fragile", "simulation: minisim").replace(
    "{dimensions: 1}", "{dimensions: 2}\nparameters: {maxSteps: many}"
)


@pytest.mark.parametrize("mode", MODES)
def test_parameters_that_are_refused_end_the_run_at_once(
    embedded: BrokerProcess, serve_java: ServeJava, launch: Launch, experiment: Experiment, mode: str
) -> None:
    serve_java(embedded.url)
    path = experiment(f"{REFUSED}mode: {mode}\n")
    program = launch("optimize", path, "--broker", embedded.url, "--out", "refused")
    assert program.wait() != 0
    assert "maxSteps" in program.stderr, program.stderr

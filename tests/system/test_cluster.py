"""Tool and servers go on at the next broker of a cluster when theirs is lost, with the same record."""

from contextlib import ExitStack
from pathlib import Path
from typing import Self

import pytest

from tests.conftest import free_port
from tests.system import lab
from tests.system.brokers import BrokerProcess
from tests.system.conftest import Experiment, Launch, Serve, ServeJava
from tests.system.processes import Program
from tests.system.runs import record

pytestmark = pytest.mark.timeout(600)  # one of them builds the jar

LAB = Path(lab.__file__).absolute()
EXPERIMENT = """\
simulation: {simulation}
requirements: {{dimensions: {dimensions}}}
method: {{kind: nnga, population: 16, generations: {generations}}}
mode: {mode}
seed: 11
"""


class Cluster:
    """Two Mosquittos, of which the second has a bridge to the first for all topics."""

    def __init__(self, folder: Path) -> None:
        self.first = BrokerProcess("mosquitto", folder / "first")
        self.second = BrokerProcess("mosquitto", folder / "second")
        with (folder / "second" / "mosquitto.conf").open("a") as configuration:
            configuration.write(
                f"connection cluster\naddress 127.0.0.1:{self.first.port}\ntopic # both 2\n"
                "bridge_protocol_version mqttv50\nrestart_timeout 1\nnotifications false\n"
            )
        self.url = f"{self.first.url},{self.second.url}"

    def __enter__(self) -> Self:
        self.first.start()
        self.second.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.second.stop()
        self.first.stop()


@pytest.fixture
def cluster(tmp_path: Path, cleanup: ExitStack) -> Cluster:
    """A cluster, started."""
    return cleanup.enter_context(Cluster(tmp_path / "cluster"))


def generations(run: Program) -> int:
    """How many a run has reported."""
    return sum('"best_so_far"' in line for line in run.lines)


def lose(run: Program, broker: BrokerProcess) -> None:
    """Kill a broker while a run that uses it is under way; the run is to end well."""
    run.until(lambda program: generations(program) >= 2, "two generations")
    broker.kill()
    before = generations(run)
    run.until(lambda program: generations(program) > before + 2, "further generations", 60)
    assert run.wait(100) == 0, run.stderr


@pytest.mark.parametrize("mode", ["stepwise", "batched", "offloaded"])
def test_a_run_survives_the_loss_of_a_broker(
    cluster: Cluster, launch: Launch, experiment: Experiment, tmp_path: Path, mode: str
) -> None:
    path = experiment(EXPERIMENT.format(simulation=f"{LAB}:Lab", dimensions=1, generations=30, mode=mode))
    local = launch("optimize", path, "--servers", "local", "--out", "local")
    for server in (1, 2):
        arguments = ["serve", f"{LAB}:Lab", "--broker", cluster.url, "--id", server, "--count", 1, "--json"]
        launch(*arguments).until_event("ready")
    path.write_text(path.read_text().replace(f"{LAB}:Lab", "lab"))
    run = launch("optimize", path, "--broker", cluster.url, "--out", "result", "--json")
    lose(run, cluster.first)
    assert local.wait(100) == 0, local.stderr
    assert record(tmp_path / "result") == record(tmp_path / "local")


def test_servers_in_java_go_on_too(
    cluster: Cluster, launch: Launch, serve_java: ServeJava, experiment: Experiment, tmp_path: Path
) -> None:
    path = experiment(EXPERIMENT.format(simulation="minisim", dimensions=2, generations=600, mode="stepwise"))
    local = launch("optimize", path, "--servers", "local", "--out", "local")
    serve_java(cluster.url)
    run = launch("optimize", path, "--broker", cluster.url, "--out", "result", "--json")
    lose(run, cluster.first)
    assert local.wait(100) == 0, local.stderr
    assert record(tmp_path / "result") == record(tmp_path / "local")


def test_the_first_that_can_be_reached_is_used(
    cluster: Cluster, launch: Launch, serve: Serve, experiment: Experiment
) -> None:
    cluster.first.kill()
    serve(cluster.url)
    run = launch("optimize", experiment(), "--broker", cluster.url)
    assert run.wait(60) == 0, run.stderr


def test_what_is_wrong_with_a_list_is_named(launch: Launch, experiment: Experiment) -> None:
    path = experiment()
    first, second = (f"mqtt://127.0.0.1:{free_port()}" for _ in range(2))
    for urls, status, words in (
        (f"{first},{second}", 1, f"no broker answers at {first} or {second}"),
        (f"{first},http://there", 2, "(address 2 of 2) must begin with one of mqtt://"),
        (f"{first},", 2, "(address 2 of 2) must begin with one of mqtt://"),
    ):
        run = launch("optimize", path, "--broker", urls)
        assert run.wait() == status, run.stderr
        assert words in run.stderr
        assert "Traceback" not in run.stderr

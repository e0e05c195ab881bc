"""C++ servers with broken simulations, under sanitizers: errors reach the tool, and nothing else breaks."""

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.cpp import SANITIZED, CppServer, sanitized
from tests.system.brokers import BrokerProcess
from tests.system.conftest import EXPERIMENT, Experiment, Launch
from tests.system.runs import attempts, evaluations, record

pytestmark = pytest.mark.timeout(600)  # the first of them builds the servers

ServeSanitized = Callable[..., CppServer]
SANITIZER = pytest.mark.parametrize("sanitizer", SANITIZED)

FRAGILE = """\
simulation: fragile
requirements: {dimensions: 1}
controller: {kind: layered, hidden: []}
method: {kind: random_search, population: 30, generations: 2}
ranking: {episodes: 2}
seed: 1
"""


@pytest.fixture
def serve(tmp_path: Path, cleanup: ExitStack) -> ServeSanitized:
    """Starts a server that was compiled with a sanitizer, which is to find nothing: the exit status is 0."""

    def start(url: str, sanitizer: str, main: str, *options: str, server: int = 1) -> CppServer:
        program = CppServer(
            url,
            *options,
            cwd=tmp_path,
            server=server,
            main=sanitized(sanitizer) / main,
            # The engine is not compiled with the sanitizer, which does not see its locks.
            env={"TSAN_OPTIONS": "ignore_noninstrumented_modules=1"},
        )

        def stop() -> None:
            program.stop()
            assert program.process.returncode == 0, program.stderr

        cleanup.callback(stop)
        return program

    return start


@SANITIZER
@pytest.mark.parametrize("main", ["minisim", "minisim_plugin"])
def test_nothing_is_found_in_any_mode(
    embedded: BrokerProcess,
    serve: ServeSanitized,
    launch: Launch,
    experiment: Experiment,
    sanitizer: str,
    main: str,
) -> None:
    serve(embedded.url, sanitizer, main, *(["--threads", "2"] if main == "minisim" else []))
    records = []
    for mode in ("stepwise", "batched", "offloaded"):
        path = experiment(f"{EXPERIMENT}mode: {mode}\n", f"{mode}.yaml")
        program = launch("optimize", path, "--broker", embedded.url, "--out", mode)
        assert program.wait() == 0, program.stderr
        records.append(record(path.parent / mode))
    assert records[0] == records[1] == records[2]


@SANITIZER
@pytest.mark.parametrize("mode", ["stepwise", "batched", "offloaded"])
def test_what_a_simulation_throws_reaches_the_tool(
    embedded: BrokerProcess,
    serve: ServeSanitized,
    launch: Launch,
    experiment: Experiment,
    sanitizer: str,
    mode: str,
) -> None:
    """The episode has failed, the others count, and the server goes on."""
    server = serve(embedded.url, sanitizer, "fragile", "--threads=2")
    path = experiment(f"{FRAGILE}mode: {mode}\n")
    for name in ("first", "second"):
        program = launch("optimize", path, "--broker", embedded.url, "--out", name)
        assert program.wait() == 0, program.stderr
        fitness = [value for value, _ in evaluations(path.parent / name)]
        failed = [value for value in fitness if value != value]
        assert 0 < len(failed) < len(fitness)
        errors = {entry["error"] for entry in attempts(path.parent / name)} - {None, ""}
        assert any("the wheel came off" in error for error in errors), errors
        assert any("because of std::out_of_range: x is more than 1" in error for error in errors), errors
    assert record(path.parent / "first") == record(path.parent / "second")
    assert server.process.poll() is None


@pytest.mark.parametrize(
    ("trouble", "words"),
    [
        ("reset", "std::runtime_error: reset does not work"),
        ("order", "the acting agents must be in ascending order, but 1 comes before 0"),
        ("agent", "agent 7 acts, but there are at most 4 agents, numbered from 0"),
        ("sense", "nothing can be seen"),
        ("nan", "sensors[0] is NaN"),
        ("fitness", "the simulation's fitness is NaN"),
        ("metrics", "metrics() gives 2 numbers, but the description has 1 names"),
    ],
)
def test_each_trouble_is_named(
    embedded: BrokerProcess,
    serve: ServeSanitized,
    launch: Launch,
    experiment: Experiment,
    tmp_path: Path,
    trouble: str,
    words: str,
) -> None:
    server = serve(embedded.url, "address", "fragile", "--polled")
    text = f"{FRAGILE}parameters: {{trouble: {trouble}}}\nfitness: way\nmode: offloaded\n"
    program = launch("optimize", experiment(text), "--broker", embedded.url, "--out", "run")
    program.wait()
    errors = {entry["error"] for entry in attempts(tmp_path / "run")} - {None, ""}
    assert any(words in error for error in errors), (errors, program.stderr)
    assert server.process.poll() is None


@pytest.mark.parametrize("mode", ["stepwise", "batched", "offloaded"])
def test_metrics_of_the_wrong_number_fail_in_every_mode(
    embedded: BrokerProcess, serve: ServeSanitized, launch: Launch, experiment: Experiment, mode: str
) -> None:
    """Also where the experiment wants none of them."""
    serve(embedded.url, "address", "fragile")
    path = experiment(f"{FRAGILE}parameters: {{trouble: metrics}}\nmode: {mode}\n")
    program = launch("optimize", path, "--broker", embedded.url, "--out", "run")
    program.wait()
    words = "metrics() gives 2 numbers, but the description has 1 names"
    errors = {entry["error"] for entry in attempts(path.parent / "run")} - {None, ""}
    assert errors == {f"std::logic_error: {words}"}, program.stderr
    assert all(value != value for value, _ in evaluations(path.parent / "run"))


def test_parameters_that_are_refused_end_the_run(
    embedded: BrokerProcess, serve: ServeSanitized, launch: Launch, experiment: Experiment
) -> None:
    serve(embedded.url, "address", "fragile")
    program = launch("optimize", experiment(f"{FRAGILE}parameters: {{speed: 2}}\n"), "--broker", embedded.url)
    assert program.wait() == 1
    assert "parameter speed: 2 found, expected a number from 0 to 1" in program.stderr

"""Servers of a user's simulation: started by the program, through a broker, and ended."""

import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Experiment, RunError, evaluate
from tests.conftest import environment
from tests.python.cli.processes import gone
from tests.python.cli.test_services import events
from tests.python.simulations import troubled
from tests.python.simulations.troubled import Walk

pytestmark = pytest.mark.slow

FILE = Path(troubled.__file__)
SOURCE = FILE.read_text()


def experiment(**changes: Any) -> Experiment:
    return Experiment.from_mapping({"simulation": "walk", "sensors": 2, "actuators": 1, **changes})


def genomes(count: int = 3) -> Any:
    return np.random.default_rng(1).normal(size=(count, experiment().genome_size)).astype(np.float32)


@pytest.mark.journey
@pytest.mark.parametrize("name", [f"{FILE}:Walk", "walks:Walk"], ids=["file", "module"])
def test_a_class_is_served_by_its_title(name: str, start: Any, any_broker: str, tmp_path: Path) -> None:
    (tmp_path / "walks.py").write_text(SOURCE)
    serving = start("serve", name, "--broker", any_broker, "--id", "60", "--count", "2", "--json")
    assert {event["server"] for event in events(serving, "ready", 2)} == {60, 61}
    here = evaluate(experiment(simulation=Walk), genomes(), servers="in-process")
    for mode in ("stepwise", "batched", "offloaded"):
        one = experiment(requirements={"dimensions": 1}, mode=mode)
        assert evaluate(one, genomes(), broker=any_broker).tobytes() == here.tobytes()
    serving.send_signal(signal.SIGTERM)
    _, err = serving.communicate(timeout=15)
    assert (serving.returncode, err) == (0, "")


def test_the_traceback_is_in_the_servers_log_and_the_server_goes_on(start: Any, embedded_broker: str) -> None:
    serving = start("serve", f"{FILE}:Walk", "--broker", embedded_broker, "--count", "1", "--json")
    (ready,) = events(serving, "ready")
    one = experiment(requirements={"dimensions": 1}, parameters={"trouble": "raise"}, ranking={"episodes": 4})
    assert np.isnan(evaluate(one, genomes(), broker=embedded_broker)).all()
    (failure,) = events(serving, "failure")
    assert failure["server"] == ready["server"]
    assert failure["message"].startswith("Walk.step: IndexError: list index out of range (")
    assert failure["traceback"].startswith("Traceback (most recent call last):")
    assert "_ = [0, 1][int(2" in failure["traceback"]
    sound = one.replace(parameters={"trouble": ""})
    assert np.isfinite(evaluate(sound, genomes(), broker=embedded_broker)).all()


def test_a_server_says_which_parameters_are_not_declared(start: Any, embedded_broker: str) -> None:
    """A tool that knows the title alone cannot check them."""
    serving = start("serve", f"{FILE}:Walk", "--broker", embedded_broker, "--count", "1", "--json")
    events(serving, "ready")
    one = experiment(requirements={"dimensions": 1}, parameters={"step": 3, "zeal": 1})
    assert np.isfinite(evaluate(one, genomes(), broker=embedded_broker)).all()
    assert [event["message"] for event in events(serving, "warning", 2)] == [
        "walk: a tool has set the parameter 'step', which Walk does not declare; did you mean 'steps'?",
        "walk: a tool has set the parameter 'zeal', which Walk does not declare",
    ]


def test_a_person_sees_the_traceback(start: Any, embedded_broker: str) -> None:
    serving = start("serve", f"{FILE}:Walk", "--broker", embedded_broker)
    assert "is ready: walk on" in serving.stdout.readline()
    one = experiment(requirements={"dimensions": 1}, parameters={"trouble": "reset"})
    assert np.isnan(evaluate(one, genomes(), broker=embedded_broker)).all()
    said = ""
    while "LookupError: no start\n" not in said:
        line = serving.stdout.readline()
        assert line, serving.stderr.read()
        said += line
    assert "Walk.reset: LookupError: no start (" in said
    assert "  Traceback (most recent call last):\n" in said


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("minisin", "unknown simulation 'minisin'; did you mean 'minisim'?"),
        ("gazebo", "unknown simulation 'gazebo'; did you mean 'arena-gazebo'?"),
        ("arena-gazebo", "servers of another simulator offer it, see docs/how-to/simulators.md;"),
        ("away.py:Walk", "there is no such file"),
        ("away.py", "away.py: there is no such file"),
        (f"{FILE}:Wlak", "has no class 'Wlak'; did you mean 'Walk'?"),
        (f"{FILE}:Parameter", "Parameter is not a subclass of swarmwright.Simulation"),
        ("no_such_module:Walk", "there is no module 'no_such_module'"),
    ],
)
def test_what_cannot_be_served(name: str, words: str, program: Any) -> None:
    result = program("serve", name, "--broker", "mqtt://127.0.0.1:1")
    assert result.returncode == 2
    assert words in result.stderr


def test_a_file_without_a_class_is_refused_with_the_classes_in_it(program: Any, tmp_path: Path) -> None:
    (tmp_path / "walks.py").write_text(f"{SOURCE}\nclass Boom(Walk):\n    pass\n")
    (tmp_path / "empty.py").write_text("from swarmwright import Simulation\n")
    (tmp_path / "walks.yaml").write_text("simulation: walks.py\n")
    for words in (("serve", "walks.py"), ("optimize", "walks.yaml")):
        result = program(*words)
        assert result.returncode == 2
        assert "consists of its file and its class; walks.py has Walk, " in result.stderr
        assert "Boom: write walks.py:Walk" in result.stderr
    result = program("serve", "empty.py")
    assert "empty.py has no subclass of swarmwright.Simulation" in result.stderr


def test_a_simulation_that_hangs_ends_with_its_server(
    start: Any, embedded_broker: str, tmp_path: Path
) -> None:
    (tmp_path / "endless.py").write_text(
        SOURCE + "class Endless(Walk):\n    def step(self, actions):\n        while True: pass\n"
    )
    serving = start("serve", "endless.py:Endless", "--broker", embedded_broker, "--json")
    (ready,) = events(serving, "ready")
    tool = subprocess.Popen(
        [sys.executable, "-m", "swarmwright", "optimize", "x.yaml", "--broker", embedded_broker],
        cwd=tmp_path,
        env=environment(),
        stderr=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
    )
    (tmp_path / "x.yaml").write_text("simulation: walk\nrequirements: {dimensions: 1}\n")
    try:
        events(serving, "busy")
        began = time.monotonic()
        serving.send_signal(signal.SIGTERM)
        serving.communicate(timeout=15)
        assert gone([ready["pid"]])
        assert time.monotonic() - began < 5
        assert serving.returncode == 0
    finally:
        tool.kill()
        tool.wait()


def test_servers_of_a_run_say_why_they_cannot_start(tmp_path: Path) -> None:
    file = tmp_path / "picky.py"
    file.write_text(
        SOURCE + "import sys\n"
        "class Picky(Walk):\n"
        "    def __init__(self):\n"
        "        if 'server_process' in sys.argv[0]: raise OSError('no window')\n"
    )
    one = experiment(simulation=f"{file}:Picky")
    with pytest.raises(
        RunError, match=r"server 1 ended with status 1:[^$]*Picky.__init__: OSError: no window \("
    ):
        evaluate(one, genomes(), servers=1)


@pytest.mark.parametrize(("guard", "status"), [("if __name__ == '__main__':", 0), ("if True:", 1)])
def test_a_script_with_a_class_of_its_own(guard: str, status: int, tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        SOURCE + "from swarmwright import Experiment, optimize\n"
        "class Mine(Walk):\n    title = 'mine'\n"
        f"{guard}\n"
        "    experiment = Experiment.from_mapping({'simulation': Mine, 'method': {'generations': 2}})\n"
        "    print(optimize(experiment, servers=2, out='run').generations)\n"
    )
    result = subprocess.run(
        [sys.executable, script], cwd=tmp_path, env=environment(), capture_output=True, text=True, check=False
    )
    assert result.returncode == status, result.stderr
    if status:
        assert 'move the start of the run under `if __name__ == "__main__":`' in result.stderr
    else:
        assert result.stdout == "2\n"


def test_a_class_of_a_session_stays_in_its_process(tmp_path: Path) -> None:
    code = (
        SOURCE + "from swarmwright import Experiment, optimize\n"
        "class Mine(Walk): pass\n"
        "experiment = Experiment.from_mapping({'simulation': Mine, 'method': {'generations': 2}})\n"
        "print(optimize(experiment, out='run').path, list(optimize(experiment).attempts()))\n"
        "try:\n    optimize(experiment, servers=2)\n"
        "except InputError as error:\n    print(error)\n"
    )
    result = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env=environment(),
        capture_output=True,
        text=True,
        check=True,
    )
    first, second = result.stdout.splitlines()
    assert first == "run []"
    assert second == (
        "simulation: Mine is defined only in this session, where servers cannot import it; "
        "move the class to a file or set servers: in-process"
    )
    assert (tmp_path / "runs" / "Mine-1").is_dir()

"""What `runs show` says of the controller and the sessions of a run."""

from collections.abc import Callable
from pathlib import Path
from subprocess import CompletedProcess

import pytest

from swarmwright.cli._runs import _controller
from swarmwright.runs.store import StoreWriter
from swarmwright.servers.rows import NOTHING_LEFT
from tests.python.display.test_page_swarm import MODULES, NETWORK, TEAM


def test_each_group_of_a_team_has_its_controller() -> None:
    machine = [f"  {line}" for line in _controller(MODULES)]
    assert machine[0] == "  state 0: exploration (rwm 3)"
    said = list(_controller(TEAM))
    assert said[0] == "scouts: modules (state machine)"
    assert said[1 : 1 + len(machine)] == machine
    assert said[1 + len(machine)] == "guards: layered, 9-2, tanh"
    assert said[2 + len(machine)] == "carriers: modules (behaviour tree)"
    assert "    subtree 0: next subtree if black floor (probability 0.5)" in said
    assert not list(_controller(NETWORK))


@pytest.mark.slow
def test_sessions_say_where_evaluations_were(
    program: Callable[..., "CompletedProcess[str]"], tmp_path: Path
) -> None:
    (tmp_path / "x.yaml").write_text(
        "simulation: minisim\nmethod: {population: 4, generations: 1}\nvalidate: false\n"
    )
    for servers, words in (("local", "in this process, on host "), ("1", "by ")):
        done = program("optimize", "x.yaml", "--servers", servers, "--out", servers)
        assert done.returncode == 0, done.stderr
        (line,) = (one for one in program("runs", "show", servers).stdout.splitlines() if "host" in one)
        assert line.startswith(f"  evaluated {words}")
    with StoreWriter.resume(tmp_path / "local") as store:
        store.begin(NOTHING_LEFT)
    assert "\n  nothing was left to evaluate, on host " in program("runs", "show", "local").stdout


@pytest.mark.slow
def test_runs_that_are_listed_nowhere_are_hinted_at(
    program: Callable[..., "CompletedProcess[str]"], tmp_path: Path
) -> None:
    assert program("runs", "list").stdout == "No runs in runs. `swarmwright optimize FILE` makes one.\n"
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "run.sqlite").touch()
    hint = "No runs in runs. `swarmwright runs list .` lists those in the working folder.\n"
    assert program("runs", "list").stdout == hint
    assert program("runs", "list", "mine").stdout != hint

"""What a simulation's code raises reaches the caller: SimulationError with the traceback and its cause."""

import traceback
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import (
    Episodes,
    Experiment,
    RunError,
    Simulation,
    SimulationError,
    optimize,
    post_evaluate,
    simulate,
)
from swarmwright.common.engine_types import Outcome
from swarmwright.controllers.controller import Controller
from swarmwright.servers.evaluation.base import CodeFailures, build_error
from swarmwright.servers.rows import AttemptEntry, Journal

SOURCE = """\
from swarmwright import Simulation

class Broken(Simulation):
    title, dimensions, sensors, actuators = "broken", 1, 1, 1

    def reset(self, parameters, seed):
        return [[0.0]]

    def step(self, actions):
        try:
            {}["key"]
        except KeyError as error:
            raise ValueError("no such key") from error

    def done(self):
        return False

    def fitness(self):
        return 0.0
"""


class Wide(Simulation):
    title, dimensions, sensors, actuators = "wide", 1, 1, 1

    def reset(self, parameters: dict[str, Any], seed: int) -> list[list[float]]:  # noqa: ARG002
        return [[0.0]]

    def step(self, actions: Any) -> list[list[float]]:  # noqa: ARG002
        return [[0.0, 1.0]]

    def done(self) -> bool:
        return False

    def fitness(self) -> float:
        return 0.0


@pytest.fixture
def broken(tmp_path: Path) -> Experiment:
    file = tmp_path / "broken.py"
    file.write_text(SOURCE)
    return Experiment.from_mapping(
        {
            "simulation": f"{file}:Broken",
            "controller": {"hidden": []},
            "method": {"population": 4, "generations": 2},
        }
    )


def check(error: SimulationError, *, in_process: bool) -> None:
    assert "Broken.step: ValueError: no such key" in str(error)
    assert error.stack is not None
    assert "KeyError: 'key'" in error.stack
    shown = "".join(traceback.format_exception(error))
    assert "KeyError: 'key'" in shown
    assert 'raise ValueError("no such key")' in shown
    if in_process:
        assert isinstance(error.__cause__, ValueError)
        assert isinstance(error.__cause__.__cause__, KeyError)
    else:
        assert error.__cause__ is None


@pytest.mark.slow
@pytest.mark.parametrize("servers", ["in-process", 1])
def test_callers_get_what_the_code_raised(broken: Experiment, tmp_path: Path, servers: Any) -> None:
    with pytest.raises(SimulationError, match=r"^the episode failed: Broken") as raised:
        simulate(broken, servers=servers)
    check(raised.value, in_process=servers != 1)
    with pytest.raises(SimulationError, match=r"^every candidate of generation 0 failed; the last") as raised:
        optimize(broken, servers=servers, out=tmp_path / "run")
    check(raised.value, in_process=servers != 1)
    controller = Controller(broken.representation(1, 1).specification(np.zeros(2, dtype=np.float32)))
    with pytest.raises(SimulationError, match=r"^every episode failed; the last reason") as raised:
        post_evaluate(broken, controller=controller, episodes=2, servers=servers)
    check(raised.value, in_process=servers != 1)


@pytest.mark.slow
def test_code_that_raises_nothing_has_no_stack() -> None:
    experiment = Experiment.from_mapping({"simulation": Wide, "controller": {"hidden": []}})
    for servers in ("in-process", 1):
        with pytest.raises(SimulationError, match=r"Wide.step: observations of the shape \(1, 2\)") as raised:
            simulate(experiment, servers=servers)
        assert raised.value.stack is None


def test_episodes_that_are_stepped_raise_it(broken: Experiment) -> None:
    episodes = Episodes(broken, seeds=[0, 1])
    with pytest.raises(SimulationError) as raised:
        episodes.step([[0.0], [0.0]])
    check(raised.value, in_process=True)


def attempt(error: str, stack: str | None = None, outcome: Outcome = "failed") -> AttemptEntry:
    return AttemptEntry("batched", 0, 1, 0, 1, 1, 1, None, 0.0, 1.0, outcome, error, stack)


def test_only_reasons_of_the_code_are_its_failures() -> None:
    failures = CodeFailures()
    lost = attempt("the server was lost", outcome="server_failed")
    failures.note(Journal([attempt("A.step: x", "stack of A"), lost]))
    crash = attempt("killed in D.step", "stack of D", outcome="server_failed")
    failures.note(Journal([attempt("B.step:\nnan"), crash, attempt("A.step: x")]))  # known by now
    known = {"A.step: x": "stack of A", "B.step:\nnan": None, "killed in D.step": "stack of D"}
    for reason, stack in known.items():
        error = build_error("all failed: ", ["another", reason], failures.find_error)
        assert isinstance(error, SimulationError)
        assert error.stack == stack
    of_server = build_error("all failed: ", ["A.step: x", "the server was lost"], failures.find_error)
    assert type(of_server) is RunError
    assert str(of_server) == "all failed: the server was lost"
    assert (
        str(build_error("all failed: ", [], failures.find_error, unknown="not known"))
        == "all failed: not known"
    )


def test_of_many_different_reasons_the_last_ones_are_known() -> None:
    failures = CodeFailures()
    often = attempt("A.step: often", "stack of A")
    for number in range(300):
        failures.note(Journal([attempt(f"A.step: bad {number}", "stack"), often]))
        often = attempt("A.step: often")  # a journal has the traceback once
    assert isinstance(build_error("", ["A.step: bad 299"], failures.find_error), SimulationError)
    error = failures.find_error("A.step: often")
    assert error is not None
    assert error.stack == "stack of A"
    assert failures.find_error("A.step: bad 0") is None


def test_tracebacks_of_servers_cannot_control_the_terminal() -> None:
    failures = CodeFailures()
    failures.note(Journal([attempt("A.step: x", "File \x1b[2J\nTraceback of another program")]))
    error = build_error("", ["A.step: x"], failures.find_error)
    assert error.__notes__ == ["In the simulation:\n  File \\x1b[2J\n  Traceback of another program"]

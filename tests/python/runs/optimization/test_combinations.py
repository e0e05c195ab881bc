"""Every representation with every method and ranking: it runs everywhere alike, or is refused and why."""

from itertools import product
from pathlib import Path
from typing import Any

import pytest

from swarmwright import Experiment, InputError, Run, optimize, resume
from swarmwright.methods.plug_ins import REGISTRIES
from tests.python.methods.needed import method_of
from tests.python.records import same_record

SMALL: dict[str, dict[str, Any]] = {
    "layered": {"hidden": [3]},
    "fully_meshed": {"hidden": 1},
    "hebbian": {"hidden": 1},
    "neat": {},
    "mealy_fsm": {},
    "parameter_set": {
        "parameters": {
            "avoidance": {"type": "real", "range": [0.0, 5.0]},
            "avoidanceRadius": {"type": "real", "range": [0.1, 10.0], "scale": "log"},
        }
    },
    "team": {
        "groups": {
            "agents": {"kind": "layered", "hidden": [2]},
            "defenders": {"kind": "fully_meshed", "hidden": 1},
        }
    },
}
"""Options of representations that need some, or are large without."""
DISCRETE = {"hyperneat", "mealy_fsm", "neat", "parameter_set"}
"""Controllers that some methods cannot evolve."""
ROBOTS = Path(__file__).with_name("robots.py")
RANKINGS: list[dict[str, Any]] = [
    {"aggregate": "mean"},
    {"aggregate": "cvar", "level": 0.5, "seeds": "new", "reevaluate": True},
]
KINDS = list(
    product(
        REGISTRIES["controller"].names(),
        REGISTRIES["method"].names(),
        ("generational", "steady_state"),
        range(len(RANKINGS)),
    )
)


def experiment(controller: str, method: str, operation: str, ranking: int) -> Experiment:
    parameters: dict[str, Any] = {"maxSteps": 4, "placement": "random", "numAgents": 2}
    if controller == "parameter_set":
        parameters["steering"] = "rule"
    if controller == "team":
        parameters["defenderSteering"] = "controller"
    return Experiment.from_mapping(
        {
            "simulation": "minisim",
            "parameters": parameters,
            "controller": {"kind": controller, **SMALL.get(controller, {})},
            "method": method_of(method, operation=operation, generations=3, **sizes(method)),
            "ranking": {"kind": "absolute", "episodes": 2, **RANKINGS[ranking]},
            "servers": "local",
        }
    )


def robots(method: str, operation: str = "generational", **options: Any) -> Experiment:
    """Machines of modules on robots that sense what they need."""
    return Experiment.from_mapping(
        {
            "simulation": f"{ROBOTS}:Robots",
            "controller": {"kind": "modules"},
            "method": {"kind": method, "operation": operation, "generations": 3, **sizes(method), **options},
            "ranking": {"episodes": 2},
            "servers": "local",
        }
    )


def sizes(method: str) -> dict[str, int]:
    """A small population, in the method's own words."""
    options = REGISTRIES["method"].get(method).options_model.model_fields
    if "population" in options:
        return {"population": 8}
    return {"width": 3, "height": 3} if "width" in options else {}


@pytest.mark.parametrize(("controller", "method", "operation", "ranking"), KINDS)
def test_it_runs_everywhere_alike_or_is_refused(
    controller: str, method: str, operation: str, ranking: int, tmp_path: Path
) -> None:
    try:
        made = experiment(controller, method, operation, ranking)
    except InputError as refusal:
        refused(str(refusal), controller, method, operation, ranking)
        return
    run = optimize(made, out=tmp_path / "run")
    # A restart of CMA-ES doubles its population, and its generations become fewer.
    assert run.generations == 3 or (method.endswith("cma_es") and run.generations == 2)
    assert run.state == "done"
    assert run.evaluations == len(run.record.fitness) > 0
    part = optimize(made, lambda now: now.generation < 1, out=tmp_path / "part")
    same_record(resume(part), run)


def refused(why: str, controller: str, method: str, operation: str, ranking: int) -> None:
    """A refusal names the key, and there is a reason for it."""
    asks_for_more = ranking == 1
    component = REGISTRIES["method"].get(method)
    reasons = [
        asks_for_more and not component.keeps_members and "ranking.reevaluate: " in why,
        asks_for_more and operation == "steady_state" and "ranking" in why,
        operation == "steady_state" and not component.steady_state and "method.operation: " in why,
        controller in DISCRETE and "method.kind: " in why and controller in why,
        method == "neat" and "method.kind: neat cannot evolve" in why,
        controller == "modules" and "controller.kind: modules needs 9 sensors" in why,
    ]
    assert any(reasons), why


@pytest.mark.slow
@pytest.mark.parametrize("operation", ["generational", "steady_state"])
@pytest.mark.parametrize("controller", REGISTRIES["controller"].names())
def test_servers_give_what_this_process_gives(controller: str, operation: str, tmp_path: Path) -> None:
    if controller == "modules":
        made = robots("cea2d", operation)
    else:
        made = experiment(controller, "cea2d", operation, 0)
    local: Run = optimize(made, out=tmp_path / "local")
    for mode in ("stepwise", "offloaded"):
        there = optimize(made.replace(mode=mode, servers=2), out=tmp_path / mode)
        same_record(there, local)
        assert {attempt.mode for attempt in there.attempts()} == {mode}


@pytest.mark.slow
@pytest.mark.parametrize("method", ["nnga", "pso"])
def test_machines_of_modules_become_better(method: str, tmp_path: Path) -> None:
    run = optimize(robots(method, generations=8, population=20), out=tmp_path / "run")
    first, last = run.history[0], run.history[-1]
    assert last.mean > 1.2 * first.mean > 0

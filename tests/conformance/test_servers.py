"""Every server of this repository keeps every rule. Adding one is a line in CASES."""

import sys
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from swarmwright.conformance import check_server
from swarmwright.conformance._controller_kinds import TRIALS
from tests.conformance.broken import steered
from tests.conformance.broken.batches import Batched
from tests.conformance.broken.samples import Sampling
from tests.conformance.broken.steered import Steered
from tests.conformance.sound import SoundRobots, SoundServer
from tests.conftest import ROOT
from tests.cpp import build
from tests.enki import needs_enki
from tests.java import jar

SLOW = "-S6.5,-S6.9,-S6.13,-S11.2,-S12,-S16"
"""Rules that wait or measure for seconds: tried for each state machine, not for each simulation on it."""
PATIENCE = 1.0
"""Seconds after which servers give up an episode, which two rules wait for."""
MANY = {"numAgents": 3, "placement": "random", "maxSteps": 6}
SERVE = (
    f"{sys.executable} -m swarmwright serve {{simulation}} "
    f"--broker {{broker}} --id {{id}} --step-timeout {PATIENCE:g}"
)


@dataclass(frozen=True)
class Case:
    """command: what starts it, or a function that says so. skipped: rules that do not apply to it."""

    command: str | Callable[[], str]
    parameters: dict[str, Any] = field(default_factory=dict)
    rules: str = SLOW
    skipped: frozenset[str] = frozenset()
    step_timeout: float | None = PATIENCE
    modules: bool = False
    """Whether agents have what machines of modules need."""


def served(simulation: str) -> str:
    """The command of `swarmwright serve`."""
    return SERVE.replace("{simulation}", simulation)


def java() -> str:
    """The example server of the Java wrapper."""
    return f"java -Xshare:auto -jar {jar()} --broker {{broker}} --id {{id}} --step-timeout {PATIENCE:g}"


def cpp(example: str) -> Callable[[], str]:
    """An example server of the C++ wrapper."""
    return lambda: f"{build() / example} --broker {{broker}} --id {{id}} --step-timeout {PATIENCE:g}"


STEERED = frozenset(trial.rule for trial in TRIALS) | frozenset(
    f"S{group}.{number}"
    for group, numbers in {
        2: (2, 4, 5, 9, 13),
        4: (1, 2, 3, 4),
        6: (2, 3, 4, 6, 10, 11, 12),
        7: (4, 6),
        9: (10, 14),
        10: (2, 3, 8, 9),
        11: (5,),
        15: (2,),
    }.items()
    for number in numbers
)
"""What does not apply where nobody is asked for actuators."""
UNLIMITED = frozenset({"S1.6"})
"""What cannot be asked of simulations that take any number of agents."""
BY_CHANCE = frozenset(
    {"S3.1", "S3.2", "S3.3", "S3.4", "S3.5", "S4.1", "S4.2", "S4.4"}
    | {"S9.7", "S9.14", "S9.20", "S10.1", "S10.7"}
    | {trial.rule for trial in TRIALS if trial.kind != "modules"}
)
"""What cannot be compared where no two episodes are the same; the rest is tried all the same."""
UNSEEN = frozenset({"S14.1", "S14.2", "S14.3"})
"""What does not apply to servers without scenes."""
ROBOTS = {"agents": 3, "steps": 6}
EXIT = {"steps": 3, "width": 8, "height": 8, "numAgents": 4, "numExits": 1, "numBlockades": 3}

CASES = {
    "minisim": Case(served("minisim"), MANY, rules=""),
    "java": Case(java, MANY, rules=""),
    "cpp": Case(cpp("minisim"), MANY),
    "cpp plug-in": Case(cpp("minisim_plugin"), MANY, skipped=UNSEEN),
    "arena": Case(
        served("arena"),
        {"mission": "aac", "robot": "e-puck-rm1.2", "robots": 3, "duration": 2},
        skipped=frozenset({"S8.1", "S8.2", "S9.7", "S9.14"}),
        modules=True,
    ),
    "one agent": Case(
        served("minisim"),
        {"maxSteps": 6},
        skipped=frozenset({"S2.5", "S3.3", "S3.4", "S3.5", "S4.2", "S4.3"}),
    ),
    "emergency exit": Case(served("emergency_exit"), {**EXIT, "update": "simultaneous"}),
    "in turn": Case(served("emergency_exit"), EXIT, skipped=frozenset({"S2.5", "S4.2", "S4.3"})),
    "gymnasium": Case(
        served("gymnasium:CartPole-v1"), skipped=UNSEEN | {"S1.6", "S2.5", "S4.1", "S4.2", "S4.3"}
    ),
    "pettingzoo": Case(
        served("pettingzoo:mpe2.simple_spread_v3"), {"max_cycles": 8}, skipped=UNSEEN | {"S1.6", "S9.5"}
    ),
    "python": Case(served(f"{ROOT}/tests/python/simulations/minisim.py:Minisim"), MANY, skipped=UNSEEN),
    "numpy": Case(served(f"{ROOT}/tests/python/simulations/minisim_batch.py:Minisim"), MANY, skipped=UNSEEN),
    "mujoco rovers": Case(served("swarmwright.simulations.mujoco:Rovers"), ROBOTS, skipped=UNLIMITED),
    "mujoco quadrotors": Case(served("swarmwright.simulations.mujoco:Quadrotors"), ROBOTS, skipped=UNLIMITED),
    "vmas": Case(
        served("vmas:navigation"),
        {"max_steps": 5},
        skipped=UNLIMITED | UNSEEN | {"S8.1", "S8.2", "S9.5", "S9.7"},
    ),
    "enki": Case(
        served("swarmwright.simulations.enki:EPucks"), ROBOTS, skipped=UNLIMITED | BY_CHANCE | {"S14.3"}
    ),
}

NEEDS = {
    "enki": needs_enki,
    "vmas": pytest.mark.skipif(find_spec("vmas") is None, reason="VMAS is not installed"),
}


@pytest.mark.timeout(600)  # it may build the wrappers
@pytest.mark.parametrize("name", [pytest.param(name, marks=NEEDS.get(name, ())) for name in CASES])
def test_a_server_keeps_every_rule(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", f"{ROOT / 'python'}:{ROOT}")  # where some servers import from
    case = CASES[name]
    command = case.command if isinstance(case.command, str) else case.command()
    report = check_server(
        command=command,
        parameters=case.parameters,
        step_timeout=case.step_timeout,
        rules=[case.rules],
        sensors=9 if case.modules else None,  # where they depend on the parameters
        actuators=2 if case.modules else None,
    )
    assert report.ok, str(report)
    expected = case.skipped if case.modules else case.skipped | {"S9.16", "S9.17"}
    assert set(report.list_ids("skipped")) == expected, [
        (result.id, result.detail) for result in report.results if result.status == "skipped"
    ]


def test_the_model_that_broken_servers_are_made_of_is_sound() -> None:
    with ExitStack() as stack:
        report = check_server(
            start=lambda url: stack.callback(SoundServer(url).close),
            rules=["-S6.5,-S6.9,-S6.13,-S12"],
            wait=10,
        )
    assert report.ok, str(report)
    batched = {f"S10.{number}" for number in range(1, 10)}
    instances = {"S16.1", "S16.2", "S16.3", "S16.4", "S16.5"}
    assert set(report.list_ids("skipped")) == {
        "S6.6", "S6.10", "S9.6", "S9.16", "S9.17", "S13.1", *batched, *instances
    }  # fmt: skip


def test_the_model_with_batches_is_sound() -> None:
    with ExitStack() as stack:
        report = check_server(
            start=lambda url: stack.callback(Batched(url).close),
            rules=["S1,S2.3,S3.2,S7,S9.20,S10,S11.4"],
            step_timeout=5.0,
            wait=10,
        )
    assert report.ok, str(report)
    assert not report.list_ids("skipped")


def test_the_model_with_robots_is_sound() -> None:
    with ExitStack() as stack:
        report = check_server(
            start=lambda url: stack.callback(SoundRobots(url).close), rules=["S1,S2.3,S3.2,S9"], wait=10
        )
    assert report.ok, str(report)
    assert set(report.list_ids("skipped")) == {"S9.6"}


def test_the_model_that_makes_samples_is_sound() -> None:
    with ExitStack() as stack:
        report = check_server(
            start=lambda url: stack.callback(Sampling(url).close), rules=["S1,S2.3,S3.2,S7,S9"], wait=10
        )
    assert report.ok, str(report)
    assert set(report.list_ids("skipped")) == {"S9.6", "S9.16", "S9.17"}


def test_the_model_that_steers_its_agents_itself_is_sound() -> None:
    with ExitStack() as stack:
        report = check_server(
            start=lambda url: stack.callback(Steered(url).close),
            parameters=steered.PARAMETERS,
            rules=[steered.STEERED],
            wait=10,
        )
    assert report.ok, str(report)
    tried = {f"S9.{number}" for number in (1, 2, 6, 7, 8, 9, 11, 12, 13)} | {
        "S10.1",
        "S10.4",
        "S10.5",
        "S10.6",
        "S9.20",
        "S10.7",
    }
    assert {number for number in report.list_ids("passed") if number.startswith(("S9", "S10"))} == tried, str(
        report
    )


@pytest.mark.parametrize("first", ["S1", "S1.1", "S1,S4", "S1,S9.6", "S2.1"])
def test_rules_alone_are_tried_whichever_are_chosen_with_them(first: str) -> None:
    """What they need to know is found out before the first of all rules."""
    report = check_server(
        command=served("minisim"), parameters=MANY, step_timeout=PATIENCE, rules=[f"{first},S10.1,S9.6"]
    )
    assert report.ok, str(report)
    assert {"S10.1", "S9.6"} <= set(report.list_ids("passed")), str(report)


@pytest.mark.parametrize(
    ("left_out", "detail"),
    [("", ""), ("-S2.3", "no undisturbed episode"), ("-S1,-S2", "the server's announcement is unknown")],
)
def test_rules_alone_get_what_they_need_to_know_unless_that_is_left_out(left_out: str, detail: str) -> None:
    report = check_server(
        command=served("minisim"), parameters=MANY, step_timeout=PATIENCE, rules=["S10.1,S10.2", left_out]
    )
    assert [result.id for result in report.results] == ["S10.1", "S10.2"]
    assert len(report.list_ids("not run" if left_out else "passed")) == 2, str(report)
    assert report.ok != bool(left_out)
    assert detail in report.results[0].detail, report.results[0].detail


def test_agents_that_steer_themselves() -> None:
    report = check_server(
        command=served("minisim"),
        parameters={**MANY, "steering": "rule"},
        rules=[SLOW],
        step_timeout=PATIENCE,
    )
    assert report.ok, str(report)
    assert set(report.list_ids("skipped")) == STEERED

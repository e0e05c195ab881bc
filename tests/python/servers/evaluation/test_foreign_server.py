"""A simulation server that knows only D6.1, well-behaved and not, against our optimization tool."""

import json
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Controller, Experiment, InputError, RunError, evaluate, optimize, simulate
from swarmwright.common.random_numbers import Stream

LINE = Experiment.from_mapping(
    {
        "simulation": "line",
        "requirements": {"dimensions": 1},
        "parameters": {"length": 3, "nested": {"list": [1, None, "x"]}},
        "sensors": 2,
        "actuators": 1,
        "controller": {"hidden": [3]},
        "method": {"population": 12, "generations": 4},
        "timeouts": {"discovery": 3, "step": 0.5},
    }
)


Foreign = Callable[..., AbstractContextManager[Any]]


def line(actuators: list[float]) -> float:
    position = 0.0
    for actuator in actuators:
        position += actuator
    return -abs(position - 1)


def expected(genomes: np.ndarray[Any, Any], steps: int = 4) -> list[float]:
    """Play the same game here, with controllers called on arrays."""
    representation = LINE.representation()
    results = []
    for genome in genomes:
        controller, position, taken = Controller(representation.specification(genome)), 0.0, []
        for step in range(steps):
            actuator = controller([1 - position, (steps - step) / steps])
            # On the wire a binary32 is its shortest decimal, which a binary64 reader reads as that decimal.
            taken.append(float(str(actuator[0])))
            position = sum(taken)
        results.append(line(taken))
    return results


@pytest.mark.slow
def test_it_evolves_controllers(any_broker: str, tmp_path: Path, foreign: Foreign) -> None:
    with foreign(any_broker, "line") as server:
        run = optimize(LINE, broker=any_broker, out=tmp_path / "run")
    assert run.audit is not None
    assert server.episodes == run.evaluations + run.audit["episodes"]
    assert server.parameters[0]["length"] == 3
    assert server.parameters[0]["nested"] == {"list": [1, None, "x"]}
    assert run.record.fitness.tolist() == pytest.approx(expected(run.record.genomes), abs=1e-9)
    assert {attempt.server for attempt in run.attempts()} == {77}


def test_two_of_them_give_the_same_record_as_one(
    embedded_broker: str, tmp_path: Path, foreign: Foreign
) -> None:
    with foreign(embedded_broker, "line"):
        one = optimize(LINE, broker=embedded_broker, out=tmp_path / "one")
        with foreign(embedded_broker, "line", server=78):
            two = optimize(LINE, broker=embedded_broker, out=tmp_path / "two")
    assert one.digest == two.digest


def test_without_sizes_it_is_said_what_is_missing(embedded_broker: str, foreign: Foreign) -> None:
    with (
        foreign(embedded_broker, "line"),
        pytest.raises((InputError, RunError), match="sensors"),
    ):
        simulate(LINE.replace(sensors=None, actuators=None), broker=embedded_broker)


def test_simulating_once(embedded_broker: str, foreign: Foreign) -> None:
    with foreign(embedded_broker, "line") as server:
        fitness = simulate(LINE, broker=embedded_broker)
    assert server.episodes == 1
    assert -5 <= fitness <= 0


Trouble = Callable[[str, dict[str, Any]], "dict[str, Any] | str | None"]


def stalled(topic: str, message: dict[str, Any]) -> dict[str, Any] | None:
    """Never answer to the second step."""
    return None if topic == "sensor" and message["sensor"][1] < 1 else message


def short(topic: str, message: dict[str, Any]) -> dict[str, Any]:
    """Sense one number too few."""
    return {**message, "sensor": [0.5]} if topic == "sensor" else message


def not_finite(topic: str, message: dict[str, Any]) -> dict[str, Any] | str:
    """Say NaN, which is no JSON."""
    return json.dumps({**message, "fitness": float("nan")}) if topic == "fitness" else message


FAILED = "every candidate of generation 0 failed; the last reason:"


@pytest.mark.parametrize(
    ("trouble", "words"),
    [
        # It gets no work before it says something again.
        (
            stalled,
            r"no server fits .* server 77 has not answered the actuators of agent 0 in step 0 for 0\.2 s",
        ),
        (short, f"{FAILED} server 77: sensors: 1 numbers, but this controller takes 2"),
        (not_finite, f"{FAILED} server 77: message on fitness"),
    ],
)
def test_a_server_in_trouble_ends_the_run_with_its_reason(
    trouble: Trouble, words: str, embedded_broker: str, tmp_path: Path, foreign: Foreign
) -> None:
    method = {"kind": "random_search", "population": 1, "generations": 2}
    experiment = LINE.replace(method=method, timeouts={"step": 0.2})
    with (
        foreign(embedded_broker, "line", trouble=trouble),
        pytest.raises(RunError, match=words),
    ):
        optimize(experiment, broker=embedded_broker, out=tmp_path / "run")


def test_a_server_in_trouble_does_not_spoil_what_others_do(embedded_broker: str, foreign: Foreign) -> None:
    representation = LINE.representation()
    rows = np.stack([representation.initial(Stream(1, "test", 0, index)) for index in range(6)])
    experiment = LINE.replace(timeouts={"step": 0.2})
    with (
        foreign(embedded_broker, "line"),
        foreign(embedded_broker, "line", server=78, trouble=stalled),
    ):
        fitness = evaluate(experiment, rows, broker=embedded_broker)
    assert fitness.tolist() == pytest.approx(expected(rows), abs=1e-9)


@pytest.mark.slow
def test_junk_on_the_topics_disturbs_nobody(any_broker: str, foreign: Foreign) -> None:
    junk = ["", "{", "[1,2]", "\xff" * 10, '{"simulation_hash": 3}', "x" * 1_000_000]
    with foreign(any_broker, "line", noise=junk):
        assert -5 <= simulate(LINE, broker=any_broker) <= 0

"""State machines as pages and legends have them."""

from typing import Any

from swarmwright.display._machine import machine_of
from tests.python.display.test_page_swarm import MODULES


def test_machines_of_modules_have_behaviours_and_conditions() -> None:
    assert machine_of(MODULES, 0) == {
        "states": [
            {"name": "exploration", "words": "exploration (rwm 3)"},
            {"name": "stop", "words": "stop"},
        ],
        "transitions": [
            (0, 1, "black floor (probability 0.5)"),
            (1, 0, "fixed probability (probability 0.1)"),
        ],
    }


def test_subtrees_of_a_tree_lead_to_the_next_one() -> None:
    tree: dict[str, Any] = {**MODULES, "form": "tree"}
    machine: dict[str, Any] = machine_of(tree, 0)
    transitions: list[Any] = machine["transitions"]
    assert [part[:2] for part in transitions] == [(0, 1), (1, 0)]


def test_a_mealy_machine_has_the_number_of_cases_of_each_transition() -> None:
    # One sensor with two thresholds, one actuator; targets above the last state are the last state.
    rows: list[list[float]] = [[0, 0.5], [1, 0.5], [1, 0.5], [-3, 0], [0.9, 0], [7, 0]]
    specification = {
        "kind": "mealy_fsm", "sensors": 1, "actuators": 1, "states": 2, "thresholds": [[0.1, 0.2]],
        "weights": [number for row in rows for number in row],
    }  # fmt: skip
    machine = machine_of(specification, 0)
    assert [state["words"] for state in machine["states"]] == ["state 0", "state 1"]
    assert machine["transitions"] == [
        (0, 0, "1 of 3 cases"),
        (0, 1, "2 of 3 cases"),
        (1, 0, "2 of 3 cases"),
        (1, 1, "1 of 3 cases"),
    ]


def test_of_an_unknown_controller_the_states_are_known_that_agents_were_in() -> None:
    assert machine_of({}, 2) == {
        "states": [{"name": "", "words": f"state {index}"} for index in range(3)],
        "transitions": [],
    }

"""State machines as pages and legends have them."""

from swarmwright.controllers.kinds import machine_of
from swarmwright.controllers.machines import machines_of
from swarmwright.display.machines import Machines
from tests.python.display.test_page_swarm import MODULES, NETWORK, TEAM, TREE


def test_machines_of_modules_have_behaviours_and_conditions() -> None:
    assert machine_of(MODULES) == {
        "states": [
            {"name": "exploration", "words": "exploration (rwm 3)"},
            {"name": "stop", "words": "stop"},
        ],
        "transitions": [
            (0, 1, "black floor (probability 0.5)"),
            (1, 0, "fixed probability (probability 0.1)"),
        ],
    }


def test_subtrees_of_a_tree_have_a_condition_and_a_behaviour() -> None:
    assert machine_of(TREE) == {
        "form": "tree",
        "states": [
            {
                "name": "exploration",
                "words": "exploration (rwm 3)",
                "condition": "black floor (probability 0.5)",
            },
            {"name": "stop", "words": "stop", "condition": "fixed probability (probability 0.1)"},
        ],
        "transitions": [],
    }


def test_groups_of_a_team_have_machines_of_their_own() -> None:
    groups = machines_of(TEAM).groups_with_colors
    assert groups is not None
    assert [(group["name"], group["first"], group["end"]) for group in groups] == [
        ("scouts", 0, 2),
        ("carriers", 5, None),
    ], "a network between them is no machine"
    assert groups[0]["machine"] == {**(machine_of(MODULES) or {}), "first_color": 0}
    assert groups[1]["machine"]["first_color"] == 2, "each group has its own colours"
    assert groups[1]["machine"]["form"] == "tree"
    assert machines_of(MODULES).groups is None
    assert (
        machines_of({**TEAM, "groups": TEAM["groups"][1:2], "weights": NETWORK["weights"]}).groups_with_colors
        is None
    )


def test_a_mealy_machine_has_the_number_of_cases_of_each_transition() -> None:
    # One sensor with two thresholds, one actuator; targets above the last state are the last state.
    rows: list[list[float]] = [[0, 0.5], [1, 0.5], [1, 0.5], [-3, 0], [0.9, 0], [7, 0]]
    specification = {
        "kind": "mealy_fsm", "sensors": 1, "actuators": 1, "states": 2, "thresholds": [[0.1, 0.2]],
        "weights": [number for row in rows for number in row],
    }  # fmt: skip
    machine = machine_of(specification)
    assert machine is not None
    assert [state["words"] for state in machine["states"]] == ["state 0", "state 1"]
    assert machine["transitions"] == [
        (0, 0, "1 of 3 cases"),
        (0, 1, "2 of 3 cases"),
        (1, 0, "2 of 3 cases"),
        (1, 1, "1 of 3 cases"),
    ]


def test_of_an_unknown_controller_the_states_are_known_that_agents_were_in() -> None:
    assert Machines().common_machine(2) == {
        "states": [{"name": "", "words": f"state {index}"} for index in range(3)],
        "transitions": [],
    }

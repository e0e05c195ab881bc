"""Controllers of several groups in one genome."""

import numpy as np
import pytest
from pydantic import ValidationError

from swarmwright import InputError
from swarmwright.common.problems import problems_of
from swarmwright.common.random_numbers import Stream
from swarmwright.controllers.kinds.team import Team, TeamOptions
from swarmwright.testing import check_representation

SIZES = {"sensors": 3, "actuators": 2}
GROUPS = {
    "one": {"agents": 2, "kind": "layered", "hidden": [2], **SIZES},
    "two": {"agents": 1, "kind": "mealy_fsm", "states": 2, "sensors": 3, "actuators": 2},
    "three": {"kind": "fully_meshed", "hidden": 1, "sensors": 1, "actuators": 1},
}


def team(*names: str, sensors: int = 3) -> Team:
    groups = {name: GROUPS[name] for name in names}
    options = TeamOptions.model_validate({"groups": groups})
    return Team(options, sensors=sensors, actuators=2)


def test_it_is_a_representation() -> None:
    groups = {
        "one": {"agents": 1},
        "two": {"kind": "mealy_fsm", "states": 2, "sensors": 1, "actuators": 1},
    }
    check_representation("team", {"groups": groups})


def test_the_genes_are_those_of_the_groups() -> None:
    both = team("one", "three")
    parts = list(both.parts.values())
    assert both.genome_size == sum(part.genome_size for part in parts)
    cut = parts[0].genome_size
    genome = both.initial(Stream(1, "test"))
    assert both.weights(genome[np.newaxis])[0].tobytes() == genome.tobytes()
    low, high = both.initial_range
    assert (low[:cut].tolist(), high[cut:].tolist()) == (
        parts[0].initial_range[0].tolist(),
        parts[1].initial_range[1].tolist(),
    )
    assert [one["name"] for one in both.architecture()["groups"]] == ["one", "three"]
    assert both.continuous


def test_a_team_with_choices_is_not_continuous() -> None:
    assert not team("one", "two", "three").continuous


@pytest.mark.parametrize(
    ("key", "hint"),
    [
        ("hiden", "did you mean 'hidden'?"),
        ("sensor", "did you mean 'sensors'?"),
        ("x", "known keys: kind, agents, sensors, actuators, output_range, "),
    ],
)
def test_unknown_keys_of_a_group_are_those_of_its_kind_too(key: str, hint: str) -> None:
    with pytest.raises(ValidationError) as raised:
        TeamOptions.model_validate({"groups": {"one": {key: 4}}})
    [(path, message)] = problems_of(raised.value, TeamOptions)
    assert path == ("groups", "one", key)
    assert message.startswith(f"unknown key; {hint}")


def test_sizes_that_do_not_fit_the_simulation_are_refused() -> None:
    with pytest.raises(InputError, match="have at most 3 sensors, but agents of the simulation have up to 4"):
        team("one", sensors=4)
    options = TeamOptions.model_validate({"groups": {"one": {"kind": "modules", **SIZES}}})
    with pytest.raises(InputError, match=r"controller.groups.one.kind: modules needs 9 sensors"):
        Team(options, **SIZES)
    options = TeamOptions.model_validate({"groups": {"one": {"sensors": 3}}})
    assert Team(options, **SIZES).parts["one"].actuators == 2

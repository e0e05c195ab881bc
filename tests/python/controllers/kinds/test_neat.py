"""Networks with given connections as a representation."""

from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from swarmwright import Controller, InputError
from swarmwright.common.random_numbers import Streams
from swarmwright.controllers.kinds.neat import Neat, NeatOptions
from swarmwright.testing import check_representation


def network(**options: Any) -> Neat:
    return Neat(NeatOptions.model_validate(options), sensors=3, actuators=2)


def test_it_is_a_representation() -> None:
    check_representation("neat")
    check_representation("neat", {"iterations": 1, "weight_range": 4.0, "mutation": "proportional"})


def test_without_connections_given_every_actuator_sees_all_sensors() -> None:
    subject = network()
    assert subject.architecture()["sources"] == [[0, 1, 2], [0, 1, 2]]
    assert subject.genome_size == 2 * (1 + 3 + 1)
    genomes = network(weight_range=3.0, bias_range=0.5).initials(Streams(1, "x", 0, range(300)))
    reach = np.abs(genomes).max(axis=0)
    assert (reach[[0, 5]] < 0.5).all()
    assert (reach[[1, 4, 6, 9]] > 2.9).all(), "slopes are in the range of weights"


def test_each_connection_has_an_effect() -> None:
    """A hidden node sees itself, and an actuator the other one."""
    subject = network(sources=[[0, 3], [3, 1], [4, 2, 2]])
    weights = [0.1, 1.0, 0.7, 0.0, 1.5, 0.4, 2.0, -0.2, 0.8, 0.3, 0.3, -1.0]
    assert subject.genome_size == len(weights)
    readings = np.random.default_rng(1).uniform(-1, 1, (6, 3)).astype(np.float32)

    def outputs(changed: list[float]) -> list[list[float]]:
        controller = Controller(subject.specification(np.array(changed, np.float32)))
        return [controller(reading).tolist() for reading in readings]

    expected = outputs(weights)
    for place in range(len(weights)):
        changed = [weight + (index == place) * 0.25 for index, weight in enumerate(weights)]
        found = outputs(changed)
        assert found != expected
        first = [row[0] for row in found] == [row[0] for row in expected]
        assert first == (place >= 7), "the second actuator comes after the first"
    swapped = [*weights[:9], weights[10], weights[9], weights[11]]
    assert outputs(swapped) == expected, "two connections from the same node"


@pytest.mark.parametrize(
    ("sources", "answer"),
    [
        ([[0]], r"controller.sources: 1 lists for 2 actuators"),
        (
            [[0], [5], [6]],
            r"controller.sources\[2\]: node 6 does not exist; with 3 sensors the last node is 5",
        ),
    ],
)
def test_connections_that_do_not_fit(sources: list[list[int]], answer: str) -> None:
    with pytest.raises(InputError, match=answer):
        network(sources=sources)


@pytest.mark.parametrize(
    "options", [{"sources": []}, {"sources": [[-1]]}, {"iterations": 0}, {"bias_range": 0}]
)
def test_options_that_cannot_be(options: dict[str, Any]) -> None:
    with pytest.raises(ValidationError, match=next(iter(options))):
        NeatOptions.model_validate(options)

"""Representations of some of the modules."""

from typing import Any

import pytest
from pydantic import ValidationError

from swarmwright.common.random_numbers import Streams
from swarmwright.controllers.modules import grammar, machine_mappings
from swarmwright.testing import check_representation
from tests.python.controllers.machines import machines

SUBSET: dict[str, Any] = {
    "behaviours": ["attraction", "stop", "exploration"],
    "conditions": ["neighbours", "fixed_probability"],
}


@pytest.mark.parametrize("form", ["machine", "tree"])
def test_a_choice_of_modules_is_a_representation_of_its_own(form: str) -> None:
    check_representation("modules", {**SUBSET, "form": form})
    check_representation(
        "modules", {"behaviours": ["exploration"], "conditions": ["grey_floor"], "form": form}
    )
    subject = machines(**SUBSET, form=form)
    assert subject.genome_size == machines(form=form).genome_size
    assert subject.architecture() == machines(form=form).architecture()
    genomes = subject.initials(Streams(1, "x", 0, range(300)))
    for _ in range(3):
        genomes = subject.mutations(genomes, Streams(2, "x", 0, range(300)), severity=0.9, probability=1.0)
    found = [subject.states(genome) for genome in genomes]
    assert {state.behaviour for states in found for state in states} == set(SUBSET["behaviours"])
    conditions = {one.condition for states in found for state in states for one in state.transitions}
    assert conditions == set(SUBSET["conditions"])


@pytest.mark.parametrize("form", ["machine", "tree"])
def test_all_modules_by_name_are_those_that_there_are_by_default(form: str) -> None:
    named = {"behaviours": list(grammar.BEHAVIOURS), "conditions": list(grammar.CONDITIONS)}
    one, other = machines(form=form), machines(form=form, **named)
    streams = [Streams(seed, "x", 0, range(40)) for seed in (1, 1, 2, 2)]
    mine, its = one.initials(streams[0]), other.initials(streams[1])
    assert mine.tobytes() == its.tobytes()
    options = {"severity": 0.4, "probability": 1.0}
    mine, its = one.mutations(mine, streams[2], **options), other.mutations(its, streams[3], **options)
    assert mine.tobytes() == its.tobytes()
    assert one.weights(mine).tobytes() == other.weights(its).tobytes()
    assert one.likeness(mine).tobytes() == other.likeness(its).tobytes()


def test_a_machine_to_start_from_has_the_modules_that_were_chosen() -> None:
    machine = {
        "states": [
            {
                "behaviour": "exploration",
                "rwm": 9,
                "transitions": [{"to": 1, "condition": "neighbours", "xi": 2, "eta": 3.5}],
            },
            {"behaviour": "attraction", "alpha": 2},
        ]
    }
    subject = machines(**SUBSET, machine=machine)
    assert subject.start is not None
    assert machine_mappings.machine_mapping_of(subject.states(subject.start))["states"] == [
        machine["states"][0],
        {**machine["states"][1], "transitions": []},
    ]
    with pytest.raises(
        ValidationError, match=r"states\[0\].behaviour: 'exploration' found, expected one of stop"
    ):
        machines(behaviours=["stop"], machine=machine)
    with pytest.raises(ValidationError, match="expected one of black_floor"):
        machines(conditions=["black_floor"], machine=machine)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"behaviours": ["explore"]}, "unknown behaviour 'explore'; did you mean 'exploration'?"),
        ({"conditions": ["stop"]}, "unknown condition 'stop'; available: black_floor"),
        ({"behaviours": ["stop", "stop"]}, "behaviours: 'stop' occurs twice"),
        ({"conditions": []}, "at least 1 item"),
    ],
)
def test_a_wrong_choice_of_modules_is_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError) as caught:
        machines(**options)
    assert message in str(caught.value)

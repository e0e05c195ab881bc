"""Machines with modules in Python: the engine's modules have the engine's bits."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from swarmwright import Controller, Experiment, InputError
from swarmwright.common.random_numbers import Stream, Streams
from swarmwright.controllers.kinds.modules.representation import Modules, ModulesOptions
from swarmwright.controllers.modules.grammar import BUILT_IN, PYTHON_KIND
from swarmwright.export.sequences import Sequences, draw_random_sequences
from swarmwright.servers.evaluation import python_modules
from swarmwright.servers.evaluation.base import Controllers
from swarmwright.servers.evaluation.python_modules import ModulesBackend
from swarmwright.testing import check_behaviour, check_condition, check_representation

FORMS = ("machine", "tree")


def machines(**options: Any) -> Modules:
    return Modules(ModulesOptions(**options), sensors=9, actuators=2)


def in_python(specification: dict[str, Any]) -> dict[str, Any]:
    """Return the same machine as one that Python computes."""
    return {
        **specification,
        "kind": PYTHON_KIND,
        "behaviours": [one.as_mapping() for one in BUILT_IN.behaviours],
        "conditions": [one.as_mapping() for one in BUILT_IN.conditions],
    }


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMS)
@given(seed=st.integers(0, 2**40))
def test_the_engines_modules_have_the_engines_bits(form: str, seed: int) -> None:
    subject = machines(form=form)
    genome = subject.initial(Stream(seed, "machine"))
    specification = subject.specification(genome)
    expected = draw_random_sequences(specification, 60, longest=30)
    found = Sequences.compute(in_python(specification), expected.first, expected.sensors)
    assert found.actuators.tobytes() == expected.actuators.tobytes()


@given(weights=st.lists(st.floats(-1e6, 1e6, width=32), min_size=13, max_size=13), seed=st.integers(0, 2**40))
def test_any_weights_are_the_engines_machine(weights: list[float], seed: int) -> None:
    specification = {**machines(states=1, transitions=1).architecture(), "weights": weights[:10]}
    sensors = Stream(seed, "x").unit(90).astype(np.float32).reshape(10, 9)
    first = np.arange(10) == 0
    expected = Sequences.compute(specification, first, sensors)
    found = Sequences.compute(in_python(specification), first, sensors)
    assert found.actuators.tobytes() == expected.actuators.tobytes()


def arena(**settings: Any) -> Experiment:
    return Experiment.from_mapping(
        {
            "simulation": "arena",
            "parameters": {"mission": "aac", "robot": "e-puck-rm1.2", "robots": 5, "duration": 20},
            "controller": {"kind": "modules"},
            "method": {"kind": "random_search", "generations": 1, "population": 4},
            **settings,
        }
    )


def evaluated(controllers: Controllers, seeds: list[int]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    backend = ModulesBackend(arena(), ["x"] if not seeds else ())
    results = backend.evaluate(controllers, seeds, lambda *_: None)
    return results.fitness, results.metrics


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMS)
def test_whole_episodes_have_the_engines_fitness(form: str, monkeypatch: pytest.MonkeyPatch) -> None:
    subject = machines(form=form)
    weights = subject.weights(subject.initials(Streams(5, "x", 0, range(12))))
    seeds = [3, 4, 5]
    expected, _ = evaluated(Controllers(subject.architecture(), weights), seeds)
    other = Controllers(in_python(subject.architecture()), weights)
    assert evaluated(other, seeds)[0].tobytes() == expected.tobytes()
    monkeypatch.setattr(python_modules, "LANES", 7)  # parts that do not fit evenly
    assert evaluated(other, seeds)[0].tobytes() == expected.tobytes()
    assert len(np.unique(expected)) > 5


def test_controllers_are_callable(own: Path) -> None:  # noqa: ARG001 - installs the modules
    subject = machines(behaviours=["wander", "stop"], conditions=["timer"], states=2)
    controller = Controller(subject.specification(subject.initial(Stream(1, "x"))))
    assert (controller.sensors, controller.actuators) == (9, 2)
    sensors = Stream(2, "x").unit(9 * 6).astype(np.float32).reshape(6, 9)
    swarm = [controller(sensors) for _ in range(20)]
    controller.reset()
    assert [row.tobytes() for row in swarm] == [controller(sensors).tobytes() for _ in range(20)]
    controller.reset()
    alone = [controller(sensors[2]) for _ in range(20)]
    assert [row[2].tobytes() for row in swarm] == [row.tobytes() for row in alone]
    with pytest.raises(InputError, match="6 agent"):
        controller(sensors)


def test_modules_in_python_are_a_representation(own: Path) -> None:  # noqa: ARG001 - installs the modules
    given: dict[str, Any] = {
        "behaviours": ["wander", "exploration", "attraction"],
        "conditions": ["neighbours", "timer"],
    }
    for form in FORMS:
        check_representation("modules", {**given, "form": form})
    check_representation("modules", {"behaviours": ["wander"], "conditions": ["timer"], "states": 2})
    check_behaviour("wander")
    check_condition("timer")
    subject = machines(**given)
    genome = subject.initial(Stream(4, "x"))
    specification = subject.specification(genome)
    assert len(specification["weights"]) == 1 + 4 * (4 + 2 + 4 * (5 + 1))
    for state in subject.states(genome):
        expected = {"wander": {"chance", "steps"}, "exploration": {"rwm"}, "attraction": {"alpha"}}
        assert set(state.parameters) == expected[state.behaviour]
    text = ModulesOptions(
        **given,
        machine={
            "states": [
                {
                    "behaviour": "wander",
                    "chance": 0.25,
                    "steps": 3,
                    "transitions": [{"to": 1, "condition": "timer", "after": 40}],
                },
                {"behaviour": "attraction", "alpha": 2},
            ]
        },
    )
    start = Modules(text, sensors=9, actuators=2)
    assert start.start is not None
    first, second = start.states(start.start)
    assert first.parameters == {"chance": 0.25, "steps": 3}
    assert first.transitions[0].parameters == {"after": 40}
    assert second.behaviour == "attraction"


@pytest.mark.parametrize("name", [one.name for one in BUILT_IN.behaviours])
def test_behaviours_of_the_engine_are_checked_in_the_same_way(name: str) -> None:
    check_behaviour(name)


@pytest.mark.parametrize("name", [one.name for one in BUILT_IN.conditions])
def test_conditions_of_the_engine_are_checked_in_the_same_way(name: str) -> None:
    check_condition(name)


def test_a_timer_counts_since_its_state_was_entered(own: Path) -> None:  # noqa: ARG001 - installs the modules
    """Each state lasts for the step in which it is entered, and as many as its timer says."""
    machine = {
        "states": [
            {"behaviour": "stop", "transitions": [{"to": 1, "condition": "timer", "after": 3}]},
            {
                "behaviour": "phototaxis",
                "transitions": [{"to": 0, "condition": "timer", "after": 2}],
            },
        ]
    }
    subject = machines(
        behaviours=["stop", "phototaxis"], conditions=["timer"], states=2, transitions=1, machine=machine
    )
    assert subject.start is not None
    controller = Controller(subject.specification(subject.start))
    moves = [bool(controller(np.full(9, 0.5, dtype=np.float32)).any()) for _ in range(14)]
    assert moves == ([False] * 4 + [True] * 3) * 2

"""Asking and telling out of turn."""

import numpy as np
import pytest

from swarmwright import InputError
from swarmwright.controllers.kinds.neat import GrowingNeat, NeatOptions
from swarmwright.methods import METHODS, Method
from swarmwright.testing._common import representation


@pytest.fixture(params=["nnga", "random_search"])
def method(request: pytest.FixtureRequest) -> Method:
    component = METHODS.get(request.param)
    return component(component.options_model(generations=2), representation(), seed=1)


def test_telling_before_asking(method: Method) -> None:
    with pytest.raises(InputError, match="no genomes are waiting"):
        method.tell(np.zeros(50))


def test_asking_twice(method: Method) -> None:
    method.ask()
    with pytest.raises(InputError, match="tell it before asking again"):
        method.ask()


def test_telling_another_number(method: Method) -> None:
    method.ask()
    with pytest.raises(InputError, match=r"shape is \(3,\); expected \(50,\)"):
        method.tell(np.zeros(3))
    method.tell(np.zeros(50))  # the right number is still welcome


def test_asking_when_done(method: Method) -> None:
    while not method.done:
        method.tell(np.zeros(len(method.ask())))
    with pytest.raises(InputError, match="done after 2 generation"):
        method.ask()


def test_a_target_ends_it_early(method: Method) -> None:
    component = METHODS.get(method.kind)
    hurried = component(component.options_model(generations=100, target=5.0), representation(), seed=1)
    hurried.tell(np.full(len(hurried.ask()), 4.9))
    assert not hurried.done
    fitness = np.full(len(hurried.ask()), np.nan)
    fitness[-1] = 5.0
    hurried.tell(fitness)
    assert hurried.done


@pytest.mark.parametrize("kind", METHODS.names())
def test_the_size_of_the_first_generation_is_known_before(kind: str) -> None:
    component = METHODS.get(kind)
    options = component.options_model()
    evolved = GrowingNeat(NeatOptions(), sensors=4, actuators=1) if kind == "neat" else representation()
    asked = len(component(options, evolved, seed=1).ask())
    assert component.first_generation(options, evolved) == asked
    assert component.first_generation(options, None) in (asked, None)


def test_no_method_starts_from_more_controllers_than_its_first_generation_has() -> None:
    component = METHODS.get("nnga")
    options = component.options_model.model_validate({"population": 4, "islands": 2})
    assert component.no_start(options, 8) is None
    assert component.no_start(options, 9) == "9 controllers exceed the 8 candidates of the first generation"


def test_the_initial_genomes_are_the_same_for_every_method() -> None:
    first = [
        METHODS.get(kind)(METHODS.get(kind).options_model(), representation(), seed=9).ask().tobytes()
        for kind in ("nnga", "random_search")
    ]
    assert first[0] == first[1]

"""Checks of methods in steady state."""

from collections import deque
from collections.abc import Callable

import numpy as np

from swarmwright.common.errors import InputError
from swarmwright.common.typing import Genome
from swarmwright.controllers import Representation
from swarmwright.methods import Method

_GENERATIONS = 3


def check_steady_state(component: type[Method], subject: Representation) -> None:
    """Check a method in steady state, or that it rejects steady state."""
    # Metrics are told for whole generations only.
    if not component.steady_state or component.options_model().needed_metrics:
        _check_refusal(component, subject)
        return
    for in_flight in (1, 5, 10_000):
        asked = _ask_early(_new(component, subject, in_flight))
        assert len(asked) == _budget(component, subject), "budget is not what was evaluated"
        assert _bytes(asked) == _bytes(_ask_late(_new(component, subject, in_flight))), (
            f"with in_flight {in_flight}, genomes depend on when they are asked for"
        )
        assert _bytes(asked) != _bytes(_ask_late(_new(component, subject, in_flight, seed=2)))
    _check_window(_new(component, subject, 3))
    _check_turns(_new(component, subject, 3))
    _check_failures(_new(component, subject, 4))
    _check_target(component, subject)


def _new(component: type[Method], subject: Representation, in_flight: int, seed: int = 1) -> Method:
    options = component.options_model(generations=_GENERATIONS, operation="steady_state", in_flight=in_flight)
    return component(options, subject, seed=seed)


def _budget(component: type[Method], subject: Representation) -> int:
    method = _new(component, subject, 1)
    size = method.generation_size
    assert method.budget == size * _GENERATIONS, "budget must be generations x generation_size"
    return method.budget


def _bytes(asked: list[Genome]) -> list[bytes]:
    return [genome.tobytes() for genome in asked]


def _value(genome: Genome) -> float:
    return -float(np.abs(genome.astype(np.float64)).max())


def _checked(method: Method, index: int, genome: Genome, expected: int) -> Genome:
    assert index == expected, f"candidate {index} came after candidate {expected - 1}"
    assert genome.dtype == np.float32, f"ask_next returns {genome.dtype}, not float32"
    assert genome.shape == (method.representation.genome_size,), f"ask_next returns shape {genome.shape}"
    lower, upper = method.representation.bounds
    assert np.isfinite(genome).all(), "ask_next returns numbers that are not finite"
    assert ((lower <= genome) & (genome <= upper)).all(), "ask_next returns genes outside of bounds"
    return genome.copy()


def _ask_early(method: Method) -> list[Genome]:
    """Ask for all there are, tell one, and so on."""
    asked: list[Genome] = []
    while not method.done:
        while method.can_ask:
            index, genome = method.ask_next()
            asked.append(_checked(method, index, genome, len(asked)))
            genome[:] = np.nan
        method.tell_next(_value(asked[method.evaluations]))
        assert not np.isinf(method.population_fitness).any()
    return asked


def _ask_late(method: Method) -> list[Genome]:
    """Ask only when there is nothing to tell."""
    asked: list[Genome] = []
    waiting: deque[float] = deque()
    while not method.done:
        if not waiting:
            index, genome = method.ask_next()
            asked.append(_checked(method, index, genome, len(asked)))
            waiting.append(_value(genome))
        method.tell_next(waiting.popleft())
    return asked


def _check_window(method: Method) -> None:
    asked = 0
    while method.can_ask:
        method.ask_next()
        asked += 1
    assert asked == method.options.in_flight, f"{asked} in flight, not {method.options.in_flight}"
    _refused(method.ask_next, "asking beyond in_flight must raise InputError")
    method.tell_next(1.0)
    assert method.can_ask, "after a result, the next candidate can be asked for"


def _check_turns(method: Method) -> None:
    _refused(lambda: method.tell_next(1.0), "telling before asking must raise InputError")
    _refused(method.ask, "ask must raise InputError in steady state")
    method.ask_next()
    method.tell_next(1.0)
    _refused(lambda: method.tell_next(1.0), "telling twice must raise InputError")


def _check_failures(method: Method) -> None:
    while not method.done:
        while method.can_ask:
            _, genome = method.ask_next()
        index = method.evaluations
        broken = index < method.generation_size or index % 3
        method.tell_next(np.inf if broken else _value(genome))
    assert np.isnan(method.population_fitness).any() or np.isfinite(method.population_fitness).all()


def _check_target(component: type[Method], subject: Representation) -> None:
    options = component.options_model(operation="steady_state", target=-1e9)
    method = component(options, subject, seed=1)
    _, genome = method.ask_next()
    method.tell_next(_value(genome))
    assert method.done, "a target that is reached must end the method"
    _refused(method.ask_next, "asking when done must raise InputError")


def _check_refusal(component: type[Method], subject: Representation) -> None:
    assert component.generational_because, "generational_because must say why there is no steady state"
    try:
        _new(component, subject, 1)
    except InputError as error:
        if not str(error).startswith("method.operation: "):
            raise AssertionError(f"the message must name method.operation: {error}") from error
        return
    raise AssertionError(f"{component.kind} has no steady_state, and takes operation: steady_state")


def _refused(action: Callable[[], object], otherwise: str) -> None:
    try:
        action()
    except InputError:
        return
    raise AssertionError(otherwise)

"""nnga and cea2d give the genomes of their plain forms, to the last bit, for every representation."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from swarmwright.common.arrays import Genomes
from swarmwright.controllers import REPRESENTATIONS, Representation
from swarmwright.methods.cea2d import Cea2d, Cea2dOptions
from swarmwright.methods.nnga import Nnga, NngaOptions
from tests.python.methods.plain import PlainCea2d, PlainMembers, PlainNnga, plain

REPRESENTED: dict[str, dict[str, Any]] = {
    "layered": {"hidden": [3]},
    "fully_meshed": {"hidden": 1, "mutation": "proportional"},
    "mealy_fsm": {"states": 2},
    "parameter_set": {
        "parameters": {
            "speed": {"type": "real", "range": [0.5, 2.0]},
            "agents": {"type": "integer", "range": [1, 20]},
            "rule": {"type": "categorical", "choices": ["a", "b", "c"]},
        }
    },
}
SHARES: list[dict[str, Any]] = [
    {},
    {"elite": 0.0, "random": 0.3},
    {"severity": 0.0},  # children that are the same as members
    {"probability": 0.3, "partners": 2, "renew": 0.15, "mutate": 0.3},
    {"islands": 3, "exchange_interval": 2, "exchange": 0.6, "population": 20},
]
TORI: list[dict[str, Any]] = [
    {},
    {"width": 2, "height": 3},
    {"width": 5, "height": 4, "obstacles": 7, "probability": 0.3},
    {"neighbourhood": "random", "elite": 0.4, "mutate": 0.3, "renew": 0.0, "crossover": 0.3},
    {"elite": 0.0, "mutate": 0.4, "crossover": 0.4, "renew": 0.2},
    {"width": 2, "height": 2, "obstacles": 2, "elite": 0.9, "mutate": 0.1, "crossover": 0.0},
]


def represented(kind: str) -> Representation:
    component = REPRESENTATIONS.get(kind)
    options = component.options_model.model_validate(REPRESENTED[kind])
    return component(options, sensors=3, actuators=2)


def fitness_of(genomes: Genomes, generation: int) -> NDArray[np.float64]:
    """Rounded, so that some are equal; a few fail."""
    values: NDArray[np.float64] = np.round(-np.abs(genomes.astype(np.float64) - 0.3).sum(axis=1) * 3)
    values[(generation + np.arange(len(values))) % 7 == 0] = np.nan
    return values


def in_generations(method: Any) -> list[Genomes]:
    asked = []
    while not method.done:
        asked.append(method.ask())
        kept = method.survivors()
        again = fitness_of(kept, 5) if method.generation == 3 else None
        method.tell(fitness_of(asked[-1], method.generation), again)
    return asked


def one_by_one(method: Any) -> list[Genomes]:
    asked = []
    while not method.done:
        while method.can_ask:
            asked.append(method.ask_next()[1])
        told = asked[method.evaluations]
        method.tell_next(fitness_of(told[np.newaxis], method.evaluations)[0])
    return asked


def same(one: list[Genomes], other: list[Genomes]) -> None:
    assert [genomes.tobytes() for genomes in one] == [genomes.tobytes() for genomes in other]


@pytest.mark.parametrize("options", SHARES)
@pytest.mark.parametrize("kind", REPRESENTED)
def test_nnga_in_generations(kind: str, options: dict[str, Any]) -> None:
    chosen = NngaOptions.model_validate({"generations": 7, **defaults(options)})
    subject = represented(kind)
    found = in_generations(Nnga(chosen, subject, seed=3))
    same(found, in_generations(PlainNnga(chosen, plain(subject), seed=3)))
    assert len(found) == 7


def defaults(options: dict[str, Any]) -> dict[str, Any]:
    """The options, with an elite that fills the population."""
    shares = {"random": 0.1, "mutate": 0.4, "crossover": 0.3, "renew": 0.05, **options}
    if "elite" in options:
        shares["crossover"] = 1 - sum(shares[name] for name in ("elite", "random", "mutate", "renew"))
    else:
        shares["elite"] = 1 - sum(shares[name] for name in ("random", "mutate", "crossover", "renew"))
    return shares


@pytest.mark.parametrize("options", SHARES[:-1])
@pytest.mark.parametrize("kind", REPRESENTED)
def test_nnga_in_steady_state(kind: str, options: dict[str, Any]) -> None:
    values = {"generations": 6, "operation": "steady_state", "population": 23, "in_flight": 5}
    chosen = NngaOptions.model_validate({**values, **defaults(options)})
    subject = represented(kind)
    other = PlainNnga(chosen, plain(subject), seed=3)
    other._steady = PlainMembers(chosen, other.representation)
    found = one_by_one(Nnga(chosen, subject, seed=3))
    same(found, one_by_one(other))
    assert len(found) == 6 * 23


@pytest.mark.parametrize("operation", ["generational", "steady_state"])
@pytest.mark.parametrize("options", TORI)
@pytest.mark.parametrize("kind", REPRESENTED)
def test_cea2d(kind: str, options: dict[str, Any], operation: str) -> None:
    values = {"generations": 6, "operation": operation, "width": 5, "height": 5, "in_flight": 7}
    chosen = Cea2dOptions.model_validate({**values, **options})
    subject = represented(kind)
    run = one_by_one if operation == "steady_state" else in_generations
    found = run(Cea2d(chosen, subject, seed=4))
    other = PlainCea2d(chosen, plain(subject), seed=4)
    same(found, run(other))
    assert Cea2d(chosen, subject, seed=4).neighbours == [
        other.around(member) for member in range(chosen.members)
    ]

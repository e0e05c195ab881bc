"""Operators of many genomes give the bits of those of one, whatever the options and however many at once."""

from typing import Any

import numpy as np
import pytest

from swarmwright.common.arrays import Genome, Genomes
from swarmwright.common.random_numbers import Stream, Streams
from swarmwright.controllers import REPRESENTATIONS, Representation, _base
from swarmwright.controllers.kinds import mealy_fsm
from swarmwright.controllers.kinds.mealy_fsm import MealyFsm, MealyFsmOptions
from tests.python.methods.plain import plain

REAL = {"type": "real", "range": [0.5, 2.0]}
CHOICE = {"type": "categorical", "choices": ["a", "b", "c"]}
REPRESENTED: dict[str, tuple[str, dict[str, Any]]] = {
    "layered": ("layered", {"hidden": [3, 2]}),
    "one node": ("layered", {"hidden": []}),
    "fully meshed": ("fully_meshed", {"hidden": 2, "mutation": "proportional"}),
    "evostick": ("evostick", {}),
    "hebbian": ("hebbian", {"mutation": "proportional"}),
    "neat": ("neat", {"sources": [[0, 3], [0, 1, 2]], "mutation": "proportional"}),
    "growing": ("neat", {"max_nodes": 5, "add_node": 0.5, "add_connection": 0.5, "recurrent": True}),
    "machine": ("mealy_fsm", {"states": 3}),
    "continuous machine": ("mealy_fsm", {"output_levels": 0}),
    "one row": ("mealy_fsm", {"states": 1, "levels": 1}),
    "real": ("parameter_set", {"parameters": {"speed": REAL}}),
    "categorical": ("parameter_set", {"parameters": {"rule": CHOICE}}),
    "two": ("parameter_set", {"parameters": {"speed": REAL, "rule": CHOICE}}),
    "five": ("parameter_set", {"parameters": {name: CHOICE if name == "c" else REAL for name in "abcde"}}),
}


def represented(name: str) -> Representation:
    kind, options = REPRESENTED[name]
    component = REPRESENTATIONS.get(kind)
    return component(component.options_model.model_validate(options), sensors=2, actuators=1)


def streams(purpose: str, count: int = 40) -> Streams:
    drawn = Streams(9, purpose, 3, range(count))
    drawn.integers(5, 1)  # a stream goes on where it is
    return drawn


def varied(subject: Representation) -> list[bytes]:
    """What all operators make."""
    genomes = subject.initials(streams("initial"))
    rng = np.random.default_rng(1)
    others = genomes[rng.integers(40, size=40)]
    # Genes that say less directly what they mean, and some that are beyond the bounds.
    genomes = (genomes * np.float32(1.03)).astype(np.float32)
    partners = rng.integers(40, size=(40, 6))
    made: list[Genomes] = [
        genomes,
        subject.crossovers(genomes, others, streams("cross")),
        subject.matings(genomes, np.arange(40), partners, streams("mate")),
    ]
    for severity, probability in ((0.3, 1.0), (0.8, 0.4), (1.5, 0.9), (0.0, 1.0), (0.3, 0.0)):
        options = {"severity": severity, "probability": probability}
        made.append(subject.mutations(genomes, streams("mutate"), **options))
    assert {one.dtype for one in made} == {np.dtype(np.float32)}
    distances = subject.distances_among(genomes, np.arange(40), partners)
    return [*(one.tobytes() for one in made), distances.tobytes()]


@pytest.mark.parametrize("few", [None, "FEW", "MANY"])
@pytest.mark.parametrize("name", REPRESENTED)
def test_many_are_varied_like_one_after_the_other(
    name: str, few: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    subject = represented(name)
    expected = varied(plain(subject))
    if few is not None:
        monkeypatch.setattr(_base if few == "FEW" else mealy_fsm, few, 50)
    assert varied(subject) == expected


@pytest.mark.parametrize("name", REPRESENTED)
def test_how_genomes_lie_in_memory_does_not_matter(name: str) -> None:
    subject = represented(name)
    genomes = subject.initials(streams("initial"))
    columns = np.asfortranarray(genomes)
    change = {"severity": 0.5, "probability": 0.5}
    for made in (
        lambda rows: subject.mutations(rows, streams("mutate"), **change),
        lambda rows: subject.crossovers(rows, rows[::-1], streams("cross")),
        lambda rows: subject.distances_among(rows, np.array([0, 1]), np.array([[2, 3], [3, 4]])),
    ):
        assert made(columns).tobytes() == made(genomes).tobytes()


def test_a_subclass_that_varies_one_genome_otherwise_varies_many_so() -> None:
    class Opposite(MealyFsm):
        def mutate(self, genome: Genome, stream: Stream, *, severity: float, probability: float) -> Genome:
            return -super().mutate(genome, stream, severity=severity, probability=probability)

        def distance(self, genome: Genome, other: Genome) -> float:
            return -super().distance(genome, other)

    options = MealyFsmOptions()
    found, subject = (kind(options, sensors=2, actuators=1) for kind in (Opposite, MealyFsm))
    genomes = subject.initials(streams("initial", 5))
    change = {"severity": 0.5, "probability": 0.5}
    mutants = subject.mutations(genomes, streams("mutate", 5), **change)
    assert found.mutations(genomes, streams("mutate", 5), **change).tolist() == (-mutants).tolist()
    ones, others = np.array([0, 1]), np.array([[2, 3], [3, 4]])
    distances = subject.distances_among(genomes, ones, others)
    assert found.distances_among(genomes, ones, others).tolist() == (-distances).tolist()
    # What it leaves as it is stays as fast.
    assert Opposite.crossovers is MealyFsm.crossovers

"""XOR, which no network without hidden nodes or feedback can do, by evolved controllers."""

import numpy as np
import pytest

from swarmwright import Controller
from swarmwright.representations import REPRESENTATIONS, Representation
from swarmwright.typing import Genome
from tests.python.methods.functions import new

CASES = np.array([[0, 0], [0, 1], [1, 0], [1, 1]], dtype=np.float32)
WANTED = np.array([-1.0, 1.0, 1.0, -1.0])


def meshed() -> Representation:
    component = REPRESENTATIONS.get("fully_meshed")
    return component(component.options_model(), sensors=2, actuators=1)


def answers(subject: Representation, genome: Genome) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    controller = Controller(subject.specification(genome))
    found = []
    for case in CASES:
        controller.reset()
        found.append(float(controller(case)[0]))
    return np.array(found)


@pytest.mark.parametrize(
    ("kind", "generations"),
    [
        ("nnga", 100),
        ("cea2d", 50),
        ("cma_es", 200),
        ("sep_cma_es", 200),
        ("de", 60),
        ("pso", 100),
        ("snes", 200),
    ],
)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_fully_meshed_network_learns_xor(kind: str, generations: int, seed: int) -> None:
    subject = meshed()
    method = new(kind, seed=seed, subject=subject, generations=generations, target=-0.04)
    best: Genome | None = None
    fitness = np.empty(0)
    while not method.done:
        genomes = method.ask()
        fitness = np.array([-((answers(subject, genome) - WANTED) ** 2).sum() for genome in genomes])
        best = genomes[int(np.argmax(fitness))]
        method.tell(fitness)
    assert fitness.max() >= -0.04, f"best after {method.evaluations} evaluations: {fitness.max()}"
    assert best is not None
    # A tenth, all four together: each answer is near the one that is wanted.
    assert np.abs(answers(subject, best) - WANTED).max() <= 0.2

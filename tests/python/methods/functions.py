"""Functions to minimize, in ten dimensions, and the representation whose genomes are their points."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.arrays import Genomes
from swarmwright.controllers import REPRESENTATIONS, Representation
from swarmwright.methods import METHODS, Method

Points = NDArray[np.float64]
Function = Callable[[Points], NDArray[np.float64]]


def ten_genes(reach: float = 3.0) -> Representation:
    """Ten genes that start in +-reach."""
    layered = REPRESENTATIONS.get("layered")
    options = layered.options_model(hidden=[], weight_range=reach, bias_range=reach)  # type: ignore[call-arg]
    made = layered(options, sensors=9, actuators=1)
    assert made.genome_size == 10
    return made


def sphere(points: Points) -> NDArray[np.float64]:
    """Least at 0."""
    return np.asarray((points**2).sum(axis=1))


def rosenbrock(points: Points) -> NDArray[np.float64]:
    """A bent valley; least at 1, 1, ..."""
    here, after = points[:, :-1], points[:, 1:]
    return np.asarray((100 * (after - here**2) ** 2 + (1 - here) ** 2).sum(axis=1))


def rastrigin(points: Points) -> NDArray[np.float64]:
    """Many dents; least at 0."""
    return np.asarray((points**2 - 10 * np.cos(2 * np.pi * points) + 10).sum(axis=1))


FUNCTIONS = [sphere, rosenbrock, rastrigin]


def new(kind: str, *, seed: int = 1, subject: Representation | None = None, **options: Any) -> Method:
    """A method with these options."""
    component = METHODS.get(kind)
    return component(component.options_model.model_validate(options), subject or ten_genes(), seed=seed)


def evaluations_to(method: Method, function: Function, target: float) -> int | None:
    """How many evaluations it takes until the function is at most `target`; None when it never is."""
    while not method.done:
        genomes = method.ask()
        values = function(genomes.astype(np.float64))
        reached = np.flatnonzero(values <= target)
        if len(reached):
            return method.evaluations + int(reached[0]) + 1
        method.tell(-values)
    return None


def conversation(method: Method, function: Function, generations: int) -> list[Genomes]:
    """What is asked for, generation by generation."""
    asked: list[Genomes] = []
    while not method.done and len(asked) < generations:
        asked.append(method.ask())
        method.tell(-function(asked[-1].astype(np.float64)))
    return asked

"""A package that builds on Swarmwright, in the forms that the documentation shows.

`test_plug_in.py` has it checked by mypy and pyright, both strict; an error that must be found has a comment
for each, which is one too many where the error is not found.
"""

from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

import swarmwright as sw
from swarmwright.common.arrays import Fitness
from swarmwright.controllers import (
    Genome,
    Genomes,
    Representation,
    RepresentationOptions,
    Stream,
)
from swarmwright.controllers.kinds.layered import LayeredOptions
from swarmwright.methods import Method, MethodOptions
from swarmwright.methods.nnga import NngaOptions
from swarmwright.methods.rankings import Ranking, RankingOptions


class SampleOptions(MethodOptions):
    """Random candidates."""

    kind: Literal["sample"] = "sample"
    population: int = Field(default=10, ge=1)
    """Candidates in each generation."""


class Sample(Method):
    """Draws every candidate anew."""

    kind: ClassVar[str] = "sample"
    options_model = SampleOptions
    options: SampleOptions

    def __init__(self, options: SampleOptions, representation: Representation, *, seed: int) -> None:
        super().__init__(options, representation, seed=seed)
        self._fitness: Fitness = np.empty(0)

    @property
    def budget(self) -> int:
        return self.options.population * self.options.generations

    @property
    def population_fitness(self) -> Fitness:
        return self._fitness

    def _ask(self) -> Genomes:
        return self.initials(range(self.options.population))

    def _tell(self, genomes: Genomes, fitness: Fitness) -> None:  # noqa: ARG002
        self._fitness = fitness


class LowerOptions(RankingOptions):
    """The lowest episode."""

    kind: Literal["lower"] = "lower"


class Lower(Ranking):
    """Ranks by the lowest episode."""

    kind: ClassVar[str] = "lower"
    options_model = LowerOptions

    def _score(self, episodes: Sequence[Sequence[float]]) -> Fitness:
        return np.array([min(one) for one in episodes])


class BiasOptions(RepresentationOptions):
    """Constant actuators."""

    kind: Literal["bias"] = "bias"
    limit: float = Field(default=1.0, gt=0)
    """Of each gene."""


class Bias(Representation):
    """A gene for each actuator."""

    kind: ClassVar[str] = "bias"
    options_model = BiasOptions
    options: BiasOptions

    @property
    def genome_size(self) -> int:
        return self.actuators * (self.sensors + 1)

    def architecture(self) -> dict[str, Any]:
        return {"kind": "layered", "sensors": self.sensors, "actuators": self.actuators, "hidden": []}

    def initial(self, stream: Stream) -> Genome:
        return stream.uniform(np.full(self.genome_size, self.options.limit)).astype(np.float32)

    def mutate(self, genome: Genome, stream: Stream, *, severity: float, probability: float) -> Genome:
        chosen = stream.unit(self.genome_size) < probability
        return np.where(chosen, genome + severity, genome).astype(np.float32)

    def crossover(self, mother: Genome, father: Genome, stream: Stream) -> Genome:
        return np.concatenate([mother[: stream.integer(len(mother))], father])[: len(mother)]

    def distance(self, genome: Genome, other: Genome) -> float:
        return float(np.abs(genome - other).sum())


class Hold(sw.Simulation):
    """Agents that keep to their places."""

    title, dimensions, sensors, actuators = "hold", 1, 1, 1
    parameters: Mapping[str, sw.Parameter] = {"drift": sw.Parameter(0.1, "Metres per step.")}
    metrics = ("moved",)
    sensor_names = ("x",)
    determinism = "bitwise"

    def __init__(self) -> None:
        self.max_agents = 3
        self.x = np.zeros((3, 1))
        self.left = 0

    def reset(self, parameters: dict[str, Any], seed: int) -> NDArray[np.float64]:
        self.x = np.random.default_rng(seed).normal(parameters["drift"], size=(3, 1))
        self.left = 20
        return self.x

    def step(self, actions: NDArray[np.float32]) -> NDArray[np.float64]:
        self.x += actions
        self.left -= 1
        return self.x

    def done(self) -> bool:
        return self.left == 0

    def fitness(self) -> float:
        return -float(np.abs(self.x).mean())

    def measure(self) -> Mapping[str, float]:
        return {"moved": float(self.x.sum())}


class Calm(Hold):
    """Agents that hardly drift; attributes in other forms than the base class has."""

    parameters: ClassVar[Mapping[str, sw.Parameter]] = {  # type: ignore[misc] # pyright: ignore[reportIncompatibleVariableOverride]
        "drift": sw.Parameter(0.01)
    }

    @property
    def frame_seconds(self) -> float:  # type: ignore[override] # pyright: ignore[reportIncompatibleVariableOverride]
        return 0.2


def settings_of(experiment: sw.Experiment) -> list[float]:
    """Return options of kinds that are known."""
    found: list[float] = [experiment.method.generations]
    if isinstance(experiment.method, NngaOptions):
        found.append(experiment.method.population)
    if isinstance(experiment.controller, LayeredOptions):
        found.append(len(experiment.controller.kind))
    experiment.method.populaton = 3  # type: ignore[attr-defined] # pyright: ignore[reportAttributeAccessIssue]
    experiment.method.generations = 3  # type: ignore[misc] # pyright: ignore[reportAttributeAccessIssue]
    return found


def study(file: PathLike[str], folder: PathLike[str], seed: np.int64) -> float:
    """Use functions with what they take."""
    experiment = sw.Experiment.load(file)
    method = experiment.new_method()
    method.tell([1.0] * len(method.ask()))
    run = sw.optimize(experiment, out=folder)
    again = sw.resume(run.path, generations=4)
    sw.resume(folder)
    sw.repeat(folder)
    run.export(folder)
    sw.simulate(file, seed=seed)
    return again.best.fitness

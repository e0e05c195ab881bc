"""The compiled engine. Everything here is built from `engine/bindings/python`; `mypy.stubtest` checks the two against each other."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Literal, final

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.engine_types import (
    AttemptFields,
    Counts,
    Description,
    Mission,
    News,
    Presence,
    Report,
    Requirements,
    SceneArrays,
    SceneFields,
    ServerEvent,
    SideFields,
    WarningFields,
)
from swarmwright.servers.evaluation.served_modules import ServedModules
from swarmwright.simulations.physics import AnyHost

__all__ = [
    "FAULTS",
    "TIMEOUTS",
    "Broker",
    "Cma",
    "Controller",
    "Digests",
    "EngineError",
    "Episode",
    "Episodes",
    "Evaluator",
    "GrowingNetwork",
    "InputError",
    "LostError",
    "NoBrokerError",
    "NoServerError",
    "NodeNetwork",
    "Pool",
    "Producer",
    "Ranks",
    "RemoteEpisode",
    "Sample",
    "Search",
    "Stream",
    "Streams",
    "Supervision",
    "Torus",
    "Watcher",
    "__version__",
    "account",
    "aggregates",
    "centered_ranks",
    "certificates",
    "check_instructions",
    "decimals",
    "describe",
    "distances",
    "distinct",
    "evaluate",
    "evaluate_host",
    "exp",
    "figures",
    "forget",
    "genome_size",
    "hash_for_mosquitto",
    "hash_password",
    "levels",
    "log",
    "log_line",
    "log_to",
    "missions",
    "outcome",
    "parameter_mistakes",
    "rays",
    "robots",
    "serve",
    "servers",
    "simulations",
    "steers_itself",
    "survivors",
    "utilities",
]

__version__: str

TIMEOUTS: dict[str, Any]
"""The defaults of an experiment's `timeouts`, all of them."""
FAULTS: dict[str, Any]
"""The defaults of an experiment's `faults`, all of them."""

class EngineError(RuntimeError):
    """The engine could not do what was asked; the message says what, where and how to fix it."""

class NoBrokerError(EngineError):
    """No broker answers there; one may later."""

class NoServerError(EngineError):
    """No server answered, not even one that does not fit."""

class LostError(EngineError):
    """Messages of an episode were lost, or its server: another time it may go well."""

class InputError(ValueError):
    """The input is wrong (parameters, controller, URL); the message names the field."""

def simulations() -> list[str]:
    """Titles of the built-in simulations, sorted."""

def describe(title: str, parameters: dict[str, Any] | None = None) -> Description:
    """The description of a built-in simulation; parameters and metrics in alphabetical order.

    Sensors, actuators and metrics are those with these parameters (default: with the default ones); `varies` says
    whether they depend on them.
    Raises InputError for an unknown title, and for parameters that the simulation refuses.
    """

def missions() -> list[Mission]:
    """The built-in missions of the arena, sorted by name."""

def robots() -> list[str]:
    """The names of the built-in models of robots of the arena."""

def rays(parameters: dict[str, Any]) -> list[list[float]]:
    """The directions of proximity rays, for each model of robots in the arena, radians counter-clockwise from ahead.

    Raises InputError for parameters that the arena refuses.
    """

def parameter_mistakes(title: str, parameters: dict[str, Any]) -> list[tuple[str, str]]:
    """Return all that is wrong with parameters of a built-in simulation, each as (place, reason).

    Here and below: parameters are values of JSON's kinds; InputError names the place of any other and of numbers that
    are not finite.
    """

def steers_itself(title: str, parameters: dict[str, Any]) -> bool:
    """Whether agents of a built-in simulation steer themselves with these parameters.

    Raises InputError for an unknown title and for parameters that the simulation refuses.
    """

@final
class Controller:
    """Inference of one controller, sensors in, actuators out, in the arithmetic of docs/decisions/002-arithmetic.md.

    specification: JSON text, see protocol/schemas/controller.schema.json. State is kept between steps until `reset`.
    """

    def __new__(cls, specification: str) -> Controller: ...
    @property
    def sensors(self) -> int: ...
    @property
    def actuators(self) -> int: ...
    @property
    def parameters(self) -> dict[str, Any]:
        """Values of a parameter set, by name; empty for what steers agents."""

    def of_agent(self, agent: int) -> Controller:
        """The controller of an agent of a team; of another controller, one at the start of an episode.

        Raises InputError for an agent that belongs to no group.
        """

    def reset(self) -> None: ...
    def step(self, sensors: NDArray[np.float32]) -> NDArray[np.float32]:
        """(sensors,) float32 -> (actuators,) float32 in -1..1. Raises InputError for another length or a NaN."""

def genome_size(architecture: dict[str, Any]) -> int:
    """Number of weights that controllers of an architecture (specification, its `weights` ignored) have.

    Raises InputError naming the key that is wrong.
    """

@final
class Episode:
    """One simulation, by its title or as a host, stepped in this process by one controller for all agents."""

    def __new__(cls, simulation: str | AnyHost, parameters: dict[str, Any], controller: str) -> Episode:
        """controller: specification as JSON text."""
    @property
    def done(self) -> bool: ...
    @property
    def fitness(self) -> float: ...
    def metrics(self, names: list[str]) -> list[float]:
        """The named metrics so far. Raises InputError for an unknown one."""
    @property
    def step_size(self) -> float:
        """Seconds between two frames when shown."""
    def step(self) -> None: ...
    def step_observed(self) -> tuple[NDArray[np.uint32], NDArray[np.float32], NDArray[np.float32]]:
        """Step; (n,) agents, (n, sensors) what they sensed, (n, actuators) what they did, in the order of acting."""
    @property
    def metric_names(self) -> list[str]:
        """Names of all metrics of the simulation."""
    def scene(self) -> SceneFields:
        """What it looks like; y points up, metres or cells. Raises EngineError when there is nothing to show."""
    def scene_arrays(self) -> SceneArrays:
        """The same as arrays, for swarms of thousands."""
    def machine_states(self) -> NDArray[np.int32] | None:
        """(agents,), the state in which the state machine of each makes its next step; None where none has any.

        -1 for agents of a team whose controllers have no states. Agents after the last one have not acted: they
        are in state 0, or have none where the last one has none.
        """
    def text(self, columns: int, color: bool, rows: int = 24, unicode: bool = True) -> str:
        """The scene as at most `rows` lines of at most `columns` characters."""

@final
class Episodes:
    """Episodes of one simulation, by its title or as a host, that are stepped side by side from outside."""

    def __new__(cls, simulation: str | AnyHost, parameters: dict[str, Any], seeds: Sequence[int]) -> Episodes:
        """seeds: of the simulation, one for each episode. Raises InputError for wrong parameters, and for several seeds of a host whose simulation runs one episode at a time."""
    @property
    def done(self) -> bool:
        """Whether all have ended."""
    @property
    def mid_step(self) -> bool:
        """Of the first one: whether agents act in turn, and others have yet to."""
    def acting(self) -> tuple[NDArray[np.uint32], NDArray[np.uint32], NDArray[np.float32]]:
        """(n,) episodes, (n,) agents that act next, in the order of episodes, (n, sensors) what they sense.

        Episodes that have ended are left out.
        """
    def step(self, actuators: NDArray[np.float32]) -> None:
        """Step all that have not ended; (n, actuators), the rows of `acting`, each number in -1..1."""
    def fitness(self) -> NDArray[np.float64]:
        """(episodes,), so far."""
    def metrics(self, names: list[str]) -> NDArray[np.float64]:
        """(episodes, names), so far. Raises InputError for an unknown one."""
    @property
    def metric_names(self) -> list[str]:
        """Names of all metrics of the simulation."""
    @property
    def step_size(self) -> float:
        """Seconds between two frames when shown."""
    def scene(self) -> SceneFields:
        """What the first one looks like, see `Episode.scene`."""
    def scene_arrays(self) -> SceneArrays:
        """The same as arrays."""
    def text(self, columns: int, color: bool, rows: int = 24, unicode: bool = True) -> str:
        """The same as text."""

@final
class RemoteEpisode:
    """An episode that a simulation server computes and shows, step by step; controllers are here. As `Episode`, and:"""

    def __new__(
        cls,
        broker: str,
        *,
        simulation: str,
        parameters: dict[str, Any],
        requirements: Requirements,
        controller: str,
        prefix: str = "",
        discovery: float = 10.0,
        step: float = 60.0,
    ) -> RemoteEpisode:
        """parameters: of the episode, its seed among them. controller: specification with weights, JSON. discovery, step: seconds to wait for a server, for its next message. Raises NoBrokerError, LostError, EngineError (refused, no server with scenes) or InputError."""
    @property
    def done(self) -> bool: ...
    @property
    def fitness(self) -> float:
        """So far; NaN where the server does not say."""
    @property
    def server(self) -> int:
        """Which server computes it."""
    @property
    def missing(self) -> int:
        """Scenes before the last one that did not come."""
    def metrics(self, names: list[str]) -> list[float]:
        """So far; NaN for those that the server does not say."""
    @property
    def metric_names(self) -> list[str]: ...
    @property
    def step_size(self) -> float: ...
    def step(self) -> None:
        """Until the next scene. Raises LostError or EngineError; KeyboardInterrupt promptly."""
    def step_observed(self) -> tuple[NDArray[np.uint32], NDArray[np.float32], NDArray[np.float32]]: ...
    def scene(self) -> SceneFields: ...
    def scene_arrays(self) -> SceneArrays: ...
    def machine_states(self) -> NDArray[np.int32] | None: ...
    def text(self, columns: int, color: bool, rows: int = 24, unicode: bool = True) -> str: ...
    def close(self) -> None:
        """End it on the server, where it has not ended, and leave the broker."""

def decimals(genomes: NDArray[np.float32]) -> list[str]:
    """Each row of (candidates, genes) as text: the shortest decimals that read back as the same binary32.

    Commas stand between them.

    Raises InputError for a gene that is not finite.
    """

@final
class Stream:
    """An endless sequence of random numbers with an address of its own, see `swarmwright.common.random_numbers`.

    seed: of the experiment. purpose: what the numbers are for, like "nnga.mutate"; another purpose is another sequence.
    candidate: index within the generation. All numbers from 0 to 2**64 - 1, else OverflowError.
    """

    def __new__(cls, seed: int, purpose: str, generation: int = 0, candidate: int = 0) -> Stream: ...
    def raw(self, count: int) -> NDArray[np.uint64]:
        """`count` words of 64 random bits."""
    def unit(self, count: int) -> NDArray[np.float64]:
        """`count` multiples of 2**-53, uniform in [0, 1)."""
    def uniform(self, border: NDArray[np.float64]) -> NDArray[np.float64]:
        """A number for each border b >= 0, uniform in [-b, b)."""
    def normals(self, count: int) -> NDArray[np.float64]:
        """`count` numbers of the standard normal distribution, see `Streams.normals`."""
    def integer(self, below: int) -> int:
        """An integer, uniform in 0 .. below - 1, without bias. Raises InputError unless 1 <= below <= 2**64."""
    def integers(self, below: int, count: int) -> list[int]:
        """`count` integers, the same as so many calls of `integer` would give."""

@final
class Streams:
    """Streams that differ in the candidate alone: one for each of `candidates`, in that order.

    `streams[i]` is a copy that goes on where the i-th is; drawing from it does not move that one.
    """

    def __new__(
        cls, seed: int, purpose: str, generation: int, candidates: Sequence[int] | NDArray[np.int64]
    ) -> Streams: ...
    def __len__(self) -> int: ...
    def __getitem__(self, index: int, /) -> Stream: ...
    def __iter__(self) -> Iterator[Stream]: ...
    def units(self, count: int) -> NDArray[np.float64]:
        """(streams, count): `count` multiples of 2**-53 of each stream, uniform in [0, 1)."""
    def normals(self, count: int) -> NDArray[np.float64]:
        """(streams, count): `count` numbers of the standard normal distribution of each stream, |z| <= 6.7, as precise as binary32.

        Pairs of Box and Muller (Annals of Mathematical Statistics 29, 1958), one of each word of 64 random bits; of an odd count
        the last pair gives one number. Their arithmetic is fixed (docs/decisions/002-arithmetic.md).
        """
    def integers(self, below: int | Sequence[int] | NDArray[np.int64], count: int) -> NDArray[np.int64]:
        """(streams, count): `count` integers of each stream, uniform in 0 .. below - 1, without bias.

        below: one for all streams, or one for each. Raises InputError unless 1 <= below < 2**63.
        """

@final
class NodeNetwork:
    """Genetic operators of genomes that are rows of nodes, each with its bias first and then its weights.

    sizes: weights of each node. What the operators do: `swarmwright.controllers.networks`. Those of
    many genomes take a stream for each and give the same bits as those of one. Raises InputError for shapes that do not fit.
    """

    def __new__(
        cls,
        sizes: Sequence[int],
        *,
        weight_range: float,
        bias_range: float,
        mutation: Literal["uniform", "proportional"],
    ) -> NodeNetwork: ...
    def initial(self, stream: Stream) -> NDArray[np.float32]: ...
    def initials(self, streams: Streams) -> NDArray[np.float32]: ...
    def mutate(
        self, parent: NDArray[np.float32], stream: Stream, *, severity: float, probability: float
    ) -> NDArray[np.float32]: ...
    def mutations(
        self, parents: NDArray[np.float32], streams: Streams, *, severity: float, probability: float
    ) -> NDArray[np.float32]: ...
    def crossover(
        self, mother: NDArray[np.float32], father: NDArray[np.float32], stream: Stream
    ) -> NDArray[np.float32]: ...
    def crossovers(
        self, mothers: NDArray[np.float32], fathers: NDArray[np.float32], streams: Streams
    ) -> NDArray[np.float32]: ...
    def matings(
        self,
        genomes: NDArray[np.float32],
        mothers: NDArray[np.int64],
        partners: NDArray[np.int64],
        streams: Streams,
    ) -> NDArray[np.float32]: ...

@final
class GrowingNetwork:
    """Genetic operators of networks that grow, see `swarmwright.controllers.kinds.neat.GrowingNeat`.

    nodes, connections: most of a network. pattern: whether activations are those of functions of space. Raises InputError for
    numbers and names that do not fit, and genomes of a wrong length.
    """

    def __new__(
        cls,
        *,
        sensors: int,
        actuators: int,
        nodes: int,
        connections: int,
        recurrent: bool,
        activations: Sequence[str],
        weight_range: float,
        add_node: float,
        add_connection: float,
        toggle: float,
        pattern: bool = False,
    ) -> GrowingNetwork: ...
    @property
    def genes(self) -> int:
        """Number of genes."""
    def initial(self, stream: Stream) -> NDArray[np.float32]: ...
    def mutate(
        self, parent: NDArray[np.float32], stream: Stream, *, severity: float, probability: float
    ) -> NDArray[np.float32]: ...
    def crossover(
        self, mother: NDArray[np.float32], father: NDArray[np.float32], stream: Stream
    ) -> NDArray[np.float32]: ...
    def distance(self, genome: NDArray[np.float32], other: NDArray[np.float32]) -> float: ...
    def patterns(self, genomes: NDArray[np.float32], points: NDArray[np.float32]) -> NDArray[np.float32]:
        """The outputs at points in space, (genomes, points, actuators), -1 to 1, of feed-forward networks.

        points: (points, sensors).
        """

@final
class Ranks:
    """Members that are replaced one by one, in the order of their ranks; of equal ones the first is ahead.

    members: how many, at least 1; all have failed until their fitness is set. Raises InputError for a member that does not exist.
    """

    def __new__(cls, members: int) -> Ranks: ...
    def set(self, member: int, fitness: float) -> None:
        """A member gets another fitness; NaN: it has failed."""
    @property
    def worst(self) -> int:
        """Of the members that failed the last one, else the one of least fitness."""
    @property
    def worked(self) -> int:
        """How many have not failed."""
    def draw(self, stream: Stream, count: int) -> list[int]:
        """`count` members, the k-th best of m that have not failed with a probability proportional to m - k."""

@final
class Torus:
    """Who meets whom on a torus, and how many of a neighbourhood stay, see `swarmwright.methods.cea2d`.

    elite: share of a neighbourhood that stays. random: 8 neighbours drawn from all instead of those around a cell. fitness:
    (members,), NaN for those that failed. Raises InputError for a member that does not exist, and for shapes that do not fit.
    """

    def __new__(
        cls, width: int, height: int, *, obstacles: int, random: bool, elite: float, seed: int
    ) -> Torus: ...
    def neighbours(self, member: int) -> list[int]:
        """The neighbours of a member, ascending."""
    def elite(self, fitness: NDArray[np.float64], member: int) -> list[int]:
        """Those of a neighbourhood that stay, the best first."""
    def stays(self, fitness: NDArray[np.float64], member: int) -> bool:
        """Whether a member is among the best of its neighbourhood."""
    def changing(self, fitness: NDArray[np.float64]) -> NDArray[np.int64]:
        """The members that do not stay, ascending."""
    def next(self, fitness: NDArray[np.float64], cursor: int) -> int | None:
        """The first member from `cursor` on, round the torus, that does not stay."""
    def choose(
        self,
        fitness: NDArray[np.float64],
        cells: NDArray[np.int64],
        drawn: NDArray[np.float64],
        *,
        mutate: float,
        crossover: float,
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """How the members that come into cells are made.

        drawn: (cells, 2), uniform in [0, 1). mutate, crossover: shares. Returns (cells,) parents; and the indices of cells whose
        member is a mutated copy of the parent, its child with the cell's own member, and a random one.
        """

def survivors(fitness: NDArray[np.float64], best: int, random: int, stream: Stream) -> NDArray[np.int64]:
    """Return the indices of members that stay: the best, then `random` others, drawn one after the other.

    The k-th best of m that remain is drawn with a probability proportional to m - k. Of equal ones the first is ahead; those that
    failed (NaN) do not stay.
    """

def distinct(genomes: NDArray[np.float32], existing: Sequence[NDArray[np.float32]]) -> NDArray[np.int64]:
    """Return the indices of genomes that are, to the bit, the same as no earlier one and no row of `existing`."""

@final
class Cma:
    """A search by covariance matrix adaptation: `ask` for a sample, `tell` its fitness.

    center: where it starts, as genes. reach: half of the initial range of each gene, > 0; its unit at first. lower, upper: bounds,
    -inf and inf where there are none. All (genes,), genes >= 1. step: standard deviation in units, > 0. population: genomes of each
    sample, >= 3. separable: whether the covariance matrix stays diagonal. Raises InputError for values that do not fit.
    """

    def __new__(
        cls,
        center: NDArray[np.float64],
        *,
        reach: NDArray[np.float64],
        lower: NDArray[np.float64],
        upper: NDArray[np.float64],
        step: float,
        population: int,
        separable: bool,
    ) -> Cma: ...
    def ask(self, streams: Streams) -> NDArray[np.float32]:
        """(population, genes): a genome from each stream, within the bounds. Raises InputError for another number of streams."""
    def tell(self, fitness: NDArray[np.float64]) -> str | None:
        """Learn from the order of the fitness of the last sample, (population,): the largest is best, NaN (failed) worst.

        Returns the criterion by which going on makes no sense, if so: infinite (numbers are no longer finite), tolfun, tolfunhist,
        tolflatfitness, tolx, tolfacupx, tolconditioncov, noeffectaxis, noeffectcoord, tolstagnation or maxiter. Raises InputError
        when nothing was asked for or the number of values is another.
        """
    @property
    def mean(self) -> NDArray[np.float64]:
        """(genes,): mean of the distribution, as genes before they are brought within bounds."""
    @property
    def sigma(self) -> float:
        """The step size. The covariance matrix of the genes is sigma**2 * units * covariance * units."""
    @property
    def units(self) -> NDArray[np.float64]:
        """(genes,): unit of each gene; if separable, its standard deviation without the step size."""
    @property
    def step_path(self) -> NDArray[np.float64]:
        """(genes,): evolution path of the step size."""
    @property
    def covariance_path(self) -> NDArray[np.float64]:
        """(genes,): evolution path of the covariance matrix, in units."""
    @property
    def covariance(self) -> NDArray[np.float64] | None:
        """(genes, genes): covariance matrix in units, without the step size; None if separable."""

@final
class Sample:
    """What the candidates of a generation are made from, for servers that make them themselves and for the store."""

    @staticmethod
    def read(address: str, numbers: bytes) -> Sample:
        """A sample as the store has it. Raises InputError for what it is not."""

    @property
    def address(self) -> str:
        """JSON: distribution, seed, purpose, generation, count, mirrored."""

    @property
    def numbers(self) -> bytes:
        """(6, genes) binary64, little-endian: center, deviation, middle, reach, lower, upper."""

    @property
    def genes(self) -> int:
        """Of each genome."""

    @property
    def is_shorter(self) -> bool:
        """Whether it has fewer bytes than the genomes."""

    def __len__(self) -> int: ...
    def genomes(self, first: int, count: int) -> NDArray[np.float32]:
        """The genomes of `count` candidates from `first` on, (count, genes). Raises InputError where there are not so many."""

@final
class Search:
    """A method: it asks for whole generations and learns from what came out.

    seed, kind: address of its random numbers. Where genes are computed with, `space` is (middle, reach, lower, upper): values of
    the genes where a point is 0, how much they change where it changes by 1, and their limits. start: center of the first
    generation, instead of the middle. starts: called for the center of a new start. Raises InputError for shapes that do not fit
    and names that are not known.
    """

    @staticmethod
    def pairs(
        seed: int,
        kind: str,
        *,
        space: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]],
        start: NDArray[np.float64] | None,
        population: int,
        noise: float,
        step: float,
        learning: Sequence[float],
    ) -> Search:
        """An evolution strategy of pairs on opposite sides of a center that Adam moves.

        learning: [decay], or [rate, change] of the standard deviations.
        """

    @staticmethod
    def nes(
        seed: int,
        kind: str,
        *,
        space: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]],
        start: NDArray[np.float64] | None,
        starts: Callable[[int], NDArray[np.float64]],
        population: int,
        step: float,
        rate: float,
        separable: bool,
        restart: str,
    ) -> Search:
        """A natural evolution strategy; starts: by the generation after which it begins."""

    @staticmethod
    def cma(
        seed: int,
        kind: str,
        *,
        center: NDArray[np.float64],
        starts: Callable[[int], NDArray[np.float64]],
        reach: NDArray[np.float64],
        lower: NDArray[np.float64],
        upper: NDArray[np.float64],
        step: float,
        population: int,
        separable: bool,
        restart: str,
        budget: int,
    ) -> Search:
        """CMA-ES, with starts by their number; budget: evaluations of the whole run."""

    @staticmethod
    def swarm(
        seed: int,
        kind: str,
        *,
        first: NDArray[np.float32],
        lower: NDArray[np.float64],
        upper: NDArray[np.float64],
        inertia: float,
        pulls: tuple[float, float],
        fastest: float,
        adaptive: bool,
        perturb: bool,
    ) -> Search:
        """A swarm of particles in a box; first: (n, genes), n >= 2, where they begin."""

    @staticmethod
    def differential(
        seed: int,
        kind: str,
        *,
        first: NDArray[np.float32],
        lower: NDArray[np.float64],
        upper: NDArray[np.float64],
        base: str,
        crossover: str,
        factor: float,
        rate: float,
        mutate: float,
    ) -> Search:
        """Differential evolution in a box; first: (n, genes), n >= 4, the first members."""

    @staticmethod
    def evostick(
        seed: int,
        kind: str,
        *,
        first: NDArray[np.float32],
        elites: int,
        middle: NDArray[np.float64],
        step: NDArray[np.float64],
        lower: NDArray[np.float64],
        upper: NDArray[np.float64],
    ) -> Search:
        """EvoStick's algorithm; first: (n, genes), n >= elites >= 1; middle, step: where and how far genes are drawn."""

    @staticmethod
    def genetic(
        seed: int,
        kind: str,
        *,
        first: NDArray[np.float32],
        operators: object,
        populations: int,
        shares: tuple[int, int, int, int],
        severity: float,
        probability: float,
        partners: int,
        exchange_interval: int,
        exchange: float,
    ) -> Search:
        """A genetic algorithm, see `swarmwright.methods.nnga`.

        first: (n, genes), the first members of all populations, of which each has as many. operators: a `NodeNetwork`, or a
        representation, whose initials, mutations and matings are called. shares: members of a population that are elite, stay by
        chance, are mutated, and are children of two; those that are left are renewed.
        """

    @staticmethod
    def neat(
        seed: int,
        kind: str,
        *,
        first: NDArray[np.float32],
        operators: GrowingNetwork,
        compatibility: tuple[float, float],
        threshold: float,
        species: int | None,
        survival: float,
        stagnation: int,
        mutate_only: float,
        interspecies: float,
        weights: tuple[float, float, float],
    ) -> Search:
        """NEAT; compatibility: coefficients of disjoint genes and weights. weights: probability of their mutation, then of each, and
        its severity.

        State: `species`, that of each genome told last, and `threshold`.
        """

    def ask(self) -> NDArray[np.float32]:
        """(n, genes): genomes to be evaluated; the same ones until their fitness is told."""

    def tell(self, fitness: NDArray[np.float64]) -> None:
        """Learn from (n,) fitness, NaN where an evaluation failed. Raises InputError when it was not asked for."""

    def retell(self, genomes: NDArray[np.float32] | Sample, fitness: NDArray[np.float64]) -> bool:
        """Ask, and tell the fitness of these genomes if they are those asked for, to the bit; return whether they are.

        Of a sample no genomes are made where the search learns without them.
        """

    def rescore(self, fitness: NDArray[np.float64]) -> None:
        """Take new fitness of the members."""

    @property
    def members(self) -> NDArray[np.float32] | None:
        """Genomes, (k, genes), of members that stay; None where none do."""

    @property
    def fitness(self) -> NDArray[np.float64] | None:
        """Their fitness, (k,)."""

    @property
    def sample(self) -> Sample | None:
        """What all genomes asked for last were made from, until their fitness is told.

        None where that is not all of a normal distribution with a deviation for each gene.
        """
    @property
    def stopped(self) -> list[str]:
        """By which criterion each start has ended, where it says that."""

    def state(self, name: str) -> NDArray[np.float64]:
        """A part of the state, (n,).

        Of all that draw from a normal distribution, center (as genes), directions, population and deviation. Of pairs, momentum.
        Of nes, widest. Of cma, starts, sigma, mean and step_path. Of swarms, inertia and pulls. Raises InputError for others.
        """

@final
class Producer:
    """Evolves in a thread of its own, generation after generation, up to 64 of them and 32 MiB ahead.

    search: goes on here and nowhere else. evaluator: a pool is in use until `close`. architecture: of the controllers. seed: of the
    first episode in the first generation. growth: by how much it grows from one generation to the next. aggregate, level: how the
    episodes of a candidate become its fitness, see `aggregates`. generations: so many at most. evaluations: how many the run may
    have, and has had; a generation that does not fit is not evaluated, unless it is the first. target: the first generation that
    reaches it is the last. run, generation: for those who watch a pool: name of the run, number of the first generation. samples:
    whether samples are handed over instead of genomes. Raises InputError when search and evaluator do not fit together.
    """

    def __new__(
        cls,
        search: Search,
        evaluator: Evaluator | Pool,
        architecture: dict[str, Any],
        *,
        seed: int,
        growth: int,
        episodes: int,
        aggregate: str,
        level: float,
        generations: int,
        evaluations: tuple[int, int] | None = None,
        target: float | None = None,
        run: str = "",
        generation: int = 0,
        samples: bool = True,
    ) -> Producer: ...
    def next(
        self, on_progress: Callable[[int, int, str], None]
    ) -> (
        tuple[
            NDArray[np.float32] | Sample,
            NDArray[np.float64],
            NDArray[np.float64],
            NDArray[np.float64],
            NDArray[np.float64],
            tuple[float, float, float, float, float],
            tuple[int, int],
            Digests,
            list[AttemptFields],
            list[WarningFields],
        ]
        | None
    ):
        """Wait for the next generation; None when there is no further one.

        Genomes (n, genes), or what they are made from where that is shorter, results (n, episodes), metrics (n, episodes, metrics), fitness (n,), that of the method's population
        (k,), the figures of the latter, see `figures`, the outcome of the fitness, see `outcome`, the digests of all, and attempts
        and warnings as from `Pool.evaluate`. on_progress: called ten times a second while it takes longer. Raises what has kept
        the thread from going on.
        """

    def is_ready(self) -> bool:
        """Whether `next` returns without waiting."""

    def expect(self, generations: int) -> None:
        """Say, for those who watch a pool, how many generations the run is expected to have."""

    def close(self) -> None:
        """End the thread; what has not been taken is lost."""

@final
class Digests:
    """SHA-256 of the columns of a generation, little-endian; begun in another thread, with one NaN and one zero in `fitness`.

    fitness: (n,). episodes: (n, episodes). metrics: (n, episodes, metrics). genomes: (n, genes), or what they are made from.
    """

    def __new__(
        cls,
        fitness: NDArray[np.float64],
        episodes: NDArray[np.float64],
        metrics: NDArray[np.float64],
        genomes: NDArray[np.float32] | Sample,
    ) -> Digests: ...
    def columns(self) -> list[bytes]:
        """Wait for them: of fitness, episodes, metrics and genomes."""

def aggregates(results: NDArray[np.float64], aggregate: str, level: float) -> NDArray[np.float64]:
    """Return (n,): what each row of (n, episodes) results comes to, the same bits on every machine.

    aggregate: mean, sum, median, worst, quantile or cvar, of which the last two look at the worst `level` of the results. NaN
    where a result or what it comes to is not finite.
    """

def figures(fitness: NDArray[np.float64]) -> tuple[float, float, float, float, float]:
    """Return best, mean, lower quartile, median and upper quartile of (n,) fitness; what is not finite is left out."""

def outcome(fitness: NDArray[np.float64]) -> tuple[int, int]:
    """Return which of (n,) candidates is best, of equals the first, and how many failed (NaN)."""

def centered_ranks(fitness: NDArray[np.float64]) -> NDArray[np.float64]:
    """Ranks from -0.5 (worst) to 0.5 (best), (n,), n >= 2; equal values share the mean, failed ones (NaN) are worst."""

def utilities(fitness: NDArray[np.float64]) -> NDArray[np.float64]:
    """Weights of natural evolution strategies, (n,), n >= 2, with the sum 0 but for rounding.

    The k-th best has max(0, ln(n / 2 + 1) - ln(k)), scaled to the sum 1, less 1 / n; equal values share the mean, failed ones
    (NaN) are worst. Source: Wierstra et al., "Natural evolution strategies", JMLR 15, 2014, section 3.1.
    """

def exp(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the exponential function of each value, (n,), the same bits on every machine."""

def log(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the natural logarithm of each value, (n,), the same bits on every machine."""

def distances(
    genomes: NDArray[np.float32], ones: NDArray[np.int64], others: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Sums of absolute differences, added in the genome's order in binary64.

    genomes: (m, genes). ones: (n,), others: (n, k), indices of genomes. Returns (n, k). Raises InputError for an index out
    of range.
    """

def levels() -> list[str]:
    """How this processor can evaluate, the fastest last: scalar, then instruction sets (portable, avx2, avx512)."""

def check_instructions() -> None:
    """Raise InputError when SWARMWRIGHT_INSTRUCTIONS names no instruction set of this processor."""

@final
class Evaluator:
    """Evaluates controllers of one architecture in this process; arguments as of the function `evaluate`.

    `level` is the set of instructions here, and in `scores` the share of the results that an aggregate looks at.
    """

    def __new__(
        cls,
        title: str,
        parameters: dict[str, Any],
        architecture: dict[str, Any],
        *,
        metrics: Sequence[str] | None = None,
        level: str = "auto",
        threads: int = 0,
    ) -> Evaluator: ...
    def evaluate(
        self,
        genomes: NDArray[np.float32],
        seeds: Sequence[int],
        on_progress: Callable[[int, int, str], None] | None = None,
        meanwhile: Callable[[], None] | None = None,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Evaluate as the function does; `meanwhile` is called once, while the engine is at work."""

    def scores(
        self,
        genomes: NDArray[np.float32],
        seeds: Sequence[int],
        aggregate: str,
        level: float,
        on_progress: Callable[[int, int, str], None] | None = None,
    ) -> NDArray[np.float64]:
        """Return (candidates,): what each candidate's episodes come to; aggregate and level as of `aggregates`."""

def evaluate(
    title: str,
    parameters: dict[str, Any],
    architecture: dict[str, Any],
    genomes: NDArray[np.float32],
    seeds: Sequence[int],
    on_progress: Callable[[int, int, str], None] | None = None,
    *,
    metrics: Sequence[str] | None = None,
    level: str = "auto",
    threads: int = 0,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Evaluate in this process: fitness (candidates, episodes) and the named metrics (candidates, episodes, metrics).

    The parameter `seed` of episode e is seeds[e]. metrics: names; None for none.
    architecture: controller specification, its weights ignored. genomes: (candidates, weights), finite.
    level: the set of instructions, "auto" or one of `levels()`; threads: 0 for one per processor. The results depend on neither.
    on_progress(done, total, "") is called about ten times a second and at the end; KeyboardInterrupt is raised promptly.
    Raises InputError for an unknown title, parameters that the simulation refuses, controllers that do not fit it, an unknown metric.
    """

@final
class Broker:
    """The embedded MQTT broker, running in threads of this process until `stop`."""

    def __new__(
        cls,
        host: str = "127.0.0.1",
        port: int | None = ...,
        *,
        socket: str | None = None,
        socket_mode: int = 0o600,
        websocket_port: int | None = None,
        users: str | None = None,
        accounts: Sequence[tuple[str, str]] | None = None,
        access: str | None = None,
        certificate: str | None = None,
        key: str | None = None,
        client_ca: str | None = None,
        origins: Sequence[str] | None = None,
        rate: int | None = None,
        memory: int | None = None,
    ) -> Broker:
        """port 0, the default: any free one; None: no MQTT over TCP. socket: path of a Unix socket to listen on; who may write to its file,
        by socket_mode, may connect. users, access: paths of a password file and of an access file, Mosquitto's formats.

        accounts: users with random passwords, instead of `users`; without both, every client is admitted.
        client_ca: path of a PEM file; clients need a certificate that an authority in it has signed, and where `users` is
        given an account.
        origins: of web pages that may connect by websocket, as "https://dashboard.example.org"; "*" for all. Pages of the
        host that they connect to may in any case.
        rate: packets a second that are taken of one client; None for the default.
        memory: bytes that all clients together make the broker keep at most; None for the default.

        Raises EngineError when the address or the path cannot be bound or a file cannot be used.
        """
    @property
    def url(self) -> str: ...
    @property
    def socket_url(self) -> str | None: ...
    @property
    def port(self) -> int: ...
    def publish(self, user: str, password: str) -> tuple[list[Path], str | None]:
        """Have all programs of this user on this machine use an account of this broker, until it stops.

        Returns the files that say so, one for each address; and why they could not be written, in which case only this
        process uses it.
        """
    def reload(self) -> None:
        """Read users, access, certificate, key and client_ca again; accounts that are gone or have another password are disconnected.

        Raises EngineError when one of the files cannot be used; then everything stays as it was.
        """
    def stop(self) -> None: ...

def log_to(path: str | None, level: str = "info", most: int | None = None) -> None:
    """Append what the engine logs, the embedded broker's refusals above all, to a file as JSON lines; None: standard error.

    level: error, warning, info, debug or trace. most: bytes; before the file grows beyond them it is moved to PATH.1, and what
    was there is deleted. A file that another program moved away, such as logrotate, is created anew. Raises OSError when the file cannot be written, InputError for another level.
    """

def log_line(line: str) -> None:
    """Write a line to where the engine's lines go, see `log_to`; without it nowhere."""

def evaluate_host(
    simulation: AnyHost,
    parameters: dict[str, Any],
    architecture: dict[str, Any],
    genomes: NDArray[np.float32],
    seeds: Sequence[int],
    on_progress: Callable[[int, int, str], None] | None = None,
    *,
    metrics: Sequence[str] | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.float64], list[tuple[int, int, str, str | None]]]:
    """Evaluate a simulation in Python in this process, one episode after the other; arguments as in `evaluate`.

    Returns fitness and metrics as `evaluate`, NaN where the simulation's code failed, and those evaluations:
    (candidate, episode, reason, traceback or None).
    Raises InputError for parameters that the simulation refuses, controllers that do not fit it.
    """

def account(broker: str) -> tuple[str | None, str | None]:
    """User name and password with which this process connects to a broker: of one that this user runs on this machine, else
    the environment's.

    Raises InputError when the URL or a variable cannot be used.
    """

def hash_password(password: str) -> str:
    """argon2id hash with a new salt, for a password file of the embedded broker."""

def hash_for_mosquitto(password: str, iterations: int) -> str:
    """PBKDF2-HMAC-SHA-512 hash with a new salt ($7$), for a password file of Mosquitto 2 or the embedded broker.

    iterations: 1 to 10,000,000. Raises EngineError for more.
    """

def certificates(hosts: Sequence[str], days: int) -> tuple[str, str, str, str]:
    """PEM texts of an authority for ten years or more, its key, a certificate for the hosts (names or addresses) for so many days, its key.

    Raises EngineError for a host that cannot stand in a certificate.
    """

def serve(
    simulation: str | AnyHost,
    broker: str,
    *,
    id: int,
    prefix: str = "",
    step_timeout: float | None = None,
    display: bool = True,
    alone: bool = False,
    on_event: Callable[[ServerEvent], None] | None = None,
    progress: str | None = None,
    modules: ServedModules | None = None,
) -> None:
    """Offer a simulation, built in (its title) or in Python, on the broker until interrupted (KeyboardInterrupt) or the process ends.

    alone: no other server can have this id; without, it listens 0.1 s for one before it begins. progress: a file that is there,
    in which six little-endian uint64 say what is computed of offloaded work: request, first candidate in it, candidates (0: none),
    episode in it (2**64 - 1: all), evaluations that have ended, signs of life (one a step at most each 20 ms).

    step_timeout: seconds that a step may wait for actuators; None for the default. modules: behaviours and conditions in Python, of
    which the server evaluates machines. Raises NoBrokerError, EngineError: refused, id taken.
    """

def servers(broker: str, *, prefix: str = "", wait: float = 1.0) -> list[Presence]:
    """What the servers on a broker announce, sorted by id: what is retained, and what comes within `wait` seconds.

    Raises EngineError (no broker, refused) or InputError.
    """

def forget(broker: str, servers: Sequence[int], *, prefix: str = "", wait: float = 1.0) -> list[int]:
    """Remove what a broker retains of servers; those that it confirms within `wait` seconds.

    Raises EngineError (no broker, refused, denied) or InputError.
    """

@final
class Supervision:
    """What a pool and the supervisor of its servers report to each other; usable from any thread."""

    def ended(
        self,
        server: int,
        pid: int,
        reason: str,
        *,
        stack: str | None = None,
        outside: bool = False,
        at: tuple[int, int, int, int | None] | None = None,
    ) -> None:
        """A process has ended; to be told before another one is started under its id.

        reason: the same text for the same cause. outside: it was ended by a user or the system, so what it computed is not blamed at first.
        at: what it computed: request, first candidate in it, candidates, and the episode in it, None for all.
        """
    def is_alive(self, server: int) -> None:
        """A server of `take_overdue` goes on computing."""
    def starting(self, servers: int) -> None:
        """So many servers are being started: meanwhile the pool does not give up for want of servers."""
    def take_overdue(self) -> list[int]:
        """Servers that have not answered in time, since the last call; say of each that it is alive, or that it has ended."""
    def place(self, request: int) -> tuple[int, int, int | None, str | None] | None:
        """First candidate, first episode, generation and purpose (as `Pool.about` was told) of a request to a watched server."""

@final
class Watcher:
    """Hears what servers and optimization tools on a broker say of themselves; publishes nothing."""

    def __new__(
        cls, broker: str, *, prefix: str = "", account: tuple[str, str, str] | None = None
    ) -> Watcher:
        """Raises EngineError (no broker, refused) or InputError. account: as of `Pool`."""
    def poll(self, seconds: float) -> list[News]:
        """What came within so many seconds; returns as soon as there is something. KeyboardInterrupt is raised promptly."""
    def close(self) -> None:
        """Disconnect."""

@final
class Pool:
    """The optimization tool's side: finds servers, runs episodes on them, returns results in the order of the candidates."""

    def __new__(
        cls,
        broker: str,
        *,
        simulation: str,
        parameters: dict[str, Any],
        requirements: Requirements,
        sensors: int | None = None,
        actuators: int | None = None,
        prefix: str = "",
        tool: str = "",
        mode: str = "auto",
        metrics: Sequence[str] | None = None,
        visual: bool = False,
        timeouts: dict[str, Any] | None = None,
        faults: dict[str, Any] | None = None,
        largest: int | None = None,
        alone: bool = False,
        controller: dict[str, Any] | None = None,
        account: tuple[str, str, str] | None = None,
    ) -> Pool:
        """Connects and discovers. Raises NoBrokerError, EngineError (refused) or InputError.

        mode: "auto" (each server in the fastest way that it offers), "stepwise", "batched" or "offloaded". largest: most
        evaluations in one request, None for no limit. metrics: names of what is needed beside the fitness; a server that
        does not announce one of them is not used. visual: servers show their runs, which are stepwise then. alone: all servers on
        the broker are this process's own; without, a moment is waited in case two of them have one id. timeouts, faults: what
        they lack has the default of `TIMEOUTS`, `FAULTS`. controller: specification of the controllers, if it is known before they
        come: servers that cannot evaluate them are not used. account: user name, password and the PEM file of the broker's
        authority; None: the credentials of the environment.
        """
    def wait_for_server(self, *, sizes: bool = True) -> tuple[int, int]:
        """Block until a fitting server is there; (sensors, actuators). Raises EngineError naming what was required and what was found, NoServerError where that is nothing."""
    def evaluate(
        self,
        architecture: dict[str, Any],
        genomes: NDArray[np.float32],
        seeds: Sequence[int],
        on_progress: Callable[[int, int, str], None] | None = None,
        meanwhile: Callable[[], None] | None = None,
        sample: Sample | None = None,
        only: Sequence[tuple[int, int, int | None]] | None = None,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], list[AttemptFields], list[WarningFields]]:
        """Every controller in an episode of every seed; `architecture` and `genomes` as in the function `evaluate`.

        sample: what all genomes were made from; servers that can make them get it instead. Raises InputError if it has
        another number of candidates or genes. only: (candidate, episode, server that evaluated it before or None) of single
        evaluations to repeat, each on another server where there is one; results of all others are NaN.

        Returns fitness (candidates, episodes) and metrics (candidates, episodes, metrics) float64, NaN where the
        evaluation failed (a metric that is missing or not finite is a failure), attempts at blocks of evaluations, and warnings.
        on_progress(done, total, waiting_for) is called about ten times a second, meanwhile once, when servers
        have got their first work; KeyboardInterrupt is raised promptly.
        Raises EngineError: no server for too long, or every server refuses the work.
        """
    def watch(self, servers: Sequence[int]) -> Supervision:
        """The processes of these servers are the caller's own: when one is lost or late, the pool waits for what `Supervision` is told."""
    def listen(self, on_report: Callable[[Report], object], *, warnings_only: bool = False) -> None:
        """Call `on_report` with what happens, as it happens. What it raises is dropped.

        warnings_only: "warning", "broker_lost" and "broker_back" alone.
        """
    def about(
        self,
        run: str | None = None,
        generation: int | None = None,
        generations: int | None = None,
        evaluations: tuple[int, int] | None = None,
        purpose: str | None = None,
    ) -> None:
        """Say what the evaluations that follow are for: those who watch the broker are told.

        purpose: names work that belongs to no generation, such as `post-evaluation`, in the output of servers.
        """
    def counts(self) -> Counts:
        """Incidents so far."""
    def determinism(self) -> list[tuple[int, str | None, float | None]]:
        """What each server declares: (server, determinism, tolerance); None where it declares nothing."""
    def announced_sides(self) -> list[tuple[int, list[SideFields]]]:
        """Sides of a match that each server with this simulation announces, also if it does not fit.

        (server, sides), by server; empty lists for those that announce none.
        """
    def announced_metrics(self) -> list[str]:
        """Metrics that servers with this simulation announce, those that do not fit too; sorted."""
    def stream(
        self,
        architecture: dict[str, Any],
        genomes: NDArray[np.float32],
        seeds: Sequence[int],
        feed: Callable[
            [list[int], NDArray[np.float64], NDArray[np.float64], list[AttemptFields], list[WarningFields]],
            NDArray[np.float32] | None,
        ],
        on_progress: Callable[[int, int, str], None] | None = None,
        *,
        revised: bool = False,
    ) -> None:
        """Evaluate candidates as they come, until all that were given have been evaluated.

        feed(candidates, fitness, metrics, attempts, warnings) is called with the numbers, from 0, of k candidates that have just been
        evaluated in every episode, their fitness (k, episodes) and metrics (k, episodes, metrics), attempts and warnings
        as of `evaluate`. It returns the genomes of further candidates, (n, weights), n may be 0, or None to stop. Otherwise as
        `evaluate`; on_progress's total grows.

        revised: candidates with results of a server that turns out to be wrong are evaluated and fed again.
        """
    def take_back(self) -> None:
        """End the producer that has the pool, if there is one; generations that wait are lost."""

    def close(self) -> None:
        """End the runs that are left, free the servers, disconnect."""

"""Checks of representations, and of behaviours and conditions in Python."""

import copy
import json
import pickle
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright import _engine
from swarmwright.common.arrays import Genome, Genomes
from swarmwright.common.random_numbers import Stream, Streams
from swarmwright.controllers import REPRESENTATIONS, Representation
from swarmwright.controllers.controller import Controller
from swarmwright.controllers.modules import Behaviour, Condition, RandomNumbers, Senses, grammar
from swarmwright.controllers.modules.grammar import PYTHON_KIND, count_weights
from swarmwright.controllers.modules.machine import call_module, random_words
from swarmwright.controllers.modules.registered import implementation, module
from swarmwright.testing._common import SHAPES, check_options, representation

_ROBOTS, _STEPS = 40, 30


def check_behaviour(name: str) -> None:
    """Check a behaviour: a registered one, or `path/to/file.py:Class`.

    It acts for forty robots in thirty steps: with a new object, with the same object again, with another one,
    and for some robots alone; all must agree to the bit. It must not change its arguments or its object.

    Raises AssertionError, InputError or RunError with the problem.
    """
    _check("behaviour", name)


def check_condition(name: str) -> None:
    """Check a condition; see `check_behaviour`."""
    _check("condition", name)


def _check(sort: str, name: str) -> None:
    declared = module(sort, name)
    sensors = _sensors()
    parameters = _parameters(declared)
    instance = _create(sort, name)
    before = _contents(instance)
    together = _run(name, instance, sensors, parameters)
    for other in (instance, _create(sort, name)):
        repeated = _run(name, other, sensors, parameters)
        assert together.tobytes() == repeated.tobytes(), (
            f"{name}: the same senses, parameters and random numbers gave different results: keep what is to "
            "be remembered in `state` alone, and take random numbers from `random`"
        )
    after = _contents(instance)
    changed = sorted(key for key in before | after if before.get(key) != after.get(key))
    assert not changed, (
        f"{name}: self.{changed[0]} was set or changed: keep what is to be remembered in `state` alone, "
        "since all robots of all episodes share the object, and set constants in __init__"
    )
    for robot in range(0, _ROBOTS, 7):
        row = slice(robot, robot + 1)
        subset = {key: value[row] for key, value in parameters.items()}
        alone = _run(name, instance, sensors[:, row], subset)
        assert alone[:, 0].tobytes() == together[:, robot].tobytes(), (
            f"{name}: what a robot does depends on robots in other rows"
        )


def _create(sort: str, name: str) -> Behaviour | Condition:
    """Create an object of the module."""
    declared = module(sort, name)
    kind = (
        implementation("behaviour", declared)
        if sort == "behaviour"
        else implementation("condition", declared)
    )
    return kind()


def _contents(instance: Behaviour | Condition) -> dict[str, Any]:
    """Return the attributes of an object in a comparable form."""
    contents: dict[str, Any] = {}
    for key, value in vars(instance).items():
        try:
            contents[key] = pickle.dumps(copy.deepcopy(value))
        except Exception:  # noqa: BLE001 - any object may refuse it; that it is another one is seen then
            contents[key] = id(value)
    return contents


def _run(
    name: str,
    instance: Behaviour | Condition,
    sensors: NDArray[np.float32],
    parameters: dict[str, NDArray[np.float32]],
) -> NDArray[np.float32]:
    """Return the outputs of an object of the module, (steps, robots, ..)."""
    robots = sensors.shape[1]
    acts = isinstance(instance, Behaviour)
    method = instance.act if isinstance(instance, Behaviour) else instance.probability
    shape: tuple[int, ...] = (robots, 2) if acts else (robots,)
    state = np.zeros((robots, instance.state), dtype=np.float32)
    outputs = []
    for values in sensors:
        bits = (values[:, 8] * 16777216).astype(np.uint32)
        random = RandomNumbers(bits, 0, random_words(bits))
        before, copied = values.tobytes(), {key: value.copy() for key, value in parameters.items()}
        outputs.append(
            call_module(method, name, Senses.from_rows(values), copied, state, random, shape=shape)
        )
        assert values.tobytes() == before, f"{name}: the senses must not be changed"
        same = all(copied[key].tobytes() == parameters[key].tobytes() for key in parameters)
        assert same, f"{name}: parameters must not be changed"
        assert np.isfinite(state).all(), f"{name}: the state holds a number that is not finite"
    return np.array(outputs)


def _sensors() -> NDArray[np.float32]:
    """Return plausible sensor values, (steps, robots, 9)."""
    stream = Stream(1, "senses")
    sensors = stream.unit(_STEPS * _ROBOTS * grammar.SENSORS).reshape(_STEPS, _ROBOTS, grammar.SENSORS)
    sensors[..., [0, 1, 2, 3, 6, 7]] = 2 * sensors[..., [0, 1, 2, 3, 6, 7]] - 1
    sensors[..., 4] = np.floor(3 * sensors[..., 4]) / 2
    sensors[..., 5] = np.floor(8 * sensors[..., 5])
    return sensors.astype(np.float32)


def _parameters(declared: grammar.Module) -> dict[str, NDArray[np.float32]]:
    stream = Stream(1, "parameters")
    arrays = {}
    for name, (low, high, whole) in declared.parameters.items():
        values = low + (high - low) * stream.unit(_ROBOTS)
        arrays[name] = (np.round(values) if whole else values).astype(np.float32)
    return arrays


def check_representation(kind: str, options: Mapping[str, Any] | None = None) -> None:
    """Check a registered representation with several numbers of sensors and actuators.

    Genes may be numbers or choices, bounded or not.

    Args:
        kind: as in experiment files.
        options: as in experiment files, without `kind`; by default none, which must suffice.
    """
    check_options(REPRESENTATIONS, kind, options)
    shape = REPRESENTATIONS.get(kind).shape
    for sensors, actuators in SHAPES if shape is None else [shape]:
        subject = representation(kind, sensors=sensors, actuators=actuators, options=options)
        _check_limits(subject)
        _check_weights(subject)
        _check_initial(subject)
        _check_specification(subject)
        _check_mutation(subject)
        _check_crossover(subject)
        _check_distance(subject)
        _check_many(subject)
        _check_perturbations(subject)


def _genomes(subject: Representation, count: int) -> list[Genome]:
    return [subject.initial(Stream(1, "check", 0, index)) for index in range(count)]


def _is_genome(subject: Representation, genome: Genome, source: str) -> None:
    assert genome.dtype == np.float32, f"{source} returns {genome.dtype}, not float32"
    assert genome.shape == (subject.genome_size,), f"{source} returns the shape {genome.shape}"
    assert np.isfinite(genome).all(), f"{source} returns numbers that are not finite"
    lower, upper = subject.bounds
    assert ((lower <= genome) & (genome <= upper)).all(), f"{source} returns genes outside of bounds"


def _check_limits(subject: Representation) -> None:
    assert isinstance(subject.continuous, bool)
    for name in ("bounds", "initial_range"):
        lower, upper = getattr(subject, name)
        for limit in (lower, upper):
            assert limit.dtype == np.float64, f"{name} holds {limit.dtype}, not float64"
            assert limit.shape == (subject.genome_size,), f"{name} holds the shape {limit.shape}"
        assert (lower < upper).all(), f"{name}: the lower limit must be smaller than the upper one"
    first, last = subject.initial_range
    lowest, highest = subject.bounds
    for limit in (lowest, highest):
        assert (limit.astype(np.float32) == limit).all(), "bounds must be float32 numbers"
    assert (np.isfinite(first) & np.isfinite(last)).all(), "initial_range must be finite"
    assert ((lowest <= first) & (last <= highest)).all(), "initial_range must be within bounds"
    # Genes are rounded to float32, the range is not.
    edge = 1e-6 * (last - first)
    for genome in _genomes(subject, 20):
        assert ((first - edge <= genome) & (genome <= last + edge)).all(), "initial leaves initial_range"


def _check_weights(subject: Representation) -> None:
    lower, upper = subject.bounds
    first, last = subject.initial_range
    inside = [(1 - share) * first + share * last for share in (0.25, 0.5)]
    # Where there are bounds, genomes may lie on them.
    edges = [np.where(np.isfinite(limit), limit, 0.0) for limit in (lower, upper)]
    genomes = np.stack([*_genomes(subject, 3), *inside, *edges]).astype(np.float32)
    before = genomes.tobytes()
    rows = subject.weights(genomes)
    assert genomes.tobytes() == before, "weights must not change its argument"
    assert rows.dtype == np.float32, f"weights returns {rows.dtype}, not float32"
    architecture = dict(subject.architecture())
    in_python = architecture["kind"] == PYTHON_KIND
    needed = count_weights(architecture) if in_python else _engine.genome_size(architecture)
    assert rows.shape == (len(genomes), needed), (
        f"weights returns the shape {rows.shape}; controllers of this architecture have {needed} weights"
    )
    assert subject.weights(genomes[:0]).shape == (0, needed), "weights of no genomes must be no rows"
    assert np.isfinite(rows).all(), "weights returns numbers that are not finite"
    for genome, row in zip(genomes, rows, strict=True):
        alone = subject.weights(genome[np.newaxis])[0]
        assert alone.tobytes() == row.tobytes(), "the weights of a genome must not depend on its neighbours"


def _check_initial(subject: Representation) -> None:
    first, second = _genomes(subject, 2)
    _is_genome(subject, first, "initial")
    repeated = subject.initial(Stream(1, "check", 0, 0))
    assert first.tobytes() == repeated.tobytes(), "initial must depend on the stream alone"
    assert first.tobytes() != second.tobytes(), "initial must differ between streams"


def _check_specification(subject: Representation) -> None:
    genome = _genomes(subject, 1)[0]
    specification = subject.specification(genome)
    text = json.dumps(specification, allow_nan=False)
    held = np.array(specification["weights"], dtype=np.float32)
    weights = subject.weights(genome[np.newaxis])[0]
    assert held.tobytes() == weights.tobytes(), "specification must hold the weights of the genome"
    controller = Controller(text)
    if not subject.steers:
        assert controller.sensors == 0, "steers is False, but the controllers take sensors"
        return
    assert (controller.sensors, controller.actuators) == (subject.sensors, subject.actuators)
    sensors = np.linspace(-1, 1, subject.sensors, dtype=np.float32)
    actuators = controller(sensors)
    assert actuators.shape == (subject.actuators,)
    assert (np.abs(actuators) <= 1).all(), "actuators must be in -1..1"


def _check_mutation(subject: Representation) -> None:
    genome = _genomes(subject, 1)[0]
    before = genome.tobytes()

    def mutant(severity: float, probability: float, index: int = 0) -> Genome:
        stream = Stream(2, "check", 0, index)
        return subject.mutate(genome, stream, severity=severity, probability=probability)

    # Of choices few may change at a time.
    changed = [mutant(0.3, 1.0, index) for index in range(30)]
    for variant in changed:
        _is_genome(subject, variant, "mutate")
    assert genome.tobytes() == before, "mutate must not change its argument"
    assert changed[0].tobytes() == mutant(0.3, 1.0).tobytes(), "mutate must depend on the stream alone"
    assert {variant.tobytes() for variant in changed} - {before}, (
        "mutate with probability 1 must change something"
    )
    _is_genome(subject, mutant(100.0, 1.0), "mutate")
    assert mutant(0.3, 0.0).tobytes() == before, "mutate with probability 0 must change nothing"


def _check_crossover(subject: Representation) -> None:
    mother, father = _genomes(subject, 2)
    before = mother.tobytes(), father.tobytes()
    children = [subject.crossover(mother, father, Stream(3, "check", 0, index)) for index in range(50)]
    for child in children:
        _is_genome(subject, child, "crossover")
    assert (mother.tobytes(), father.tobytes()) == before, "crossover must not change its arguments"
    mixed = [child for child in children if child.tobytes() not in before]
    # Crossover cannot mix a single gene that is a choice.
    assert mixed or subject.genome_size == 1, "crossover never returned anything but a parent"
    same = subject.crossover(mother, mother, Stream(3, "check"))
    assert same.tobytes() == before[0], "crossover of a genome with itself must be that genome"


def _check_distance(subject: Representation) -> None:
    first, second = _genomes(subject, 2)
    assert subject.distance(first, first) == 0, "the distance of a genome to itself must be 0"
    assert subject.distance(first, second) > 0, "the distance of different genomes must be positive"
    assert subject.distance(first, second) == subject.distance(second, first), (
        "the distance must be symmetric"
    )


def _check_many(subject: Representation) -> None:
    """Check that operators on many genomes give the same bits as those on a single genome."""
    count = 7

    def streams() -> Streams:
        return Streams(4, "check", 1, range(3, 3 + count))

    def stream(index: int) -> Stream:
        return Stream(4, "check", 1, 3 + index)

    def check_equal(result: Genomes, expected: list[Genome], operation: str) -> None:
        assert result.dtype == np.float32, f"{operation} returns {result.dtype}, not float32"
        assert result.shape == (len(expected), subject.genome_size), (
            f"{operation} returns the shape {result.shape}"
        )
        assert result.tobytes() == b"".join(variant.tobytes() for variant in expected), (
            f"{operation} must give the same bits as for one genome after the other"
        )

    genomes = subject.initials(streams())
    check_equal(genomes, [subject.initial(stream(index)) for index in range(count)], "initials")
    others = np.ascontiguousarray(genomes[::-1])
    options = {"severity": 0.3, "probability": 0.5}
    mutants = [subject.mutate(genome, stream(index), **options) for index, genome in enumerate(genomes)]
    check_equal(subject.mutations(genomes, streams(), **options), mutants, "mutations")
    pairs = enumerate(zip(genomes, others, strict=True))
    children = [subject.crossover(mother, father, stream(index)) for index, (mother, father) in pairs]
    check_equal(subject.crossovers(genomes, others, streams()), children, "crossovers")

    used = streams()
    used.integers(5, 1)
    later = []
    for index, genome in enumerate(genomes):
        other = stream(index)
        other.integer(5)
        later.append(subject.mutate(genome, other, **options))
    check_equal(
        subject.mutations(genomes, used, **options), later, "mutations with streams drawn from before"
    )

    ones, rows = np.array([2, 0]), np.array([[0, 1, 2, 6, 5], [3, 3, 4, 0, 1]])
    distances = subject.distances_among(genomes, ones, rows)
    for index, row, measured in zip(ones, rows, distances, strict=True):
        expected = [subject.distance(genomes[index], genomes[partner]) for partner in row]
        assert measured.tolist() == expected, "distances_among must be those of two genomes each"
    _check_matings(subject, genomes)
    assert subject.initials(Streams(1, "check", 0, [])).shape == (0, subject.genome_size)


def _check_perturbations(subject: Representation) -> None:
    """Check the perturbations of iterated racing, wide at first and then narrower."""
    parent = _genomes(subject, 1)[0]
    parents = np.repeat(parent[np.newaxis], 30, axis=0)

    def around(spread: float, fresh: float, first: int = 0) -> Genomes:
        drawn = Streams(5, "check", 1, range(first, 30))
        count = len(drawn)
        strengths = {"spread": np.full(count, spread), "fresh": np.full(count, fresh)}
        return subject.perturbations(parents[first:], drawn, **strengths)

    wide = around(1.0, 1.0)
    assert wide.shape == parents.shape, f"perturbations returns the shape {wide.shape}"
    for genome in wide:
        _is_genome(subject, genome, "perturbations")
    assert (parents == parent).all(), "perturbations must not change its argument"
    assert {genome.tobytes() for genome in wide} - {parent.tobytes()}, "perturbations must change something"
    assert around(1.0, 1.0, 20).tobytes() == wide[20:].tobytes(), "each must depend on its stream alone"
    narrow = around(0.01, 0.01)
    wide_sum, narrow_sum = (subject.distances(parent, rows).sum() for rows in (wide, narrow))
    assert narrow_sum < wide_sum, "perturbations with a small spread must be nearer to their parents"
    rows = subject.likeness(np.stack([parent, parent, *wide]))
    assert rows.dtype == np.float64, f"likeness returns {rows.dtype}, not float64"
    assert rows.shape[0] == 2 + len(wide), f"likeness returns the shape {rows.shape}"
    assert np.isfinite(rows).all(), "likeness returns numbers that are not finite"
    assert (rows[0] == rows[1]).all(), "likeness of equal genomes must be equal"
    assert len(np.unique(rows, axis=0)) > 1, "likeness must tell genomes apart"


def _check_matings(subject: Representation, genomes: Genomes) -> None:
    """Check that the father is the most different partner, the first of several."""
    mothers, partners = np.array([2, 0, 1]), np.array([[1, 2, 6, 5], [3, 3, 4, 1], [1, 1, 1, 1]])
    children = subject.matings(genomes, mothers, partners, Streams(4, "check", 1, range(3)))
    assert children.dtype == np.float32, f"matings returns {children.dtype}, not float32"
    for index, (mother, row) in enumerate(zip(mothers, partners, strict=True)):
        father = max(row, key=lambda other: subject.distance(genomes[mother], genomes[other]))
        child = subject.crossover(genomes[mother], genomes[father], Stream(4, "check", 1, index))
        assert children[index].tobytes() == child.tobytes(), (
            "matings must give the bits of crossover with the most different partner"
        )

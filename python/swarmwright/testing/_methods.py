"""Checks of methods."""

import random
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import numpy as np

from swarmwright.common.errors import InputError
from swarmwright.common.typing import Fitness, Genomes
from swarmwright.controllers import REPRESENTATIONS, Representation
from swarmwright.methods import METHODS, Method
from swarmwright.testing._common import check_options, representation, synthetic_metrics, without_options
from swarmwright.testing._replay import check_replay
from swarmwright.testing._samples import BoundedGenes, Choices
from swarmwright.testing._steady import check_steady_state

_GENERATIONS = 6

Judge = Callable[[Genomes], Fitness]


def check_method(kind: str) -> None:
    """Check a registered method with its default options, but few generations.

    It is tried with every registered representation, with genes that have bounds and with genes that are
    choices: it evolves them or refuses them by `unsuitable`. Then with fitness of every sign and size, equal
    fitness, and evaluations that fail; from where it stopped, in a new process; and in steady state, where it
    can.
    """
    check_options(METHODS, kind)
    made = [representation(name) for name in without_options(REPRESENTATIONS)]
    suitable = [one for one in (*made, BoundedGenes()) if _accepts(kind, one)]
    assert suitable, f"{kind} refuses every representation"
    for one in suitable:
        _check_determinism(kind, one)
        if np.isfinite(one.bounds).any():
            _check_bounds(kind, one)
    _check_choices(kind)
    first = suitable[0]
    _check_budget(kind, first)
    _check_failures(kind, first)
    _check_fitness(kind, first)
    _check_target(kind, first)
    _check_kept(kind, first)
    check_replay(_new(kind, first))
    check_steady_state(METHODS.get(kind), first)
    _check_start(kind, first)


def _new(kind: str, representation: Representation, seed: int = 1, **options: Any) -> Method:  # noqa: ANN401
    component = METHODS.get(kind)
    return component(
        component.options_model(**{"generations": _GENERATIONS, **options}), representation, seed=seed
    )


def _accepts(kind: str, representation: Representation) -> bool:
    component = METHODS.get(kind)
    reason = component.unsuitable(representation)
    if reason is None:
        return True
    assert reason, "unsuitable must return the reason"
    try:
        _new(kind, representation)
    except InputError as error:
        if not str(error).startswith("method.kind: "):
            raise AssertionError(f"the message must name method.kind: {error}") from error
        return False
    raise AssertionError(f"{kind} says that {representation.kind} is unsuitable, and takes it")


def _bytes(asked: list[Genomes]) -> list[bytes]:
    return [genomes.tobytes() for genomes in asked]


def _sphere(genomes: Genomes) -> Fitness:
    """Return minus the squared length of each genome: negative, best at 0, the same on every machine."""
    squares: Fitness = np.add.accumulate(genomes.astype(np.float64) ** 2, axis=1)[:, -1]
    return -squares


def _scaled(scale: float, genomes: Genomes) -> Fitness:
    return scale * (_sphere(genomes) / 1e3)


@contextmanager
def _strictly() -> Iterator[None]:
    """Make every warning an error, such as overflow."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


def _conversation(method: Method, judge: Judge = _sphere) -> list[Genomes]:
    lower, upper = method.representation.bounds
    asked: list[Genomes] = []
    with _strictly():
        while not method.done:
            genomes = method.ask()
            assert genomes.dtype == np.float32, f"ask returns {genomes.dtype}, not float32"
            assert genomes.ndim == 2, f"ask returns the shape {genomes.shape}"
            assert genomes.shape[1] == method.representation.genome_size, (
                f"ask returns the shape {genomes.shape}"
            )
            assert len(genomes) >= 1, "ask returns nothing to evaluate"
            assert np.isfinite(genomes).all(), "ask returns numbers that are not finite"
            assert ((lower <= genomes) & (genomes <= upper)).all(), "ask returns genes outside of bounds"
            asked.append(genomes.copy())
            # The method must not keep a reference to the caller's array.
            fitness = judge(genomes)
            metrics = synthetic_metrics(method, genomes, fitness)
            genomes[:] = np.nan
            method.tell(fitness, metrics=metrics)
            fitness[:] = 0.0
            assert len(method.population_fitness) >= 1
            assert not np.isinf(method.population_fitness).any(), "an infinite fitness is a failed one"
    return asked


def _tell(method: Method, genomes: Genomes) -> None:
    fitness = _sphere(genomes)
    method.tell(fitness, metrics=synthetic_metrics(method, genomes, fitness))


def _check_determinism(kind: str, representation: Representation) -> None:
    asked = _conversation(_new(kind, representation))
    assert len(asked) == _GENERATIONS, f"{len(asked)} generations instead of {_GENERATIONS}"

    def meddling(genomes: Genomes) -> Fitness:
        np.random.random(3)  # noqa: NPY002 - as other code would
        random.random()
        return _sphere(genomes)

    assert _bytes(asked) == _bytes(_conversation(_new(kind, representation), meddling)), (
        "the same seed and fitness must give the same genomes, whatever random numbers others draw"
    )
    before = _shared_state()
    others = _conversation(_new(kind, representation, 2))
    assert _bytes(asked) != _bytes(others), "another seed must give others"
    assert _shared_state() == before, "the random numbers that Python and NumPy share must be left alone"


def _shared_state() -> tuple[Any, ...]:
    state: Any = np.random.get_state()  # noqa: NPY002 - it must not change
    return random.getstate(), state[1].tobytes(), state[2:]


def _check_bounds(kind: str, representation: Representation) -> None:
    """Fitness is far better beyond the bounds: a method must stay within them."""

    def far(genomes: Genomes) -> Fitness:
        sums: Fitness = np.add.accumulate(genomes.astype(np.float64), axis=1)[:, -1]
        return sums

    _conversation(_new(kind, representation), far)
    _conversation(_new(kind, representation), lambda genomes: -far(genomes))


def _check_choices(kind: str) -> None:
    representation = Choices()
    if _accepts(kind, representation):
        for genomes in _conversation(_new(kind, representation)):
            assert set(genomes.ravel().tolist()) <= {0.0, 1.0, 2.0, 3.0}, (
                "genes of a representation that is not continuous are choices: "
                "vary them by its operators, or refuse it by `unsuitable`"
            )


def _check_budget(kind: str, representation: Representation) -> None:
    method = _new(kind, representation)
    budget = method.budget
    asked = _conversation(method)
    assert sum(map(len, asked)) == method.evaluations, "evaluations is not what was evaluated"
    assert method.evaluations <= budget, "more was evaluated than budget says"


def _check_failures(kind: str, representation: Representation) -> None:
    """Failed candidates must neither stop a method nor guide it."""

    def half(genomes: Genomes) -> Fitness:
        fitness = _sphere(genomes)
        fitness[::2] = np.nan
        fitness[1:2] = -np.inf
        return fitness

    _conversation(_new(kind, representation), half)
    generations = iter(range(1_000_000))

    def rarely(genomes: Genomes) -> Fitness:
        works = next(generations) % 3 == 1
        return _sphere(genomes) if works else np.full(len(genomes), np.nan)

    assert _conversation(_new(kind, representation), rarely), (
        "generations that fail as a whole must not stop it"
    )


def _check_fitness(kind: str, representation: Representation) -> None:
    """Any sign, any size, any difference."""
    for scale in (1e300, 1e-300, -1e300, 1e20, 0.0):
        _conversation(_new(kind, representation), partial(_scaled, scale))
    turns = iter(range(1_000_000))

    def jumping(genomes: Genomes) -> Fitness:
        return _scaled(10.0 ** (100 * (next(turns) % 4) - 150), genomes)

    _conversation(_new(kind, representation), jumping)
    mixed = np.array([1.7e308, -1.7e308, 0.0, 1e-320, np.nan])
    _conversation(_new(kind, representation), lambda genomes: np.resize(mixed, len(genomes)))


def _check_target(kind: str, representation: Representation) -> None:
    method = _new(kind, representation, target=-1e9)
    # A race tests after some instances whether its best has reached it.
    for _ in range(_GENERATIONS - 1 if method.by_instance else 1):
        if not method.done:
            _tell(method, method.ask())
    assert method.done, "a target that is reached must end the method"


def _check_kept(kind: str, representation: Representation) -> None:
    """Members that stay may be evaluated again, with any result."""
    method = _new(kind, representation)
    found = 0
    lower, upper = representation.bounds
    while not method.done:
        genomes = method.ask()
        members = method.kept()
        found += len(members)
        assert members.dtype == np.float32, f"kept returns {members.dtype}, not float32"
        assert members.shape == (len(members), representation.genome_size), (
            f"kept returns shape {members.shape}"
        )
        assert ((lower <= members) & (members <= upper)).all(), "kept returns genes outside of bounds"
        again = _sphere(members) - method.generation
        again[1::5] = np.nan
        if not method.keeps_members:
            _tell(method, genomes)
            continue
        fitness = _sphere(genomes) - 1e6
        method.tell(fitness, again, synthetic_metrics(method, genomes, fitness))
        shown = set(method.population_fitness.tolist())
        assert {value for value in again.tolist() if value == value} <= shown, (
            "population_fitness must show the fitness that members were given last"
        )
    assert (found > 0) == method.keeps_members, "keeps_members must say whether members are kept"


def _check_start(kind: str, representation: Representation) -> None:
    """Check that a method starts from given genomes, or rejects them."""
    component = METHODS.get(kind)
    given = _off_center(representation)
    method, other = _new(kind, representation), _new(kind, representation)
    if component.start_as is None:
        try:
            method.start_from(given)
        except InputError:
            return
        raise AssertionError(f"{kind}: start_as is None, and start_from takes genomes nevertheless")
    method.start_from(given)
    first, usual = method.ask(), other.ask()
    if component.start_as == "members":
        assert first[0].tobytes() == given[0].tobytes(), f"{kind}: the first candidate is another genome"
        assert first[1:].tobytes() == usual[1:].tobytes(), f"{kind}: the other candidates have changed"
    else:
        near, far = (np.abs(asked.mean(axis=0) - given[0]).sum() for asked in (first, usual))
        assert near < far, f"{kind}: the first sample is not around the given genome"
    again = _new(kind, representation)
    again.start_from(given)
    assert again.ask().tobytes() == first.tobytes(), f"{kind}: starts differently the second time"


def _off_center(representation: Representation) -> Genomes:
    """Return a genome away from the middle of the initial range, (1, genome_size)."""
    lower, upper = representation.initial_range
    return np.asarray((lower + 0.9 * (upper - lower)).astype(np.float32)[np.newaxis])

"""Checks of methods and rankings."""

import json
import random
import subprocess
import sys
import warnings
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from hashlib import sha256
from importlib import import_module
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from swarmwright.common.arrays import Fitness, Genome, Genomes, Limits
from swarmwright.common.errors import InputError
from swarmwright.common.problems import FieldError
from swarmwright.common.random_numbers import Stream
from swarmwright.controllers import REPRESENTATIONS, Representation, RepresentationOptions
from swarmwright.methods import METHODS, Method
from swarmwright.methods.rankings import RANKINGS, Ranking
from swarmwright.testing._common import (
    EXAMPLES,
    check_options,
    kinds_without_options,
    representation,
    synthetic_metrics,
)

_SPREAD = np.array([0.0, 3.5, -1.25, 8.0, 0.5])
"""Results of a candidate's episodes, some far better than others."""
_NUMBERS = 4
"""Generations whose seeds are compared, or candidates in steady state."""
_LARGEST_SEED = 2**63 - 1


def check_ranking(kind: str) -> None:
    """Check a registered ranking with its default options and several numbers of episodes.

    Raises AssertionError with the violated rule.
    """
    check_options(RANKINGS, kind)
    component = RANKINGS.get(kind)
    for episodes in (1, 2, 5):
        for seeds in ("same", "new"):
            ranking = _ranking(component, episodes, seeds=seeds)
            if ranking is not None:
                _check_seeds(ranking)
        ranking = _ranking(component, episodes)
        assert ranking is not None
        _check_scores(ranking)
        _check_samples(ranking)
    reevaluating = _ranking(component, 2, reevaluate=True)
    if reevaluating is not None:
        scores = _plain(reevaluating, [[1.0, 2.0], [3.0, 4.0, 3.5, 4.5]])
        assert np.isfinite(scores).all(), "with reevaluate, _score must take rows of different length"


def _ranking(component: type[Ranking], episodes: int, **options: object) -> Ranking | None:
    """Create a ranking with options; return None if it refuses them."""
    values = {**EXAMPLES.get(component.kind, {}), "episodes": episodes}
    try:
        return component(component.options_model.model_validate({**values, **options}))
    except ValidationError:
        if not options:
            raise
        return None


def _check_seeds(ranking: Ranking) -> None:
    """Check the seeds of episodes: in range, different, and equal to `ranking.seeds`."""
    episodes, new = ranking.options.episodes, ranking.options.seeds == "new"
    several = [ranking.seeds_of(7, number) for number in range(_NUMBERS)]
    for number, seeds in enumerate(several):
        assert len(seeds) == episodes, f"seeds_of must return {episodes} seed(s), one for each episode"
        assert len(set(seeds)) == episodes, "episodes must have different seeds"
        assert all(0 <= seed <= _LARGEST_SEED for seed in seeds), "seeds must be from 0 to 2**63 - 1"
        assert seeds == ranking.seeds_of(7, number), "seeds_of must return the same seeds each time"
        expected = several[number if new else 0]
        assert ranking.seeds(7, number) == expected, (
            "seeds must be those of seeds_of, by generation with `seeds: new`, else of number 0"
        )
    every = [seed for seeds in several for seed in seeds]
    assert len(set(every)) == len(every), "seeds of different numbers must have none in common"


def _check_scores(ranking: Ranking) -> None:
    episodes = ranking.options.episodes
    even = np.arange(4 * episodes, dtype=np.float64).reshape(4, episodes) - 6
    uneven = _SPREAD[:episodes] + np.array([[-6.0], [-1.0], [0.5], [9.0]])
    for results in (even, uneven):
        scores = ranking.score(results)
        assert scores.dtype == np.float64, "fitness must be float64"
        assert scores.shape == (4,), "there must be a fitness for each candidate"
        assert (np.diff(scores) > 0).all(), "better by the same in every episode must be better"
        assert np.array_equal(scores, ranking.score(results)), "the same results must have the same fitness"
        by_array = np.asarray(ranking._score_array(results), dtype=np.float64)
        assert np.allclose(by_array, _plain(ranking, results.tolist()), rtol=1e-9, atol=1e-12), (
            "_score and _score_array must return the same"
        )
        if type(ranking).score is Ranking.score:  # a race, for one, compares candidates
            alone = [ranking.score(results[[row]])[0] for row in range(4)]
            assert np.allclose(scores, alone, rtol=1e-9, atol=1e-12), (
                "the fitness of a candidate must not depend on the others"
            )
    broken = even.copy()
    broken[1, -1] = np.nan
    broken[2, 0] = np.inf
    failed = ranking.score(broken)
    assert np.isnan(failed[[1, 2]]).all(), "a candidate with a failed episode must have failed"
    assert np.isfinite(failed[[0, 3]]).all(), "others must not suffer from a failed candidate"
    assert ranking.score(np.empty((0, episodes))).shape == (0,), "no candidates must have no fitness"


def _check_samples(ranking: Ranking) -> None:
    """Check the values of a candidate for validation."""
    results = [*_SPREAD, *(_SPREAD + 1), *(_SPREAD - 2), *_SPREAD]
    samples = ranking.samples(results)
    assert isinstance(samples, np.ndarray), "samples must return an array"
    assert samples.dtype == np.float64, "samples must be float64"
    assert samples.ndim == 1, "samples must return (samples,) values"
    least = len(results) // ranking.options.episodes
    assert len(samples) >= least, f"samples must make {least} values or more of {len(results)} episodes"
    assert np.isfinite(samples).all(), "samples of finite results must be finite"
    assert np.array_equal(samples, ranking.samples(results)), "the same results must have the same samples"


def _plain(ranking: Ranking, rows: list[list[float]]) -> NDArray[np.float64]:
    """Return the results of `_score` as plain values."""
    scores = np.asarray(ranking._score(rows), dtype=np.float64)
    assert scores.shape == (len(rows),), "_score must return a fitness for each candidate"
    return scores


_GENES = 12
_VALUES = 4


class _Options(RepresentationOptions):
    """No options."""

    kind: Literal["sample"] = "sample"


class _Sample(Representation):
    """Genes that mutations redraw and crossovers exchange individually; without a controller."""

    kind = "sample"
    options_model = _Options

    def __init__(self) -> None:
        super().__init__(_Options(), sensors=1, actuators=1)

    @property
    def genome_size(self) -> int:
        """Number of genes."""
        return _GENES

    def architecture(self) -> dict[str, Any]:
        """Return nothing: these genomes encode no controller."""
        raise NotImplementedError

    def mutate(self, genome: Genome, stream: Stream, *, severity: float, probability: float) -> Genome:
        """Return a copy in which each gene is redrawn with `probability`."""
        chosen = stream.unit(_GENES) < probability * min(severity, 1.0)
        return np.where(chosen, self.initial(stream), genome).astype(np.float32)

    def crossover(self, mother: Genome, father: Genome, stream: Stream) -> Genome:
        """Return a copy of `mother` with half of the genes of `father`."""
        return np.where(stream.unit(_GENES) < 0.5, mother, father).astype(np.float32)

    def distance(self, genome: Genome, other: Genome) -> float:
        """Return the number of genes that differ."""
        return float((genome != other).sum())


class BoundedGenes(_Sample):
    """Genes in 0..1, except for the last three: at least 2, at most -2, and unbounded."""

    @property
    def bounds(self) -> Limits:
        """Lowest and highest value of each gene."""
        lower, upper = np.zeros(_GENES), np.ones(_GENES)
        lower[-3:] = [2, -np.inf, -np.inf]
        upper[-3:] = [np.inf, -2, np.inf]
        return lower, upper

    @property
    def initial_range(self) -> Limits:
        """Initial range of the genes."""
        lower, upper = np.zeros(_GENES), np.ones(_GENES)
        lower[-3:], upper[-3:] = [2, -3, -1], [3, -2, 1]
        return lower, upper

    def initial(self, stream: Stream) -> Genome:
        """Return genes uniform in their initial range."""
        lower, upper = self.initial_range
        return (lower + (upper - lower) * stream.unit(_GENES)).astype(np.float32)


class Choices(_Sample):
    """Genes with the unordered values 0, 1, 2, 3."""

    continuous = False

    @property
    def bounds(self) -> Limits:
        """Lowest and highest value of each gene."""
        return np.zeros(_GENES), np.full(_GENES, _VALUES - 1.0)

    def initial(self, stream: Stream) -> Genome:
        """Return random choices."""
        return np.array(stream.integers(_VALUES, _GENES), dtype=np.float32)


_STEADY_GENERATIONS = 3


def check_steady_state(component: type[Method], subject: Representation) -> None:
    """Check a method in steady state, or that it rejects steady state."""
    if not component.steady_state:
        _check_refusal(component, subject)
        return
    for in_flight in (1, 5, 10_000):
        genomes = _ask_early(_steady_new(component, subject, in_flight))
        assert len(genomes) == _budget(component, subject), "budget is not what was evaluated"
        assert _steady_bytes(genomes) == _steady_bytes(
            _ask_late(_steady_new(component, subject, in_flight))
        ), f"with in_flight {in_flight}, genomes depend on when they are asked for"
        assert _steady_bytes(genomes) != _steady_bytes(
            _ask_late(_steady_new(component, subject, in_flight, seed=2))
        )
    _check_window(_steady_new(component, subject, 3))
    _check_turns(_steady_new(component, subject, 3))
    _steady_check_failures(_steady_new(component, subject, 4))
    _steady_check_target(component, subject)


def _steady_new(component: type[Method], subject: Representation, in_flight: int, seed: int = 1) -> Method:
    options = component.options_model(
        generations=_STEADY_GENERATIONS, operation="steady_state", in_flight=in_flight
    )
    return component(options, subject, seed=seed)


def _budget(component: type[Method], subject: Representation) -> int:
    method = _steady_new(component, subject, 1)
    size = method.generation_size
    assert method.budget == size * _STEADY_GENERATIONS, "budget must be generations x generation_size"
    return method.budget


def _tell_next(method: Method, fitness: float, genome: Genome | None = None) -> None:
    """Tell the fitness of the next candidate, with artificial metrics if the method needs some."""
    if genome is None:
        genome = np.zeros(method.representation.genome_size, dtype=np.float32)
    metrics = synthetic_metrics(method, genome[np.newaxis], np.array([fitness]))
    if metrics is None:
        method.tell_next(fitness)
    else:
        method.tell_next(fitness, metrics[0])


def _steady_bytes(genomes: list[Genome]) -> list[bytes]:
    return [genome.tobytes() for genome in genomes]


def _value(genome: Genome) -> float:
    return -float(np.abs(genome.astype(np.float64)).max())


def _check_genome(method: Method, index: int, genome: Genome, expected: int) -> Genome:
    assert index == expected, f"candidate {index} came after candidate {expected - 1}"
    assert genome.dtype == np.float32, f"ask_next returns {genome.dtype}, not float32"
    assert genome.shape == (method.representation.genome_size,), f"ask_next returns shape {genome.shape}"
    lower, upper = method.representation.bounds
    assert np.isfinite(genome).all(), "ask_next returns numbers that are not finite"
    assert ((lower <= genome) & (genome <= upper)).all(), "ask_next returns genes outside of bounds"
    return genome.copy()


def _ask_early(method: Method) -> list[Genome]:
    """Ask for all available genomes, tell one result, and repeat."""
    genomes: list[Genome] = []
    while not method.done:
        while method.can_ask:
            index, genome = method.ask_next()
            genomes.append(_check_genome(method, index, genome, len(genomes)))
            genome[:] = np.nan
        genome = genomes[method.evaluations]
        _tell_next(method, _value(genome), genome)
        assert not np.isinf(method.population_fitness).any()
    return genomes


def _ask_late(method: Method) -> list[Genome]:
    """Ask only if there is no result to tell."""
    genomes: list[Genome] = []
    waiting: deque[Genome] = deque()
    while not method.done:
        if not waiting:
            index, genome = method.ask_next()
            genomes.append(_check_genome(method, index, genome, len(genomes)))
            waiting.append(genome.copy())
        _tell_next(method, _value(waiting[0]), waiting.popleft())
    return genomes


def _check_window(method: Method) -> None:
    count = 0
    while method.can_ask:
        method.ask_next()
        count += 1
    assert count == method.options.in_flight, f"{count} in flight, not {method.options.in_flight}"
    _must_refuse(method.ask_next, "asking beyond in_flight must raise InputError")
    _tell_next(method, 1.0)
    assert method.can_ask, "after a result, the next candidate can be asked for"


def _check_turns(method: Method) -> None:
    _must_refuse(lambda: _tell_next(method, 1.0), "telling before asking must raise InputError")
    _must_refuse(method.ask, "ask must raise InputError in steady state")
    method.ask_next()
    _tell_next(method, 1.0)
    _must_refuse(lambda: _tell_next(method, 1.0), "telling twice must raise InputError")


def _steady_check_failures(method: Method) -> None:
    while not method.done:
        while method.can_ask:
            _, genome = method.ask_next()
        index = method.evaluations
        broken = index < method.generation_size or index % 3
        _tell_next(method, np.inf if broken else _value(genome), genome)
    assert np.isnan(method.population_fitness).any() or np.isfinite(method.population_fitness).all()


def _steady_check_target(component: type[Method], subject: Representation) -> None:
    options = component.options_model(operation="steady_state", target=-1e9)
    method = component(options, subject, seed=1)
    _, genome = method.ask_next()
    _tell_next(method, _value(genome), genome)
    assert method.done, "a target that is reached must end the method"
    _must_refuse(method.ask_next, "asking when done must raise InputError")


def _check_refusal(component: type[Method], subject: Representation) -> None:
    assert component.generational_because, "generational_because must say why there is no steady state"
    try:
        _steady_new(component, subject, 1)
    except InputError as error:
        if not (isinstance(error, FieldError) and error.path == ("method", "operation")):
            raise AssertionError(f"the message must name method.operation: {error}") from error
        return
    raise AssertionError(f"{component.kind} has no steady_state, and takes operation: steady_state")


def _must_refuse(action: Callable[[], object], otherwise: str) -> None:
    try:
        action()
    except InputError:
        return
    raise AssertionError(otherwise)


_CODE = "import json, sys; sys.path[:] = json.loads(sys.argv[1]); from swarmwright.testing import _methods; _methods.main()"  # noqa: E501 - one line of a command


def check_replay(method: Method) -> None:
    """Check that a method gives the same genomes if its results are replayed in a new process."""
    fitness_lists: list[list[float | None]] = []
    genome_texts: list[str] = []
    while not method.done:
        genomes = method.ask()
        genome_texts.append(sha256(genomes.tobytes()).hexdigest())
        fitness = -np.abs(genomes.astype(np.float64)).max(axis=1)
        fitness[len(fitness_lists) % 3 :: 5] = np.nan
        method.tell(fitness, metrics=synthetic_metrics(method, genomes, fitness))
        fitness_lists.append([None if np.isnan(value) else value for value in fitness.tolist()])
    kind = type(method)
    subject = method.representation
    conversation = {
        "method": [kind.__module__, kind.__qualname__],
        "options": method.options.model_dump(),
        "representation": [type(subject).__module__, type(subject).__qualname__],
        "controller": subject.options.model_dump(),
        "sizes": {"sensors": subject.sensors, "actuators": subject.actuators},
        "seed": method.seed,
        "told": fitness_lists,
    }
    process = subprocess.run(
        [sys.executable, "-P", "-c", _CODE, json.dumps(sys.path)],
        input=json.dumps(conversation),
        capture_output=True,
        text=True,
        check=False,
    )
    assert process.returncode == 0, f"the method cannot be told again in a new process:\n{process.stderr}"
    repeated = json.loads(process.stdout)
    first = next(
        (index for index, pair in enumerate(zip(genome_texts, repeated, strict=True)) if len({*pair}) > 1),
        None,
    )
    assert first is None, f"told again in a new process, generation {first} has other genomes"


def main() -> None:
    """Replay the results on standard input; write the resulting genomes."""
    conversation: dict[str, Any] = json.load(sys.stdin)
    representation, kind = _find(*conversation["representation"]), conversation["options"]["kind"]
    component: Any = METHODS.get(kind) if METHODS.is_in_file(kind) else _find(*conversation["method"])
    subject = representation(
        representation.options_model(**conversation["controller"]), **conversation["sizes"]
    )
    method = component(component.options_model(**conversation["options"]), subject, seed=conversation["seed"])
    genome_texts = []
    for values in conversation["told"]:
        genomes, fitness = method.ask(), _fitness(values)
        genome_texts.append(sha256(genomes.tobytes()).hexdigest())
        method.tell(fitness, metrics=synthetic_metrics(method, genomes, fitness))
    json.dump(genome_texts, sys.stdout)


def _fitness(values: Sequence[float | None]) -> Fitness:
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)


def _find(module: str, name: str) -> Any:  # noqa: ANN401 - any class
    return getattr(import_module(module), name)


_GENERATIONS = 6

Judge = Callable[[Genomes], Fitness]


def check_method(kind: str) -> None:
    """Check a registered method with its default options, but few generations.

    It is tried with every registered representation, with bounded genes and with genes that are choices; it
    must evolve them or refuse them by `unsuitable`. Then it is tried with fitness of every sign and size,
    with equal fitness, and with failed evaluations; it is resumed in a new process; and steady state is tried
    if it supports that.
    """
    check_options(METHODS, kind)
    representations = [representation(name) for name in kinds_without_options(REPRESENTATIONS)]
    suitable = [subject for subject in (*representations, BoundedGenes()) if _accepts(kind, subject)]
    assert suitable, f"{kind} refuses every representation"
    for subject in suitable:
        _check_determinism(kind, subject)
        if np.isfinite(subject.bounds).any():
            _check_bounds(kind, subject)
    _check_choices(kind)
    first = suitable[0]
    _check_budget(kind, first)
    _check_failures(kind, first)
    _check_fitness(kind, first)
    _check_constraints(kind, first)
    _check_target(kind, first)
    _check_members(kind, first)
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
        if not (isinstance(error, FieldError) and error.path == ("method", "kind")):
            raise AssertionError(f"the message must name method.kind: {error}") from error
        return False
    raise AssertionError(f"{kind} says that {representation.kind} is unsuitable, and takes it")


def _bytes(generations: list[Genomes]) -> list[bytes]:
    return [genomes.tobytes() for genomes in generations]


def _sphere(genomes: Genomes) -> Fitness:
    """Return minus the squared length of each genome: best at 0, identical on every machine."""
    squares: Fitness = np.add.accumulate(genomes.astype(np.float64) ** 2, axis=1)[:, -1]
    return -squares


def _score_scaled(scale: float, genomes: Genomes) -> Fitness:
    return scale * (_sphere(genomes) / 1e10)  # genes that are choices may be large


@contextmanager
def _strictly() -> Iterator[None]:
    """Turn every warning, such as overflow, into an error."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


def _conversation(method: Method, judge: Judge = _sphere) -> list[Genomes]:
    lower, upper = method.representation.bounds
    generations: list[Genomes] = []
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
            generations.append(genomes.copy())
            # The method must not keep a reference to the caller's array.
            fitness = judge(genomes)
            metrics = synthetic_metrics(method, genomes, fitness)
            genomes[:] = np.nan
            method.tell(fitness, metrics=metrics)
            fitness[:] = 0.0
            assert len(method.population_fitness) >= 1
            assert not np.isinf(method.population_fitness).any(), "an infinite fitness is a failed one"
    return generations


def _tell(method: Method, genomes: Genomes) -> None:
    fitness = _sphere(genomes)
    method.tell(fitness, metrics=synthetic_metrics(method, genomes, fitness))


def _check_determinism(kind: str, representation: Representation) -> None:
    generations = _conversation(_new(kind, representation))
    assert len(generations) == _GENERATIONS, f"{len(generations)} generations instead of {_GENERATIONS}"

    def meddling(genomes: Genomes) -> Fitness:
        np.random.random(3)  # noqa: NPY002 - as other code would
        random.random()
        return _sphere(genomes)

    assert _bytes(generations) == _bytes(_conversation(_new(kind, representation), meddling)), (
        "the same seed and fitness must give the same genomes, whatever random numbers others draw"
    )
    before = _capture_shared_state()
    others = _conversation(_new(kind, representation, 2))
    assert _bytes(generations) != _bytes(others), "another seed must give others"
    assert _capture_shared_state() == before, (
        "the random numbers that Python and NumPy share must be left alone"
    )


def _capture_shared_state() -> tuple[Any, ...]:
    state: Any = np.random.get_state()  # noqa: NPY002 - it must not change
    return random.getstate(), state[1].tobytes(), state[2:]


def _check_bounds(kind: str, representation: Representation) -> None:
    """Check that a method stays within bounds beyond which fitness is far better."""

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
    generations = _conversation(method)
    assert sum(map(len, generations)) == method.evaluations, "evaluations is not what was evaluated"
    assert method.evaluations <= budget, "more was evaluated than budget says"


def _check_constraints(kind: str, representation: Representation) -> None:
    """Check that a method takes violations, and that infeasible candidates do not reach its target."""
    if METHODS.get(kind).by_instance:
        return  # experiments refuse constraints
    method = _new(kind, representation, target=-1e9)
    with _strictly():
        for generation in range(_GENERATIONS - 1):
            genomes = method.ask()
            fitness = _sphere(genomes)
            violations = np.arange(len(genomes), dtype=np.float64) + 1
            violations[::3] = np.inf if generation else 0.5
            metrics = synthetic_metrics(method, genomes, fitness)
            method.tell(fitness, metrics=metrics, violations=violations)
            assert not method.done, "an infeasible candidate must not reach the target"
        genomes = method.ask()
        fitness = _sphere(genomes)
        metrics = synthetic_metrics(method, genomes, fitness)
        method.tell(fitness, metrics=metrics, violations=np.zeros(len(genomes)))
    assert method.reached, "a feasible candidate must reach the target"


def _check_failures(kind: str, representation: Representation) -> None:
    """Check that failed candidates neither stop nor guide a method."""

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
    """Check fitness of any sign, size and difference."""
    for scale in (1e300, 1e-300, -1e300, 1e20, 0.0):
        _conversation(_new(kind, representation), partial(_score_scaled, scale))
    turns = iter(range(1_000_000))

    def jumping(genomes: Genomes) -> Fitness:
        return _score_scaled(10.0 ** (100 * (next(turns) % 4) - 150), genomes)

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


def _check_members(kind: str, representation: Representation) -> None:
    """Check that surviving members can be re-evaluated, with any result."""
    method = _new(kind, representation)
    count = 0
    lower, upper = representation.bounds
    while not method.done:
        genomes = method.ask()
        members = method.survivors()
        count += len(members)
        assert members.dtype == np.float32, f"survivors returns {members.dtype}, not float32"
        assert members.shape == (len(members), representation.genome_size), (
            f"survivors returns shape {members.shape}"
        )
        assert ((lower <= members) & (members <= upper)).all(), "survivors returns genes outside of bounds"
        refreshed = _sphere(members) - method.generation
        refreshed[1::5] = np.nan
        if not method.keeps_members:
            _tell(method, genomes)
            continue
        fitness = _sphere(genomes) - 1e6
        method.tell(fitness, refreshed, synthetic_metrics(method, genomes, fitness))
        shown = set(method.population_fitness.tolist())
        assert {value for value in refreshed.tolist() if value == value} <= shown, (
            "population_fitness must show the fitness that members were given last"
        )
    assert (count > 0) == method.keeps_members, "keeps_members must say whether members are kept"


def _check_start(kind: str, representation: Representation) -> None:
    """Check that a method starts from given genomes, or rejects them."""
    component = METHODS.get(kind)
    starting = _off_center(representation)
    method, other = _new(kind, representation), _new(kind, representation)
    if component.start_as is None:
        try:
            method.start_from(starting)
        except InputError:
            return
        raise AssertionError(f"{kind}: start_as is None, and start_from takes genomes nevertheless")
    method.start_from(starting)
    first, usual = method.ask(), other.ask()
    if component.start_as == "members":
        assert first[0].tobytes() == starting[0].tobytes(), f"{kind}: the first candidate is another genome"
        assert first[1:].tobytes() == usual[1:].tobytes(), f"{kind}: the other candidates have changed"
    else:
        distance_near, distance_far = (
            np.abs(generation.mean(axis=0) - starting[0]).sum() for generation in (first, usual)
        )
        assert distance_near < distance_far, f"{kind}: the first sample is not around the given genome"
    restarted = _new(kind, representation)
    restarted.start_from(starting)
    assert restarted.ask().tobytes() == first.tobytes(), f"{kind}: starts differently the second time"


def _off_center(representation: Representation) -> Genomes:
    """Return a genome away from the middle of the initial range, (1, genome_size)."""
    lower, upper = representation.initial_range
    return np.asarray((lower + 0.9 * (upper - lower)).astype(np.float32)[np.newaxis])

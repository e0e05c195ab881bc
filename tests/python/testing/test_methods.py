"""The checks for plug-in authors find what is wrong."""

from collections.abc import Callable
from typing import Any, ClassVar, Literal

import numpy as np
import pytest

from swarmwright import InputError
from swarmwright.controllers import REPRESENTATIONS
from swarmwright.methods import METHODS, Method, MethodOptions
from swarmwright.methods.cea2d import Cea2d
from swarmwright.methods.cma_es import CmaEs
from swarmwright.methods.nnga import Nnga
from swarmwright.methods.random_search import RandomSearch, RandomSearchOptions
from swarmwright.methods.rankings import RANKINGS, Ranking, RankingOptions
from swarmwright.testing import check_method, check_ranking

sample: Callable[[Any], Any] = RandomSearch._ask


class MeasuredOptions(RandomSearchOptions):
    """Needs two metrics in any case."""

    kind: Literal["measured"] = "measured"  # type: ignore[assignment] # another kind

    @property
    def needed_metrics(self) -> tuple[str, ...]:
        return "steps", "distance"


class Measured(RandomSearch):
    """Moves its samples by the least metric of those before; it fails where it is told none."""

    kind = "measured"
    options_model = MeasuredOptions  # type: ignore[assignment] # of another kind, too

    def __init__(self, options: Any, representation: Any, *, seed: int) -> None:
        super().__init__(options, representation, seed=seed)
        self.shift = 0.0

    def _ask(self) -> Any:
        lower, upper = self.representation.bounds
        if not self.representation.continuous:
            return super()._ask()
        return np.clip(super()._ask() + np.float32(self.shift), lower, upper)

    def _tell(self, genomes: Any, fitness: Any) -> None:
        super()._tell(genomes, fitness)
        assert self.metrics.shape == (len(genomes), 2)
        assert np.isnan(self.metrics[np.isnan(fitness)]).all()
        if not np.isnan(fitness).all():
            self.shift = float(np.nanmin(self.metrics))


def of_shared_numbers(method: Any) -> Any:
    return np.random.random((3, method.representation.genome_size)).astype(np.float32)  # noqa: NPY002


def of_new_numbers(method: Any) -> Any:
    return np.random.default_rng().random((3, method.representation.genome_size)).astype(np.float32)


def of_the_clock(method: Any, shared: list[int] = []) -> Any:  # noqa: B006 - state outside of the method is the point
    shared.append(0)
    genomes = sample(method)
    genomes[0, 0] = len(shared) / 1000  # within any bounds
    return genomes


def beyond_bounds(method: Any) -> Any:
    return sample(method) * np.float32(50)


def wide(method: Any) -> Any:
    return sample(method).astype(np.float64)


def none(method: Any) -> Any:
    return sample(method)[:0]


def infinite(method: Any) -> Any:
    return sample(method) * np.float32(np.inf)


def by_sums(method: Any, _: Any, fitness: Any) -> None:
    """Compute with sums that overflow."""
    method._fitness = fitness - fitness.sum()
    method._mean = float(np.mean(fitness**2))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "broken", "words"),
    [
        ("_ask", of_shared_numbers, "whatever random numbers others draw"),
        ("_ask", of_new_numbers, "whatever random numbers others draw"),
        ("_ask", of_the_clock, "whatever random numbers others draw"),
        ("_ask", beyond_bounds, "outside of bounds"),
        ("_ask", wide, "ask returns float64, not float32"),
        ("_ask", none, "nothing to evaluate"),
        ("_ask", infinite, "not finite"),
        ("_tell", by_sums, "overflow"),
        ("budget", 1, "more was evaluated than budget says"),
        ("steady_state", False, None),
        ("generational_because", "", None),
        ("generation_size", 7, "budget must be generations x generation_size"),
    ],
)
def test_what_is_wrong_is_found(
    name: str, broken: Callable[..., Any], words: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(RandomSearch, name, broken)
    if words is None:
        check_method("random_search")
        return
    with pytest.raises((AssertionError, RuntimeWarning), match=words):
        check_method("random_search")


def test_a_method_that_computes_with_choices_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(CmaEs, "unsuitable", classmethod(lambda _, __: None))
    with pytest.raises(AssertionError, match="vary them by its operators, or refuse it by `unsuitable`"):
        check_method("cma_es")


def test_a_refusal_that_does_not_refuse_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(RandomSearch, "unsuitable", classmethod(lambda _, __: "for no reason"))
    monkeypatch.setattr(RandomSearch, "problems", classmethod(lambda *_: {}))
    with pytest.raises(AssertionError, match="is unsuitable, and takes it"):
        check_method("random_search")


@pytest.mark.slow
def test_state_that_a_new_process_does_not_have_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    def of_this_process(method: Method) -> Any:
        return sample(method)[::-1]

    class Elsewhere(RandomSearch):
        _ask = of_this_process

    # The new process imports the class by name and finds the method as it is written.
    Elsewhere.__module__, Elsewhere.__qualname__ = RandomSearch.__module__, RandomSearch.__qualname__
    monkeypatch.setitem(METHODS._loaded, "random_search", Elsewhere)
    with pytest.raises(AssertionError, match="told again in a new process, generation 0 has other genomes"):
        check_method("random_search")


@pytest.mark.slow
def test_a_window_that_learns_too_early_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    def eager(method: Any, fitness: float) -> None:
        method._tell_next(method.evaluations, method._pending.popleft(), fitness)
        method.evaluations += 1
        method.done = method.evaluations >= method._last

    monkeypatch.setattr(Cea2d, "tell_next", eager)
    with pytest.raises(AssertionError, match="genomes depend on when they are asked for"):
        check_method("cea2d")


def test_members_that_are_kept_unsaid_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Nnga, "keeps_members", False)
    with pytest.raises(AssertionError, match="keeps_members must say whether members are kept"):
        check_method("nnga")


def test_options_without_a_description_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    class Bare(MethodOptions):
        kind: Any = "random_search"
        population: int = 3

    monkeypatch.setattr(RandomSearch, "options_model", Bare)
    with pytest.raises(AssertionError, match="population has no description"):
        check_method("random_search")


@pytest.mark.slow
def test_a_method_that_needs_metrics_is_given_some(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(METHODS._loaded, "measured", Measured)
    check_method("measured")


def test_metrics_are_needed_in_steady_state() -> None:
    network = REPRESENTATIONS.get("layered")
    subject = network(network.options_model(), sensors=2, actuators=1)
    method = Measured(MeasuredOptions(operation="steady_state"), subject, seed=1)
    method.ask_next()
    with pytest.raises(InputError, match=r"measured needs metrics: .* with columns steps, distance"):
        method.tell_next(1.0)
    method.tell_next(1.0, [3.0, 4.0])
    assert method.metrics.tolist() == [[3.0, 4.0]]


class PlainOptions(RankingOptions):
    """The mean."""

    kind: Literal["plain"] = "plain"


class Plain(Ranking):
    """The mean of a candidate's episodes."""

    kind: ClassVar[str] = "plain"
    options_model = PlainOptions

    def _score(self, episodes: Any) -> Any:
        return np.array([float(np.mean(row)) for row in episodes])


def with_(**methods: Callable[..., Any]) -> type[Ranking]:
    return type("Broken", (Plain,), methods)


@pytest.fixture
def check(monkeypatch: pytest.MonkeyPatch) -> Callable[[type[Ranking]], None]:
    def checked(component: type[Ranking]) -> None:
        monkeypatch.setitem(RANKINGS._loaded, "plain", component)
        check_ranking("plain")

    return checked


def test_a_right_one_passes(check: Any) -> None:
    check(Plain)
    check(with_(_score=lambda _, rows: np.array([np.mean(row) - np.std(row) for row in rows])))


def of_even_rows(_: Ranking, rows: Any) -> Any:
    even = len({len(row) for row in rows}) == 1
    return np.mean(rows, axis=1) if even else np.full(len(rows), np.nan)


def seeds_from(begin: Callable[[int, int], int]) -> Callable[..., list[int]]:
    def seeds_of(self: Ranking, first: int, number: int) -> list[int]:
        return [begin(first, number) + episode for episode in range(self.options.episodes)]

    return seeds_of


@pytest.mark.parametrize(
    ("rule", "methods"),
    [
        (
            "_score and _score_array must return the same",
            {"_score_array": lambda _, rows: rows.min(axis=1)},
        ),
        (
            "better by the same in every episode",
            {"_score": lambda _, rows: np.array([-np.mean(row) for row in rows])},
        ),
        (
            "better by the same in every episode",
            {"_score": lambda _, rows: np.array([np.mean(row) ** 2 for row in rows])},
        ),
        (
            "must not depend on the others",
            {"_score": lambda _, rows: np.array([np.mean(row) - np.mean(rows[0]) for row in rows])},
        ),
        ("rows of different length", {"_score": of_even_rows}),
        ("samples must return an array", {"samples": lambda *_: "nonsense"}),
        ("samples must be float64", {"samples": lambda *_: np.array([1, 2])}),
        ("values or more", {"samples": lambda _, episodes: np.array([np.mean(episodes)])}),
        ("samples must return \\(samples,\\)", {"samples": lambda _, episodes: np.array([episodes])}),
        ("different numbers must have none in common", {"seeds_of": seeds_from(lambda first, _: first)}),
        (
            "different numbers must have none in common",
            {"seeds_of": seeds_from(lambda first, number: first + number)},
        ),
        ("from 0 to 2\\*\\*63", {"seeds_of": seeds_from(lambda first, number: 9 * number - first)}),
        ("those of seeds_of", {"seeds": lambda self, first, generation=0: self.seeds_of(first, generation)}),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(check: Any, rule: str, methods: Any) -> None:
    with pytest.raises(AssertionError, match=rule):
        check(with_(**methods))

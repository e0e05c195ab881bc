"""The checks for authors of rankings find what is wrong."""

from collections.abc import Callable
from typing import Any, ClassVar, Literal

import numpy as np
import pytest

from swarmwright.methods.rankings import RANKINGS, Ranking, RankingOptions
from swarmwright.testing import check_ranking


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

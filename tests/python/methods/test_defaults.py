"""Every method solves problems with its defaults, sooner than random search: the page method-benchmarks."""

import math
import statistics

import pytest

from benchmarks import defaults
from benchmarks.defaults import PROBLEMS, SEEDS, main

KINDS = sorted(set(defaults.KINDS) - {"random_search", "racing"})
"""racing evaluates each candidate on several seeds, which are all the same here."""
CHEAP = ("Minisim", "XOR")
FEWER_OF_FOUR = {("cuckoo_search", "Emergency Exit"): 0, ("pso", "Emergency Exit"): 2}
"""Of the first four seeds."""


def evaluations(problem: str, kind: str) -> list[float]:
    return [PROBLEMS[problem].evaluations(kind, seed) for seed in SEEDS]


@pytest.mark.slow
@pytest.mark.parametrize("problem", CHEAP)
def test_all_methods_solve_it_with_their_defaults(problem: str) -> None:
    baseline = statistics.median(evaluations(problem, "random_search"))
    for kind in KINDS:
        found = evaluations(problem, kind)
        solved = sum(map(math.isfinite, found))
        assert solved >= 0.9 * len(SEEDS), f"{kind}: {solved} of {len(SEEDS)}"
        assert statistics.median(found) < baseline, kind


@pytest.mark.slow
@pytest.mark.parametrize("problem", ["cart-pole", "Emergency Exit"])
def test_most_of_four_seeds_solve_what_takes_longer(problem: str) -> None:
    """The benchmark has all forty."""
    for kind in KINDS:
        found = [PROBLEMS[problem].evaluations(kind, seed) for seed in range(1, 5)]
        assert sum(map(math.isfinite, found)) >= FEWER_OF_FOUR.get((kind, problem), 3), kind


def test_an_option_that_harms_is_seen() -> None:
    """With the whole initial range as the first standard deviation, the natural gradient leads nowhere."""
    problem = PROBLEMS["Minisim"]
    found = [problem.evaluations("snes", seed, {"step": 1.0}) for seed in SEEDS]
    assert sum(map(math.isfinite, found)) < 20


def test_the_table_has_a_line_for_each_method(capsys: pytest.CaptureFixture[str]) -> None:
    main(["Minisim", "pgpe", "snes", "snes.step=1.0"])
    head, rule, first, second = capsys.readouterr().out.splitlines()
    assert head == "| method | Minisim |"
    assert rule == "|---|---|"
    assert first.startswith("| `pgpe` | 40, ")
    assert second.startswith("| `snes` | ")
    assert second.endswith(", - |")

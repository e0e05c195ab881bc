"""Our methods against FREVO's table, at equal numbers of evaluations.

`python -m benchmarks.against_frevo random RUN...` compares runs on FREVO's random fields, with `stadium` runs on
its Stadium. They come from `swarmwright sweep experiments/frevo/random_methods.yaml`, or stadium_methods.yaml;
docs/explanation/frevo-comparison.md shows both tables.
"""

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from swarmwright import compare
from swarmwright._results._table import columns, number, p_words
from swarmwright._results._tests import holm

EVALUATIONS = 11_113
"""FREVO's in 300 generations: 50, then 37 in each."""
_SPAN = 3.078
"""Expected range of ten normal values, in standard deviations (Tippett 1925)."""


@dataclass(frozen=True)
class Quoted:
    """Best fitness of FREVO's ten runs, from tests/data/frevo/README.md."""

    mean: float
    worst: float
    best: float

    @property
    def deviation(self) -> float:
        """Standard deviation, estimated from the range: the values themselves are not known."""
        return (self.best - self.worst) / _SPAN


FREVO = {"random": Quoted(-42.2, -53.5, -29.6), "stadium": Quoted(0.46, 0.32, 0.54)}


def rows(quoted: Quoted, runs: list[Path]) -> list[list[str]]:
    """One row for each group of runs, the best mean first; the first two rows are the head and FREVO."""
    comparison = compare(runs, at=EVALUATIONS)
    groups = sorted(comparison.groups, key=lambda one: -float(one.final.mean()))
    own = next((one.final for one in groups if one.label == "nnga"), None)
    signed = holm([_wilcoxon(one.final, quoted.mean) for one in groups])
    shown = [["method", "mean", "worst", "best", "t", "Wilcoxon", "(Holm)", "Welch", "against nnga", "A12"]]
    dash = ["-"] * 6
    shown.append(["FREVO's NNGA", *(f"{x:g}" for x in (quoted.mean, quoted.worst, quoted.best)), *dash])
    for one, corrected in zip(groups, signed, strict=True):
        values = one.final
        tests = [_t(values, quoted.mean), _wilcoxon(values, quoted.mean), corrected, _welch(values, quoted)]
        against = dash[:2]
        if own is not None and values is not own:
            u = stats.mannwhitneyu(values, own, alternative="two-sided")
            against = [p_words(float(u.pvalue)), f"{float(u.statistic) / (len(values) * len(own)):.2f}"]
        span = [number(float(x)) for x in (values.mean(), values.min(), values.max())]
        shown.append([one.label, *span, *map(p_words, tests), *against])
    return shown


def _t(values: NDArray[np.float64], mean: float) -> float:
    """Return p of the one-sample t-test against FREVO's mean, taken as known."""
    return float(stats.ttest_1samp(values, mean).pvalue)


def _wilcoxon(values: NDArray[np.float64], mean: float) -> float:
    """Return p of Wilcoxon's signed-rank test against FREVO's mean, taken as known."""
    return float(stats.wilcoxon(values - mean).pvalue)


def _welch(values: NDArray[np.float64], quoted: Quoted) -> float:
    """Return p of Welch's t-test against FREVO's mean, with a deviation guessed from its range."""
    n = len(values)
    own = float(values.mean()), float(values.std(ddof=1))
    found = stats.ttest_ind_from_stats(*own, n, quoted.mean, quoted.deviation, 10, equal_var=False)
    return float(found.pvalue)


def main() -> None:
    """Print the table."""
    field, *folders = sys.argv[1:]
    print("\n".join(columns(rows(FREVO[field], [Path(folder) for folder in folders]))))


if __name__ == "__main__":
    main()

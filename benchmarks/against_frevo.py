"""Our methods against FREVO's table, at equal numbers of evaluations.

`python -m benchmarks.against_frevo runs PICTURE` prints the tables and draws the picture of
docs/studies/frevo-comparison.md. The runs are those of the sweeps experiments/frevo/*_methods.yaml.
"""

import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from swarmwright import compare
from swarmwright.analysis.significance import difference, holm
from swarmwright.analysis.table import number
from swarmwright.common.formatting import format_p_value
from swarmwright.display.figures.comparison import spread_points
from swarmwright.display.figures.style import COLORS, PAPER, SOFT, new_figure, save, style_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from swarmwright.analysis.comparison import Group

EVALUATIONS = 11_113
"""FREVO's in 300 generations: 50, then 37 in each."""
_SPAN = 3.078
"""Expected range of ten normal values, in standard deviations (Tippett 1925)."""


@dataclass(frozen=True)
class Quoted:
    """Best fitness of FREVO's ten runs, from tests/data/frevo/README.md; the ten values are not known."""

    title: str
    mean: float
    worst: float
    best: float

    @property
    def deviation(self) -> float:
        """Standard deviation, estimated from the range."""
        return (self.best - self.worst) / _SPAN


FREVO = {
    "random": Quoted("Ten random fields, 10 agents", -42.2, -53.5, -29.6),
    "stadium": Quoted("Stadium, 72 agents", 0.46, 0.32, 0.54),
}
HEAD = (
    "method", "mean", "worst", "best", "t", "Wilcoxon", "Wilcoxon (Holm)", "Welch", "against nnga", "A12",
)  # fmt: skip


@dataclass(frozen=True)
class Row:
    """A method's best fitness after EVALUATIONS, (runs,)."""

    name: str
    values: NDArray[np.float64]


def rows(folder: Path) -> list[Row]:
    """Return every method of a sweep, the best mean first."""
    groups = compare(sorted(one for one in folder.iterdir() if one.is_dir()), at=EVALUATIONS).groups
    kinds = [_kind(one) for one in groups]
    named = [
        Row(_name(one) if kinds.count(kind) > 1 else kind, one.final)
        for one, kind in zip(groups, kinds, strict=True)
    ]
    return sorted(named, key=lambda row: -float(row.values.mean()))


def _kind(one: "Group") -> str:
    kind: str = one.runs[0].experiment.to_mapping()["method"]["kind"]
    return kind


def _name(one: "Group") -> str:
    return f"{_kind(one)}, population {one.differs['method.population']}"


def table(quoted: Quoted, found: list[Row]) -> list[str]:
    """Return a table in Markdown. p-values are two-sided."""
    own = next((row.values for row in found if row.name == "nnga"), None)
    corrected = holm([_wilcoxon(row.values, quoted) for row in found])
    lines = [HEAD, ["---"] * len(HEAD)]
    known = [f"{value:g}" for value in (quoted.mean, quoted.worst, quoted.best)]
    lines.append(["FREVO's NNGA", *known, *[""] * 6])
    for row, p_holm in zip(found, corrected, strict=True):
        values = row.values
        span = [number(float(one)) for one in (values.mean(), values.min(), values.max())]
        tests = [_t(values, quoted), _wilcoxon(values, quoted), p_holm, _welch(values, quoted)]
        against = ["", ""]
        if own is not None and row.name != "nnga":
            pair = difference(values, own)
            against = [format_p_value(pair.p), f"{pair.effect:.2f}"]
        lines.append(
            [row.name, *span, *(format_p_value(p) if math.isfinite(p) else "" for p in tests), *against]
        )
    return [f"| {' | '.join(line)} |" for line in lines]


def _t(values: NDArray[np.float64], quoted: Quoted) -> float:
    """One-sample t-test against FREVO's mean, taken as known; NaN where all values are the same."""
    if np.ptp(values) < 1e-9 * abs(values[0]):
        return math.nan
    return float(stats.ttest_1samp(values, quoted.mean).pvalue)


def _wilcoxon(values: NDArray[np.float64], quoted: Quoted) -> float:
    """Wilcoxon's signed-rank test against FREVO's mean, taken as known."""
    return float(stats.wilcoxon(values - quoted.mean).pvalue)


def _welch(values: NDArray[np.float64], quoted: Quoted) -> float:
    """Welch's t-test against ten values with FREVO's mean and the deviation guessed from its range.

    NaN where all values are the same.
    """
    if np.ptp(values) < 1e-9 * abs(values[0]):
        return math.nan
    own = float(values.mean()), float(values.std(ddof=1)), len(values)
    found = stats.ttest_ind_from_stats(*own, quoted.mean, quoted.deviation, 10, equal_var=False)
    return float(found.pvalue)


def draw(axes: "Axes", quoted: Quoted, found: list[Row]) -> None:
    """Draw each run as a point, FREVO's mean as a line, its range as a band; what is far below is named."""
    reach = quoted.best - quoted.worst
    left = quoted.worst - 1.2 * reach
    axes.axvspan(quoted.worst, quoted.best, color=SOFT, alpha=0.13, linewidth=0)
    axes.axvline(quoted.mean, color=SOFT, linewidth=1.6)
    for place, row in enumerate(found):
        color = COLORS[0] if row.values.mean() >= quoted.mean else COLORS[1]
        seen = row.values[row.values >= left]
        if len(seen):
            axes.plot(
                seen, place + spread_points(seen), "o", markersize=6, color=color, alpha=0.75,
                markeredgecolor=PAPER, markeredgewidth=0.7,
            )  # fmt: skip
        hidden = len(row.values) - len(seen)
        if hidden:
            text = f"◀ {hidden} of {len(row.values)} below, the worst at {number(float(row.values.min()))}"
            axes.text(left, place + (0.32 if len(seen) else 0.0), text, fontsize=8.5, color=SOFT, va="center")
        if row.values.mean() >= left:
            axes.plot(row.values.mean(), place, "|", markersize=22, markeredgewidth=2.4, color=color)
    best = max(quoted.best, *(float(row.values.max()) for row in found))
    axes.set_xlim(left, best + 0.06 * (best - left))
    axes.set_ylim(len(found) - 0.4, -0.6)
    axes.set_yticks(range(len(found)), [row.name for row in found])
    style_axes(axes, x=f"best fitness after {EVALUATIONS:,} evaluations (more is better)")
    axes.grid(visible=False, axis="y")
    axes.set_title(quoted.title, loc="left", fontsize=12, fontweight="bold")


def main() -> None:
    """Print the tables and draw the picture."""
    runs, picture = map(Path, sys.argv[1:])
    figure = new_figure(13, 5.2)
    for axes, (field, quoted) in zip(figure.subplots(1, 2), FREVO.items(), strict=True):
        found = rows(runs / f"{field}_methods")
        print("\n".join([f"{quoted.title}:", "", *table(quoted, found), ""]))
        draw(axes, quoted, found)
    figure.suptitle(
        "points: runs · coloured line: their mean, blue: at least FREVO's, orange: below it · "
        "grey line and band: FREVO's NNGA, mean and range of ten runs",
        x=0.012, ha="left", fontsize=10, color=SOFT,
    )  # fmt: skip
    print(f"The picture is in {save(figure, picture)}")


if __name__ == "__main__":
    main()

"""The figure of a transfer: fitness in each target over fitness in the run's simulation."""

import textwrap
from typing import TYPE_CHECKING, Any

from swarmwright.common.formatting import format_count
from swarmwright.common.values import sort_key
from swarmwright.display.figures.style import (
    INK,
    SOFT,
    draw_title,
    group_style,
    new_figure,
    scale_points,
    style_axes,
    use_style_fonts,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from swarmwright.analysis.transfer.result import Transfer
    from swarmwright.runs.transfer.transferred import Transferred

_LABEL = 34
"""Longest line of the legend, in characters."""
_BEST, _OTHER = 7, 4
"""Marker size in points of the best candidate of a run, and of the others."""


@use_style_fonts()
def draw(transfer: "Transfer") -> "Figure":
    """Return the figure: axes for each target, a point for each candidate, with 95 % intervals."""
    count = len(transfer.targets)
    # Colours do not depend on the order of the runs.
    keys = {key for group in transfer.groups for key in group.differs}
    groups = sorted(transfer.groups, key=lambda group: sort_key(group.differs, keys))
    labels = [
        textwrap.wrap(f"{group.label} ({format_count(len(group.runs), 'run')})", _LABEL) for group in groups
    ]
    if any(
        candidate.generation is None for transferred in transfer.runs for candidate in transferred.candidates
    ):
        labels.append(["random controllers"])
    signs = _legend_signs(transfer)
    labels += [[name] for name, _ in signs]
    # The legend has two columns, filled one after the other; axes keep their size.
    first = (len(labels) + 1) // 2
    lines = max(sum(map(len, column)) for column in (labels[:first], labels[first:]))
    figure = new_figure(1.0 + 4.6 * count, 5.5 + 0.2 * lines)
    fields = figure.subplots(1, count, squeeze=False)[0]
    group_of = {str(run.path): index for index, group in enumerate(groups) for run in group.runs}
    subjects = sorted({transferred.run.experiment.subject for transferred in transfer.runs})
    for axes, target in zip(fields, transfer.targets, strict=True):
        for transferred in transfer.runs:
            if transferred.target == target:
                _draw_points(axes, transferred, group_of[str(transferred.run.path)])
        low, high = (
            min(axes.get_xlim()[0], axes.get_ylim()[0]), max(axes.get_xlim()[1], axes.get_ylim()[1])
        )  # fmt: skip
        axes.plot([low, high], [low, high], color=SOFT, linewidth=scale_points(1), linestyle=":", zorder=1)
        axes.set_xlim(low, high)
        axes.set_ylim(low, high)
        axes.set_aspect("equal")
        axes.locator_params(nbins=6)
        style_axes(axes, x=f"fitness in {', '.join(subjects)}", y=f"fitness in {target}")
        axes.set_title("dotted: equal fitness", loc="left", fontsize=scale_points(10), color=SOFT)
    handles = []
    for index, label in enumerate(labels[: len(labels) - len(signs)]):
        random = index == len(groups)
        color = SOFT if random else group_style(index)[0]
        inside = "none" if random else color
        line = fields[0].plot([], [], "o", color=color, markerfacecolor=inside, label="\n".join(label))
        handles += line
    handles += [fields[0].errorbar([], [], label=name, **style) for name, style in signs]
    legend = figure.legend(
        handles=handles,
        loc="outside lower left",
        ncols=2,
        fontsize=scale_points(10),
        frameon=False,
        labelcolor=INK,
    )
    for text in legend.get_texts():
        text.set_parse_math(False)
    count = len({str(transferred.run.path) for transferred in transfer.runs})
    draw_title(figure, f"{format_count(count, 'run')}: transfer from {', '.join(subjects)}")
    return figure


def _legend_signs(transfer: "Transfer") -> list[tuple[str, dict[str, Any]]]:
    """Return the legend entries of marker sizes and intervals, with their styles."""
    plain: dict[str, Any] = {"color": SOFT, "fmt": "o"}
    signs: list[tuple[str, dict[str, Any]]] = []
    if any(len(run.candidates) > 1 for run in transfer.runs):
        signs = [
            ("best of the run", {**plain, "markersize": _BEST}),
            ("other candidates of the run", {**plain, "markersize": _OTHER}),
        ]
    fitness = [mean for run in transfer.runs for mean in (*run.source_fitness, *run.target_fitness)]
    if any(mean.low is not None for mean in fitness):
        bars = {"fmt": "none", "ecolor": SOFT, "elinewidth": scale_points(0.8), "xerr": [], "yerr": []}
        signs.append(("95 % interval of the mean", bars))
    return signs


def _draw_points(axes: "Axes", transferred: "Transferred", group: int) -> None:
    color, _ = group_style(group)
    for index, (candidate, source, target) in enumerate(
        zip(transferred.candidates, transferred.source_fitness, transferred.target_fitness, strict=True)
    ):
        random = candidate.generation is None
        across, up = (0.0 if mean.low is None else mean.mean - mean.low for mean in (source, target))
        axes.errorbar(
            source.mean, target.mean, up, across, fmt="o",
            markersize=_BEST if index == 0 else _OTHER, color=SOFT if random else color,
            markerfacecolor="none" if random else color, alpha=0.9 if index == 0 else 0.6,
            linewidth=scale_points(0.8), zorder=3 if index == 0 else 2,
        )  # fmt: skip

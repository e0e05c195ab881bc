"""The style of figures of runs, and writing them to files."""

import io
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from swarmwright.core.errors import InputError
from swarmwright.core.files import write_whole
from swarmwright.core.formatting import shortened
from swarmwright.core.html import png_of
from swarmwright.core.plain_figures import plain, warning_of_letters
from swarmwright.core.untrusted import one_line
from swarmwright.figures.cut import Values, cut

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK, SOFT, PAPER, GRID, EDGE = "#22303c", "#5b6875", "#ffffff", "#e3e7eb", "#9aa5b1"
# Okabe and Ito's palette, safe for colour-blind readers; yellow, too light for lines, comes last.
COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#B8A900")
DASHES = ("-", "--", ":", "-.")
AXES = {"evaluations": "evaluations", "generations": "generation (from 0)"}
"""What an axis over these is called."""
LARGEST = 1e300
"""Greater values are drawn as this one."""
_TITLE_CHARACTERS = 8.2
"""Of a title in an inch, about."""
ENDINGS = (".png", ".svg", ".pdf")


def look(index: int) -> tuple[str, str]:
    """Return colour and line style of group number `index`; other dashes when the colours are used up."""
    return COLORS[index % len(COLORS)], DASHES[index // len(COLORS) % len(DASHES)]


def new_figure(width: float, height: float) -> "Figure":
    """Return a figure of inches, with a separate canvas: no global state, no display."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure = _shown()(figsize=(width, height), dpi=120, facecolor=PAPER, layout="constrained")
    FigureCanvasAgg(figure)
    engine = figure.get_layout_engine()
    assert engine is not None
    engine.set(h_pad=0.09, w_pad=0.09)  # type: ignore[call-arg] # inches; options differ between engines
    return figure


@cache
def _shown() -> "type[Figure]":
    """Return the class of figures that a notebook shows, whatever is set up there for pyplot's."""
    from matplotlib.figure import Figure

    class ShownFigure(Figure):
        def _repr_png_(self) -> bytes:
            return png_of(self)

        @plain()
        def savefig(self, *arguments: Any, **options: Any) -> None:  # noqa: ANN401 - as the library's
            super().savefig(*arguments, **options)

    return ShownFigure


def drawable(values: "Values") -> "Values":
    """Return values as Matplotlib can draw them: it computes with their differences, which must be finite."""
    return np.clip(values, -LARGEST, LARGEST)


def entitle(figure: "Figure", text: str) -> None:
    """Write a title above all axes; what does not fit into one line is cut."""
    figure.suptitle(
        shortened(one_line(text), round(_TITLE_CHARACTERS * figure.get_figwidth())),
        x=0.012, ha="left", fontsize=14, fontweight="bold", color=INK, parse_math=False,
    )  # fmt: skip


def dress(axes: "Axes", *, x: str = "", y: str = "") -> None:
    """Give axes their labels, grid and frame."""
    axes.set_xlabel(x, fontsize=11, color=INK)
    axes.set_ylabel(y, fontsize=11, color=INK)
    axes.tick_params(labelsize=10, colors=INK)
    axes.grid(color=GRID, linewidth=0.8)
    axes.set_axisbelow(True)
    for axis in (axes.xaxis, axes.yaxis):
        without_offset(axis)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_color(EDGE)


def without_offset(axis: Any) -> None:  # noqa: ANN401 - an axis of matplotlib
    """Write numbers with as many digits as it takes, not their differences from another number."""
    from matplotlib.ticker import ScalarFormatter

    if isinstance(form := axis.get_major_formatter(), ScalarFormatter):
        form.set_useOffset(False)


def zoom(
    axes: "Axes", curves: Sequence[tuple[Values, Values, Values]], *, outside: str | None = None
) -> None:
    """Cut off first values that dominate the axis, and label the cut; see `swarmwright.figures.cut.cut`.

    outside: what else does not fit on the axis, in words.
    """
    hidden = cut(curves)
    if hidden is not None:
        axes.set_ylim(hidden.low, hidden.high)
    notes = [words for words in (None if hidden is None else hidden.note, outside) if words]
    if not notes:
        return
    note = axes.text(
        0.988, 0.02, "\n".join(notes), transform=axes.transAxes, fontsize=10, color=SOFT, ha="right",
        va="bottom", bbox={"facecolor": PAPER, "edgecolor": "none", "alpha": 0.8, "pad": 1.5}, zorder=6,
    )  # fmt: skip
    note.set_in_layout(False)


def whole_ticks(axis: Any, places: "Values") -> None:  # noqa: ANN401 - an axis of matplotlib
    """Write whole numbers with a separator, 10,000; of a single place, (1,), that alone."""
    from matplotlib.ticker import FuncFormatter, MaxNLocator

    axis.set_major_locator(MaxNLocator(nbins=6, integer=True, min_n_ticks=1))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.0f}"))
    if len(places) == 1:
        axis.set_ticks(places)


def check(path: Path) -> None:
    """Raise InputError unless a figure can be written there."""
    if path.suffix.lower() not in ENDINGS:
        raise InputError(f"{path}: figures end with {', '.join(ENDINGS[:-1])} or {ENDINGS[-1]}")
    if not path.parent.is_dir():
        raise InputError(f"{path}: there is no folder '{path.parent}'; create it first")


@plain()
def save(figure: "Figure", path: Path) -> Path:
    """Write a figure by the ending of its file; return the path.

    Raises InputError for another ending or a file that cannot be written.
    """
    check(path)
    buffer = io.BytesIO()
    kind = path.suffix.lower()[1:]
    # Without a date, the same figure is the same file.
    date = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(kind)
    with warning_of_letters():
        figure.savefig(buffer, format=kind, metadata=date)
    try:
        write_whole(path, buffer.getvalue())
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from error
    return path

"""The style of figures of runs, and writing them to files."""

import io
import math
import textwrap
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from swarmwright.common.errors import InputError
from swarmwright.common.files import write_whole
from swarmwright.common.formatting import shortened
from swarmwright.common.html import png_of
from swarmwright.common.plain_figures import plain, warning_of_letters
from swarmwright.common.untrusted import one_line
from swarmwright.common.warn_once import warn_once
from swarmwright.display.figures.cut import Values, cut
from swarmwright.display.figures.publishers import Style, current

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
_LEAST_HEIGHT = 0.75
"""Least height of a figure on a page, as a share of that on screens with texts of the same size."""
_LETTER_INCHES, _MARK_INCHES = 0.085, 0.5
"""Inches of a legend on screens: a letter, a mark with its margin; about."""
_AXIS_INCHES = 0.9
"""Inches beside axes on screens, for labels and numbers of the vertical one."""
ENDINGS = (".png", ".svg", ".pdf")


def look(index: int) -> tuple[str, str]:
    """Return colour and line style of group number `index`; other dashes when the colours are used up."""
    return COLORS[index % len(COLORS)], DASHES[index // len(COLORS) % len(DASHES)]


def points(size: float) -> float:
    """Return the size of texts, lines and marks that is `size` on screens, in the present style."""
    return size * current().scale


@contextmanager
def styled() -> Iterator[None]:
    """Within the block, or the function that this decorates, texts have the fonts of the present style."""
    with plain():  # imports Matplotlib, also with an unknown MPLBACKEND
        from matplotlib import rc_context, rcParams

        families = _installed(current().style)
        with rc_context({"font.family": [*families, *rcParams["font.family"]]}):
            yield


def _installed(style: Style) -> list[str]:
    """Return the fonts of a style that can be embedded; where none but the last is there, this is said."""
    from matplotlib.font_manager import fontManager

    # Others than TrueType are not embedded in full by Matplotlib.
    there = {font.name for font in fontManager.ttflist if font.fname.lower().endswith((".ttf", ".ttc"))}
    found = [name for name in style.families if name in there]
    if style.families and found == [style.families[-1]]:
        *wanted, instead = style.families
        warn_once(
            f"none of the fonts {', '.join(wanted)} is installed as TrueType; {instead}, which comes with "
            "Matplotlib, is used in their place"
        )
    return found


def fitting_columns(entries: Sequence[str], most: int) -> int:
    """Return in how many columns a legend fits into the width of the page.

    entries: its texts, which may have several lines. most: columns.
    """
    width = current().width or math.inf
    needed = [points(max(map(len, one.split("\n"))) * _LETTER_INCHES + _MARK_INCHES) for one in entries]
    for columns in range(min(most, len(entries)), 1, -1):
        if sum(float(max(part)) for part in np.array_split(needed, columns)) <= width:
            return columns
    return 1


def above_axes(words: str) -> str:
    """Return what stands above axes that are as wide as the page, in lines that fit."""
    width = current().width
    if width is None:
        return words
    return textwrap.fill(words, max(int((width - points(_AXIS_INCHES)) / points(_LETTER_INCHES)), 1))


def new_figure(width: float, height: float) -> "Figure":
    """Return a figure of inches, with a separate canvas: no global state, no display.

    On a page of another width, its height follows; with texts that are larger in comparison, it is higher.
    """
    page = current()
    if page.width is not None:
        height *= max(page.width / width, _LEAST_HEIGHT * page.scale)
        width = page.width
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure = _shown()(
        figsize=(width, height), dpi=page.style.pixels_per_inch, facecolor=PAPER, layout="constrained"
    )
    FigureCanvasAgg(figure)
    engine = figure.get_layout_engine()
    assert engine is not None
    engine.set(h_pad=points(0.09), w_pad=points(0.09))  # type: ignore[call-arg] # inches; options differ between engines
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
    """Write a title above all axes, if the page has one; what does not fit into one line is cut."""
    heading = current().heading(text)
    if not heading:
        return
    figure.suptitle(
        shortened(one_line(heading), round(_TITLE_CHARACTERS * figure.get_figwidth() / current().scale)),
        x=0.012, ha="left", fontsize=points(14), fontweight="bold", color=INK, parse_math=False,
    )  # fmt: skip


def dress(axes: "Axes", *, x: str = "", y: str = "") -> None:
    """Give axes their labels, grid and frame."""
    axes.set_xlabel(x, fontsize=points(11), color=INK)
    axes.set_ylabel(y, fontsize=points(11), color=INK)
    for axis in (axes.xaxis, axes.yaxis):
        axis.label.set_parse_math(False)  # names and units of others' simulations are plain text
    axes.tick_params(labelsize=points(10), colors=INK)
    axes.grid(color=GRID, linewidth=points(0.8))
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
    """Cut off first values that dominate the axis, and label the cut; see `cut.cut`.

    outside: what else does not fit on the axis, in words.
    """
    hidden = cut(curves)
    if hidden is not None:
        axes.set_ylim(hidden.low, hidden.high)
    notes = [words for words in (None if hidden is None else hidden.note, outside) if words]
    if not notes:
        return
    note = axes.text(
        0.988, 0.02, "\n".join(notes), transform=axes.transAxes, fontsize=points(10), color=SOFT, ha="right",
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

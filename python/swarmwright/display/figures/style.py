"""The style of figures of runs, and writing them to files."""

import io
import math
import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.errors import InputError
from swarmwright.common.files import write_whole
from swarmwright.common.formatting import shorten
from swarmwright.common.html import png_of
from swarmwright.common.plain_figures import use_plain_settings, warn_of_missing_letters
from swarmwright.common.problems import format_value
from swarmwright.common.untrusted import escape_line
from swarmwright.common.warn_once import warn_once

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_BEGINNING_SHARE = 0.1
"""Share of the x axis that is a curve's beginning, which may be cut."""
_LARGEST_SPAN_RATIO = 1.5
"""Up to how many times the span of the rest the whole axis is drawn uncut."""
_LARGEST_DROP_RATIO = 2.0
"""Up to how many times the height of a band a line may lie below it, so that an axis has both."""
_FEWEST_POINTS = 8
"""Points of a curve below which nothing is cut."""

Values = NDArray[np.float64]


@dataclass(frozen=True)
class Cut:
    """What an axis leaves out at its lower end."""

    low: float
    """Where the axis begins."""
    high: float
    """Where it ends, with a margin above the greatest value."""
    least: float
    """The least value, below the axis."""

    @property
    def note(self) -> str:
        """What is left out, in words."""
        return _note("the beginning", self.least)


def _note(what: str, least: float) -> str:
    return f"↓ {what} reaches down to {least + 0.0:.4g}".replace("-", "−")


def far_below(x: Values, low: Values, high: Values, line: Values) -> str | None:
    """Return in words how far a line lies below a band, where the band would be squashed if an axis had both.

    None where it is near, or where only its first tenth is so low, which `cut` leaves out.

    x: ascending, (points,), like all others. low: of the band. high: of the band. line: what is tested.
    """
    known = np.isfinite(low) & np.isfinite(high) & np.isfinite(line)
    if not known.any():
        return None
    later = known & (x >= x[known][0] + _BEGINNING_SHARE * (x[known][-1] - x[known][0]))
    least, bottom, top = float(line[later].min()), float(low[later].min()), float(high[later].max())
    span = top / _LARGEST_SPAN_RATIO - bottom / _LARGEST_SPAN_RATIO  # neither overflows
    below = bottom / _LARGEST_SPAN_RATIO - least / _LARGEST_SPAN_RATIO
    if span <= 0 or below <= _LARGEST_DROP_RATIO * span:
        return None
    return _note("the mean", float(line[known].min()))


def cut(curves: Sequence[tuple[Values, Values, Values]]) -> Cut | None:
    """Return where an axis begins so that first values do not dominate it; None: nothing needs to be cut.

    That is so if all values span more than 1.5 times the range of those after a curve's first tenth.

    curves: of each x, ascending, and the least and the greatest value there, (points,) each.
    """
    lows, highs, leasts = [], [], []
    for x, bottom, top in curves:
        known = np.isfinite(bottom) & np.isfinite(top)
        if np.count_nonzero(known) < _FEWEST_POINTS:
            return None
        later = known & (x >= x[known][0] + _BEGINNING_SHARE * (x[known][-1] - x[known][0]))
        lows.append(float(bottom[later].min()))
        highs.append(float(top[later].max()))
        leasts.append(float(bottom[known].min()))
    if not lows:
        return None
    low, high, least = min(lows), max(highs), min(leasts)
    span = high / _LARGEST_SPAN_RATIO - low / _LARGEST_SPAN_RATIO  # neither overflows
    if span <= 0 or (high / _LARGEST_SPAN_RATIO - least / _LARGEST_SPAN_RATIO) <= _LARGEST_SPAN_RATIO * span:
        return None
    spare = 0.1 * _LARGEST_SPAN_RATIO * span
    return Cut(low - spare, high + spare, least)


_MM = 1 / 25.4
"""Inches."""
_TIMES = ("Times New Roman", "Nimbus Roman", "TeX Gyre Termes", "Liberation Serif", "STIXGeneral")
_HELVETICA = ("Helvetica", "Arial", "Nimbus Sans", "TeX Gyre Heros", "Liberation Sans", "DejaVu Sans")
_LIBERTINE = ("Linux Libertine O", "Libertinus Serif", *_TIMES)
_SCREEN_POINTS = 11.0
"""Size of labels of axes on screens, to which those of other texts and lines are relative."""
_SCREEN_DPI, _PRINT_DPI = 120, 300
"""Pixels per inch on screens, and on paper, where publishers ask for at least so many."""
_NARROW_INCHES = 5.0
"""Width of a figure below which axes that are side by side elsewhere are one below the other."""
_LIMITS_INCHES = (1.0, 40.0)
"""Least and greatest width of a figure."""
_WIDTH = re.compile(r"(\d+(?:\.\d+)?) ?(in|mm|cm|pt)")
_UNITS = {"in": 1.0, "mm": _MM, "cm": 10 * _MM, "pt": 1 / 72.27}
"""Inches of each; a point is TeX's, in which \\columnwidth is told."""


@dataclass(frozen=True)
class Style:
    """How figures look."""

    description: str
    column: float | None = None
    """Inches of a column; None: as wide as the figure needs."""
    page: float | None = None
    """Inches of both columns."""
    points: float = _SCREEN_POINTS
    """Size of labels of axes."""
    families: tuple[str, ...] = ()
    """Fonts, of which the first one that is installed is used; empty: Matplotlib's own."""
    titled: bool = True
    """Whether figures have a title; in papers the caption has it."""

    @property
    def pixels_per_inch(self) -> int:
        """Of PNG files."""
        return _SCREEN_DPI if self.column is None else _PRINT_DPI


STYLES: Mapping[str, Style] = MappingProxyType(
    {
        "screen": Style("for screens and slides: as wide as the figure needs, with a title"),
        "ieee": Style("IEEE: 3.5 in and 7.16 in, 8 pt Times", 3.5, 7.16, 8.0, _TIMES, titled=False),
        "nature": Style(
            "Nature: 89 mm and 183 mm, 7 pt Helvetica", 89 * _MM, 183 * _MM, 7.0, _HELVETICA, titled=False
        ),
        "science": Style(
            "Science: 57 mm and 184 mm, 7 pt Helvetica", 57 * _MM, 184 * _MM, 7.0, _HELVETICA, titled=False
        ),
        "acm": Style("ACM: 3.33 in and 7 in, 8 pt Libertine", 3.33, 7.0, 8.0, _LIBERTINE, titled=False),
        "elsevier": Style(
            "Elsevier: 90 mm and 190 mm, 8 pt Helvetica", 90 * _MM, 190 * _MM, 8.0, _HELVETICA, titled=False
        ),
        "springer": Style(
            "Springer: 84 mm and 174 mm, 8 pt Helvetica", 84 * _MM, 174 * _MM, 8.0, _HELVETICA, titled=False
        ),
    }
)
"""The built-in styles."""


@dataclass(frozen=True)
class Page:
    """What a figure is drawn for."""

    style: Style = STYLES["screen"]
    width: float | None = None
    """Inches; None: as wide as the figure needs."""
    title: str | None = None
    """Instead of the figure's own; empty: none. None: the figure's own, where the style has titles."""

    @property
    def scale(self) -> float:
        """Size of texts, relative to that on screens."""
        return self.style.points / _SCREEN_POINTS

    @property
    def narrow(self) -> bool:
        """Whether axes have no room beside each other."""
        return self.width is not None and self.width < _NARROW_INCHES

    def heading(self, own: str) -> str:
        """Return the title of a figure; empty for none. own: that it has by itself."""
        if self.title is not None:
            return self.title
        return own if self.style.titled else ""

    @classmethod
    def of(cls, style: str = "screen", width: str | float | None = None, title: str | None = None) -> "Page":
        """Return what the options of figures ask for.

        Args:
            style: name of a style.
            width: "column" or "page" of the style, inches, or a length such as "89 mm".
            title: instead of the figure's own; empty: none.

        Raises InputError for another style or width.
        """
        if style not in STYLES:
            raise InputError(f"style: must be one of {', '.join(STYLES)}, not {format_value(style)}")
        chosen = STYLES[style]
        return cls(chosen, _inches(width, style, chosen), title)


def _inches(width: str | float | None, name: str, style: Style) -> float | None:
    if width is None or width == "column":
        if width is not None and style.column is None:
            raise _no_columns(name)
        return style.column
    if width == "page":
        if style.page is None:
            raise _no_columns(name)
        return style.page
    found = _WIDTH.fullmatch(width) if isinstance(width, str) else None
    inches = float(found[1]) * _UNITS[found[2]] if found else width
    if isinstance(inches, str):
        try:
            inches = float(inches)
        except ValueError:
            raise InputError(
                "width: must be column, page, a number of inches, or a length such as 89 mm, not "
                f"{format_value(width)}"
            ) from None
    low, high = _LIMITS_INCHES
    if not low <= inches <= high:
        raise InputError(f"width: must be from {low:g} to {high:g} inches, not {inches:.4g}")
    return inches


def _no_columns(name: str) -> InputError:
    return InputError(
        f"width: the style {name} has no columns; give inches, or a style such as ieee, whose columns it has"
    )


_SCREEN = Page()
_current: ContextVar[Page] = ContextVar("page", default=_SCREEN)


def current() -> Page:
    """Return what figures are drawn for at the moment."""
    return _current.get()


@contextmanager
def on(page: Page) -> Iterator[None]:
    """Within the block, figures are drawn for a page."""
    token = _current.set(page)
    try:
        yield
    finally:
        _current.reset(token)


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
    with use_plain_settings():  # imports Matplotlib, also with an unknown MPLBACKEND
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
    needed = [points(max(map(len, entry.split("\n"))) * _LETTER_INCHES + _MARK_INCHES) for entry in entries]
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

        @use_plain_settings()
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
        shorten(escape_line(heading), round(_TITLE_CHARACTERS * figure.get_figwidth() / current().scale)),
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


@use_plain_settings()
def save(figure: "Figure", path: Path) -> Path:
    """Write a figure by the ending of its file; return the path.

    Raises InputError for another ending or a file that cannot be written.
    """
    check(path)
    buffer = io.BytesIO()
    kind = path.suffix.lower()[1:]
    # Without a date, the same figure is the same file.
    date = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(kind)
    with warn_of_missing_letters():
        figure.savefig(buffer, format=kind, metadata=date)
    try:
        write_whole(path, buffer.getvalue())
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from error
    return path

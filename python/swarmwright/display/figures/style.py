"""Style of figures of runs, and saving of figures."""

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
"""Share of the x axis that counts as a curve's beginning, which may be cut."""
_LARGEST_SPAN_RATIO = 1.5
"""Largest ratio of the whole span to the span without the beginning that is drawn uncut."""
_LARGEST_DROP_RATIO = 2.0
"""Largest distance of a line below a band, relative to its height, to show both on one axis."""
_FEWEST_POINTS = 8
"""Fewest points of a curve that may be cut."""

Values = NDArray[np.float64]


@dataclass(frozen=True)
class Cut:
    """The cut of an axis at its lower end."""

    low: float
    """Lower limit of the axis."""
    high: float
    """Upper limit, with a margin above the largest value."""
    least: float
    """Smallest value, below the axis."""

    @property
    def note(self) -> str:
        """Description of the cut."""
        return _note("the beginning", self.least)


def _note(subject: str, least: float) -> str:
    return f"↓ {subject} reaches down to {least + 0.0:.4g}".replace("-", "−")


def describe_far_below(x: Values, low: Values, high: Values, line: Values) -> str | None:
    """Describe a line that is too far below a band to show both on one axis.

    None if it is close enough, or if only its first tenth is so low, which `cut` omits.

    x: ascending, (points,), like all others. low, high: limits of the band. line: the tested line.
    """
    finite = np.isfinite(low) & np.isfinite(high) & np.isfinite(line)
    if not finite.any():
        return None
    later = finite & (x >= x[finite][0] + _BEGINNING_SHARE * (x[finite][-1] - x[finite][0]))
    least, bottom, top = float(line[later].min()), float(low[later].min()), float(high[later].max())
    span = top / _LARGEST_SPAN_RATIO - bottom / _LARGEST_SPAN_RATIO  # neither overflows
    below = bottom / _LARGEST_SPAN_RATIO - least / _LARGEST_SPAN_RATIO
    if span <= 0 or below <= _LARGEST_DROP_RATIO * span:
        return None
    return _note("the mean", float(line[finite].min()))


def cut(curves: Sequence[tuple[Values, Values, Values]]) -> Cut | None:
    """Return the cut of an axis dominated by first values; None if no cut is needed.

    An axis is cut if all values span more than 1.5 times the range of those after a curve's first tenth.

    curves: ascending x, and the smallest and largest value at each x, (points,) each.
    """
    lows, highs, leasts = [], [], []
    for x, bottom, top in curves:
        finite = np.isfinite(bottom) & np.isfinite(top)
        if np.count_nonzero(finite) < _FEWEST_POINTS:
            return None
        later = finite & (x >= x[finite][0] + _BEGINNING_SHARE * (x[finite][-1] - x[finite][0]))
        lows.append(float(bottom[later].min()))
        highs.append(float(top[later].max()))
        leasts.append(float(bottom[finite].min()))
    if not lows:
        return None
    low, high, least = min(lows), max(highs), min(leasts)
    span = high / _LARGEST_SPAN_RATIO - low / _LARGEST_SPAN_RATIO  # neither overflows
    if span <= 0 or (high / _LARGEST_SPAN_RATIO - least / _LARGEST_SPAN_RATIO) <= _LARGEST_SPAN_RATIO * span:
        return None
    spare = 0.1 * _LARGEST_SPAN_RATIO * span
    return Cut(low - spare, high + spare, least)


_MM = 1 / 25.4
"""A millimetre in inches."""
_TIMES = ("Times New Roman", "Nimbus Roman", "TeX Gyre Termes", "Liberation Serif", "STIXGeneral")
_HELVETICA = ("Helvetica", "Arial", "Nimbus Sans", "TeX Gyre Heros", "Liberation Sans", "DejaVu Sans")
_LIBERTINE = ("Linux Libertine O", "Libertinus Serif", *_TIMES)
_SCREEN_POINTS = 11.0
"""Font size of axis labels on screens; other sizes are relative to it."""
_SCREEN_DPI, _PRINT_DPI = 120, 300
"""Pixels per inch on screens, and in print, as publishers require."""
_NARROW_INCHES = 5.0
"""Width of a figure below which axes are stacked instead of side by side."""
_LIMITS_INCHES = (1.0, 40.0)
"""Smallest and largest width of a figure, in inches."""
_WIDTH = re.compile(r"(\d+(?:\.\d+)?) ?(in|mm|cm|pt)")
_UNITS = {"in": 1.0, "mm": _MM, "cm": 10 * _MM, "pt": 1 / 72.27}
"""Length of each unit in inches; a point is TeX's, the unit of \\columnwidth."""


@dataclass(frozen=True)
class Style:
    """A style of figures."""

    description: str
    column: float | None = None
    """Width of a column in inches; None: as wide as the figure needs."""
    page: float | None = None
    """Width of both columns, in inches."""
    points: float = _SCREEN_POINTS
    """Font size of axis labels."""
    families: tuple[str, ...] = ()
    """Fonts in order of preference; empty: Matplotlib's default."""
    titled: bool = True
    """Whether figures have a title; papers use the caption instead."""

    @property
    def pixels_per_inch(self) -> int:
        """Resolution of PNG files."""
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
    """Style, width and title of a figure."""

    style: Style = STYLES["screen"]
    width: float | None = None
    """Width in inches; None: as wide as the figure needs."""
    title: str | None = None
    """Replaces the default title; empty: no title. None: the default title, if the style has titles."""

    @property
    def scale(self) -> float:
        """Font size relative to screens."""
        return self.style.points / _SCREEN_POINTS

    @property
    def narrow(self) -> bool:
        """Whether axes are stacked because there is no room side by side."""
        return self.width is not None and self.width < _NARROW_INCHES

    def heading(self, default: str) -> str:
        """Return the title of a figure; empty: no title. default: its default title."""
        if self.title is not None:
            return self.title
        return default if self.style.titled else ""

    @classmethod
    def from_options(
        cls, style: str = "screen", width: str | float | None = None, title: str | None = None
    ) -> "Page":
        """Return the page for the options of a figure.

        Args:
            style: name of a style.
            width: "column" or "page" of the style, inches, or a length such as "89 mm".
            title: replaces the default title; empty: no title.

        Raises InputError for an unknown style or an invalid width.
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
    match = _WIDTH.fullmatch(width) if isinstance(width, str) else None
    inches = float(match[1]) * _UNITS[match[2]] if match else width
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
        f"width: the style {name} has no columns; use inches, or a style with columns such as ieee"
    )


_SCREEN = Page()
_current: ContextVar[Page] = ContextVar("page", default=_SCREEN)


def current_page() -> Page:
    """Return the page for which figures are currently drawn."""
    return _current.get()


@contextmanager
def use_page(page: Page) -> Iterator[None]:
    """Draw figures for a page within the block."""
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
"""Labels of axes."""
LARGEST = 1e300
"""Largest drawn value; larger values are clipped to it."""
_TITLE_CHARACTERS = 8.2
"""Approximate characters of a title per inch."""
_LEAST_HEIGHT = 0.75
"""Least height of a figure on a page, relative to screens with the same font size."""
_LETTER_INCHES, _MARK_INCHES = 0.085, 0.5
"""Approximate inches of a letter and of a marker with its margin in a legend on screens."""
_AXIS_INCHES = 0.9
"""Inches beside axes on screens, for labels and numbers of the vertical axis."""
ENDINGS = (".png", ".svg", ".pdf")


def group_style(index: int) -> tuple[str, str]:
    """Return colour and line style of a group; dashes change after all colours."""
    return COLORS[index % len(COLORS)], DASHES[index // len(COLORS) % len(DASHES)]


def scale_points(size: float) -> float:
    """Scale a size of texts, lines and markers from screens to the current style."""
    return size * current_page().scale


@contextmanager
def use_style_fonts() -> Iterator[None]:
    """Use the fonts of the current style within the block, or the decorated function."""
    with use_plain_settings():  # imports Matplotlib, also with an unknown MPLBACKEND
        from matplotlib import rc_context, rcParams

        families = _find_fonts(current_page().style)
        with rc_context({"font.family": [*families, *rcParams["font.family"]]}):
            yield


def _find_fonts(style: Style) -> list[str]:
    """Return the fonts of a style that can be embedded; warn if only the last is available."""
    from matplotlib.font_manager import fontManager

    # Matplotlib fully embeds TrueType fonts only.
    installed = {font.name for font in fontManager.ttflist if font.fname.lower().endswith((".ttf", ".ttc"))}
    available = [name for name in style.families if name in installed]
    if style.families and available == [style.families[-1]]:
        *preferred, fallback = style.families
        warn_once(
            f"none of the fonts {', '.join(preferred)} is installed as TrueType; Matplotlib's {fallback} is "
            "used instead"
        )
    return available


def fit_columns(entries: Sequence[str], most: int) -> int:
    """Return the number of columns of a legend that fits the page.

    entries: its texts, which may have several lines. most: most columns.
    """
    width = current_page().width or math.inf
    needed = [
        scale_points(max(map(len, entry.split("\n"))) * _LETTER_INCHES + _MARK_INCHES) for entry in entries
    ]
    for columns in range(min(most, len(entries)), 1, -1):
        if sum(float(max(part)) for part in np.array_split(needed, columns)) <= width:
            return columns
    return 1


def wrap_above_axes(text: str) -> str:
    """Wrap a text above axes to the width of the page."""
    width = current_page().width
    if width is None:
        return text
    return textwrap.fill(
        text, max(int((width - scale_points(_AXIS_INCHES)) / scale_points(_LETTER_INCHES)), 1)
    )


def new_figure(width: float, height: float) -> "Figure":
    """Return a figure of a size in inches, with its own canvas: no global state, no display.

    On a page of another width, the height is scaled with it, and increased for larger texts.
    """
    page = current_page()
    if page.width is not None:
        height *= max(page.width / width, _LEAST_HEIGHT * page.scale)
        width = page.width
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure = _figure_class()(
        figsize=(width, height), dpi=page.style.pixels_per_inch, facecolor=PAPER, layout="constrained"
    )
    FigureCanvasAgg(figure)
    engine = figure.get_layout_engine()
    assert engine is not None
    engine.set(h_pad=scale_points(0.09), w_pad=scale_points(0.09))  # type: ignore[call-arg] # inches; options differ between engines
    return figure


@cache
def _figure_class() -> "type[Figure]":
    """Return a class of figures that notebooks display independently of pyplot."""
    from matplotlib.figure import Figure

    class ShownFigure(Figure):
        def _repr_png_(self) -> bytes:
            return png_of(self)

        @use_plain_settings()
        def savefig(self, *arguments: Any, **options: Any) -> None:  # noqa: ANN401 - as in Matplotlib
            super().savefig(*arguments, **options)

    return ShownFigure


def clip_drawable(values: "Values") -> "Values":
    """Clip values so that their differences are finite, as Matplotlib requires."""
    return np.clip(values, -LARGEST, LARGEST)


def draw_title(figure: "Figure", text: str) -> None:
    """Draw the title of a figure, if the page has one, shortened to one line."""
    heading = current_page().heading(text)
    if not heading:
        return
    figure.suptitle(
        shorten(
            escape_line(heading), round(_TITLE_CHARACTERS * figure.get_figwidth() / current_page().scale)
        ),
        x=0.012, ha="left", fontsize=scale_points(14), fontweight="bold", color=INK, parse_math=False,
    )  # fmt: skip


def draw_whole_title(figure: "Figure", text: str) -> None:
    """Draw the title of a figure, over several lines if it is long."""
    lines = textwrap.wrap(escape_line(text), round(_TITLE_CHARACTERS * figure.get_figwidth()))
    figure.suptitle(
        "\n".join(lines), x=0.012, ha="left", fontsize=13, fontweight="bold", color=INK, parse_math=False
    )


def style_axes(axes: "Axes", *, x: str = "", y: str = "") -> None:
    """Set labels, grid and frame of axes."""
    axes.set_xlabel(x, fontsize=scale_points(11), color=INK)
    axes.set_ylabel(y, fontsize=scale_points(11), color=INK)
    for axis in (axes.xaxis, axes.yaxis):
        axis.label.set_parse_math(False)  # names and units of simulations are plain text
    axes.tick_params(labelsize=scale_points(10), colors=INK)
    axes.grid(color=GRID, linewidth=scale_points(0.8))
    axes.set_axisbelow(True)
    for axis in (axes.xaxis, axes.yaxis):
        disable_offset(axis)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_color(EDGE)


def disable_offset(axis: Any) -> None:  # noqa: ANN401 - an axis of matplotlib
    """Write numbers in full instead of as differences from an offset."""
    from matplotlib.ticker import ScalarFormatter

    if isinstance(form := axis.get_major_formatter(), ScalarFormatter):
        form.set_useOffset(False)


def cut_axis(
    axes: "Axes", curves: Sequence[tuple[Values, Values, Values]], *, outside: str | None = None
) -> None:
    """Cut off first values that dominate the axis, and label the cut; see `cut`.

    outside: description of other values beyond the axis.
    """
    hidden = cut(curves)
    if hidden is not None:
        axes.set_ylim(hidden.low, hidden.high)
    notes = [words for words in (None if hidden is None else hidden.note, outside) if words]
    if not notes:
        return
    note = axes.text(
        0.988, 0.02, "\n".join(notes), transform=axes.transAxes, fontsize=scale_points(10), color=SOFT,
        ha="right", va="bottom", zorder=6,
        bbox={"facecolor": PAPER, "edgecolor": "none", "alpha": 0.8, "pad": 1.5},
    )  # fmt: skip
    note.set_in_layout(False)


def set_integer_ticks(axis: Any, values: "Values") -> None:  # noqa: ANN401 - an axis of matplotlib
    """Set integer ticks with separators, 10,000; a single tick for a single value."""
    from matplotlib.ticker import FuncFormatter, MaxNLocator

    axis.set_major_locator(MaxNLocator(nbins=6, integer=True, min_n_ticks=1))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.0f}"))
    if len(values) == 1:
        axis.set_ticks(values)


def check_figure_path(path: Path) -> None:
    """Raise InputError unless a figure can be saved to a path."""
    if path.suffix.lower() not in ENDINGS:
        raise InputError(
            f"{path}: unknown suffix of a figure; use {', '.join(ENDINGS[:-1])} or {ENDINGS[-1]}"
        )
    if not path.parent.is_dir():
        raise InputError(f"{path}: the folder '{path.parent}' does not exist; create it first")


@use_plain_settings()
def save(figure: "Figure", path: Path) -> Path:
    """Save a figure in the format of the file suffix; return the path.

    Raises InputError for an unknown suffix or a file that cannot be written.
    """
    check_figure_path(path)
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

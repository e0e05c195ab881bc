"""Styles of figures: widths, fonts and sizes as publishers ask for them."""

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from types import MappingProxyType

from swarmwright.common.errors import InputError
from swarmwright.common.problems import shown

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
            raise InputError(f"style: must be one of {', '.join(STYLES)}, not {shown(style)}")
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
                f"{shown(width)}"
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

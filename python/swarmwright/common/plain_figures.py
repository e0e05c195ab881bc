"""Figures independent of the user's Matplotlib settings."""

import os
import re
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from importlib import import_module
from logging import LogRecord, getLogger
from typing import Any

from swarmwright.common.warn_once import warn_once

_FURTHER_FONTS = (
    "Noto Sans CJK JP",
    "Noto Sans CJK SC",
    "WenQuanYi Zen Hei",
    "WenQuanYi Micro Hei",
    "Source Han Sans",
    "IPAGothic",
    "Droid Sans Fallback",
    "Hiragino Sans",
    "PingFang SC",
    "Apple SD Gothic Neo",
    "Yu Gothic",
    "MS Gothic",
    "Microsoft YaHei",
    "SimHei",
    "Malgun Gothic",
    "NanumGothic",
    "Arial Unicode MS",
    "Noto Sans Devanagari",
    "Noto Sans Thai",
    "Unifont",
)
"""Fonts of common systems with letters that Matplotlib's own fonts lack."""
_MISSING = re.compile(r"Glyph (\d+) .*missing")
_NAMED = 20
"""Largest number of letters in the warning."""
_inside = 0


@contextmanager
def use_plain_settings() -> Iterator[None]:
    """Use Matplotlib's default settings within the block, or the decorated function.

    A matplotlibrc may require LaTeX, which may be missing, and MPLBACKEND may be invalid. Figures are always
    drawn by Agg.
    """
    global _inside  # noqa: PLW0603 - as Matplotlib's settings are
    if _inside:
        yield
        return
    matplotlib = _import_matplotlib()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # deprecated settings
        context = matplotlib.rc_context(_defaults())
        context.__enter__()
    _inside += 1
    try:
        yield
    finally:
        _inside -= 1
        context.__exit__(None, None, None)


def _import_matplotlib() -> Any:  # noqa: ANN401 - a module
    """Import Matplotlib, which would fail with an unknown MPLBACKEND."""
    backend = None if "matplotlib" in sys.modules else os.environ.pop("MPLBACKEND", None)
    try:
        matplotlib = import_module("matplotlib")
    finally:
        if backend is not None:
            os.environ["MPLBACKEND"] = backend
    if backend:
        with suppress(ValueError):  # irrelevant for figures in files
            matplotlib.rcParams["backend"] = backend
    return matplotlib


@cache
def _defaults() -> dict[str, Any]:
    defaults = import_module("matplotlib").rcParamsDefault
    installed = {font.name for font in import_module("matplotlib.font_manager").fontManager.ttflist}
    # Letters that a font lacks come from the next font, possibly in another weight.
    getLogger("matplotlib.font_manager").addFilter(_is_of_interest)
    families = [*defaults["font.family"], *(name for name in _FURTHER_FONTS if name in installed)]
    return {
        **{key: value for key, value in defaults.items() if key != "backend"},
        "font.family": families,
        # Publishers refuse Type 3 fonts, the default: 42 embeds TrueType.
        "pdf.fonttype": 42,
        "ps.fonttype": 42,
        # Without it, ids are random; the same figure should be the same file.
        "svg.hashsalt": "swarmwright",
    }


def _is_of_interest(record: LogRecord) -> bool:
    return not record.getMessage().startswith("findfont: Failed to find font weight")


@contextmanager
def warn_of_missing_letters() -> Iterator[None]:
    """Warn once about letters that are drawn as boxes within the block because no font has them."""
    letters: dict[str, None] = {}
    with warnings.catch_warnings():
        warnings.filterwarnings("always", message=_MISSING.pattern, category=UserWarning)
        show = warnings.showwarning

        def collect(message: Any, *arguments: Any, **more: Any) -> None:  # noqa: ANN401 - as the library's
            if match := _MISSING.match(str(message)):
                letters[chr(int(match[1]))] = None
            else:
                show(message, *arguments, **more)

        warnings.showwarning = collect
        yield
    missing = [letter for letter in letters if letter.isprintable()]
    if missing:
        more = f" and {len(missing) - _NAMED} more" if len(missing) > _NAMED else ""
        warn_once(
            f"no installed font has {' '.join(missing[:_NAMED])}{more}, which are drawn as boxes; install "
            f"for instance {_FURTHER_FONTS[0]}, {_FURTHER_FONTS[1]} or {_FURTHER_FONTS[2]}"
        )

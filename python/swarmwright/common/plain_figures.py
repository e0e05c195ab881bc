"""Figures that do not depend on a user's settings of Matplotlib."""

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
"""Fonts with letters that Matplotlib's own lacks, of common systems."""
_MISSING = re.compile(r"Glyph (\d+) .*missing")
_NAMED = 20
"""Letters that the warning names."""
_inside = 0


@contextmanager
def use_plain_settings() -> Iterator[None]:
    """Within the block, or the function that this decorates, Matplotlib has its default settings.

    A matplotlibrc may ask for LaTeX, which is not installed everywhere, and MPLBACKEND may be wrong: figures
    are drawn by Agg in any case.
    """
    global _inside  # noqa: PLW0603 - as Matplotlib's settings are
    if _inside:
        yield
        return
    matplotlib = _import_matplotlib()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # settings that are out of use
        context = matplotlib.rc_context(_defaults())
        context.__enter__()
    _inside += 1
    try:
        yield
    finally:
        _inside -= 1
        context.__exit__(None, None, None)


def _import_matplotlib() -> Any:  # noqa: ANN401 - a module
    """Import Matplotlib, whose import would fail with an unknown MPLBACKEND."""
    wanted = None if "matplotlib" in sys.modules else os.environ.pop("MPLBACKEND", None)
    try:
        matplotlib = import_module("matplotlib")
    finally:
        if wanted is not None:
            os.environ["MPLBACKEND"] = wanted
    if wanted:
        with suppress(ValueError):  # it does not matter for figures in files
            matplotlib.rcParams["backend"] = wanted
    return matplotlib


@cache
def _defaults() -> dict[str, Any]:
    known = import_module("matplotlib").rcParamsDefault
    installed = {font.name for font in import_module("matplotlib.font_manager").fontManager.ttflist}
    # Letters that the font lacks are taken from the next one that has them, if need be in another weight.
    getLogger("matplotlib.font_manager").addFilter(_is_of_interest)
    families = [*known["font.family"], *(name for name in _FURTHER_FONTS if name in installed)]
    return {
        **{key: value for key, value in known.items() if key != "backend"},
        "font.family": families,
        # Publishers refuse Type 3 fonts, the default: 42 embeds TrueType.
        "pdf.fonttype": 42,
        "ps.fonttype": 42,
        # Otherwise names of parts are drawn at random; the same figure is the same file.
        "svg.hashsalt": "swarmwright",
    }


def _is_of_interest(record: LogRecord) -> bool:
    return not record.getMessage().startswith("findfont: Failed to find font weight")


@contextmanager
def warn_of_missing_letters() -> Iterator[None]:
    """Warn once of the letters that are drawn as boxes within the block, since no font has them."""
    letters: dict[str, None] = {}
    with warnings.catch_warnings():
        warnings.filterwarnings("always", message=_MISSING.pattern, category=UserWarning)
        show = warnings.showwarning

        def collect(message: Any, *arguments: Any, **more: Any) -> None:  # noqa: ANN401 - as the library's
            if found := _MISSING.match(str(message)):
                letters[chr(int(found[1]))] = None
            else:
                show(message, *arguments, **more)

        warnings.showwarning = collect
        yield
    seen = [letter for letter in letters if letter.isprintable()]
    if seen:
        more = f" and {len(seen) - _NAMED} more" if len(seen) > _NAMED else ""
        warn_once(
            f"no font that is installed has {' '.join(seen[:_NAMED])}{more}: boxes are drawn in their place; "
            f"install one of {', '.join(_FURTHER_FONTS[:3])}, for instance"
        )

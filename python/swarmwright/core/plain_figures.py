"""Figures that do not depend on a user's settings of Matplotlib."""

import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from importlib import import_module
from typing import Any

_inside = 0


@contextmanager
def plain() -> Iterator[None]:
    """Within the block, or the function that this decorates, Matplotlib has its default settings.

    A matplotlibrc may ask for LaTeX, which is not installed everywhere, and MPLBACKEND may be wrong: figures
    are drawn by Agg in any case.
    """
    global _inside  # noqa: PLW0603 - as Matplotlib's settings are
    if _inside:
        yield
        return
    matplotlib = _imported()
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


def _imported() -> Any:  # noqa: ANN401 - a module
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
    return {key: value for key, value in known.items() if key != "backend"}

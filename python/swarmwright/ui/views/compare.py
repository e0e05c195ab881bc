"""The comparison of several runs, as by `swarmwright runs compare`."""

from pathlib import Path
from tempfile import TemporaryDirectory

from starlette.requests import Request

from swarmwright import InputError, compare
from swarmwright.ui.index import as_values
from swarmwright.ui.requests import read_optional_integer
from swarmwright.ui.views._base import STATIC, Values, View
from swarmwright.ui.window import Window

MOST_COMPARED = 500


def answer(window: Window, request: Request) -> Values:
    """Return the comparison of several runs: its text, values and figure."""
    names = request.query_params.getlist("run")
    if not 1 <= len(names) <= MOST_COMPARED:
        raise InputError(f"run: choose 1 to {MOST_COMPARED} runs, not {len(names)}")
    paths = [window.index.path(name) for name in names]
    is_held_out = request.query_params.get("held_out") == "true"
    with window.figures:
        comparison = compare(paths, held_out=is_held_out, at=read_optional_integer(request, "at"))
        with TemporaryDirectory() as folder:
            figure = comparison.plot(Path(folder) / "comparison.svg").read_text("utf-8")
    return {"text": str(comparison), "values": as_values(comparison.to_mapping()), "figure": figure}


VIEW = View("compare", STATIC / "compare.js", answers={"compare": answer})

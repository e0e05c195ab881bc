"""The comparison of several runs, as by `swarmwright runs compare`."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from starlette.requests import Request
from starlette.responses import Response

from swarmwright import Comparison, InputError, compare
from swarmwright.analysis.league import play_league
from swarmwright.analysis.table import csv_text, latex_text
from swarmwright.common.time_limit import TimeLimit
from swarmwright.runs.post_evaluation import EvaluationOptions
from swarmwright.ui.index import as_values
from swarmwright.ui.replays import EPISODES, LONGEST_S, MOST_EPISODES, computing
from swarmwright.ui.requests import read_optional_integer, read_whole
from swarmwright.ui.views._base import STATIC, Values, View
from swarmwright.ui.views.progress import is_competition
from swarmwright.ui.views.runs import read_runs
from swarmwright.ui.window import Window

MOST_COMPARED = 500
FIGURES = {"svg": "image/svg+xml", "pdf": "application/pdf", "png": "image/png"}


def compute(window: Window, request: Request) -> Comparison:
    """Return the comparison that a request asks for. Raises InputError for wrong values."""
    query = request.query_params
    names = query.getlist("run")
    if not 1 <= len(names) <= MOST_COMPARED:
        raise InputError(f"run: choose 1 to {MOST_COMPARED} runs, not {len(names)}")
    return compare(
        [window.index.path(name) for name in names],
        held_out=query.get("held_out") == "true",
        unfinished=query.get("unfinished") == "true",
        by=query.get("by") or "fitness",  # type: ignore[arg-type]  # `compare` checks it
        at=read_optional_integer(request, "at"),
        at_episodes=read_optional_integer(request, "at_episodes"),
    )


def draw(comparison: Comparison, request: Request, ending: str) -> bytes:
    """Return the figure as a file of this ending."""
    query = request.query_params
    with TemporaryDirectory() as folder:
        file = comparison.plot(
            Path(folder) / f"comparison.{ending}",
            x=query.get("x") or "evaluations",
            metrics="all" if query.get("metrics") == "true" else None,
            style=query.get("style") or "screen",
            width=query.get("width") or None,
        )
        return file.read_bytes()


def answer(window: Window, request: Request) -> Values:
    """Return the comparison of several runs: its text, values and figure, and its tables for LaTeX."""
    with window.figures:
        comparison = compute(window, request)
        values = comparison.to_mapping()
        for group, described in zip(comparison.groups, values["groups"], strict=True):
            for run, entry in zip(group.runs, described["runs"], strict=True):
                entry["id"] = str(run.path.relative_to(window.index.folder))
        return {
            "text": str(comparison),
            "values": as_values(values),
            "latex": latex_text(comparison),
            "figure": draw(comparison, request, "svg").decode(),
            "can_play": all(is_competition(run) for group in comparison.groups for run in group.runs),
        }


def play(window: Window, values: dict[str, Any]) -> Values:
    """Return the league table of the best candidates of runs, as by `swarmwright league`."""
    names = read_runs(window, values)
    episodes = EPISODES if values.get("episodes") is None else read_whole(values["episodes"], "episodes")
    if not 1 <= episodes <= MOST_EPISODES:
        raise InputError(f"episodes: must be from 1 to {MOST_EPISODES}, not {episodes}")
    limit = TimeLimit(
        LONGEST_S, f"the matches take more than {LONGEST_S:.0f} s; use `swarmwright league FOLDER`"
    )
    broker = window.find_broker(window.run_of(names[0]))
    servers = "in-process" if broker is None else "auto"
    where = EvaluationOptions.of(episodes, None, broker, servers, lambda *_: limit.check())
    with computing, limit:
        league = play_league(window.index.folder, None, where, names)
    tables = []
    for side, _ in league.tables:
        head, *rows = league.cells(side)
        tables.append({"side": side, "head": head, "rows": rows})
    left_out = [f"left out: {each.reason}" for each in league.left_out]
    return {"tables": tables, "notes": [*league.heading, *league.caveats, *left_out]}


def download(window: Window, request: Request) -> Response:
    """Return the figure or the table of a comparison as a file."""
    ending = request.query_params.get("format", "")
    with window.figures:
        if ending in FIGURES:
            content, media_type = draw(compute(window, request), request, ending), FIGURES[ending]
        elif ending == "csv":
            content = csv_text(compute(window, request), window.index.folder).encode()
            media_type = "text/csv"
        else:
            raise InputError(f"format: must be one of {', '.join((*FIGURES, 'csv'))}, not {ending[:50]!r}")
    headers = {"Content-Disposition": f'attachment; filename="comparison.{ending}"'}
    return Response(content, media_type=media_type, headers=headers)


VIEW = View(
    "compare",
    STATIC / "compare.js",
    answers={"compare": answer, "compare_file": download},
    asks={"league": play},
)

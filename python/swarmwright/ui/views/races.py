"""The tab of races."""

from starlette.requests import Request

from swarmwright.runs.races import entrants, has_races, races
from swarmwright.ui.index import as_values
from swarmwright.ui.requests import read_integer
from swarmwright.ui.views._base import STATIC, Values, View
from swarmwright.ui.window import Window

MOST_ENTRANTS = 2000


def describe(window: Window, request: Request) -> Values:
    """Return how many candidates remained in each race."""
    shown = races(window.run(request))
    return {
        "unit": shown.unit,
        "numbers": shown.numbers.tolist(),
        "count": shown.count,
        "steps": shown.steps.tolist(),
        "candidates": shown.candidates.tolist(),
        "remaining": as_values(shown.remaining),
    }


def describe_entrants(window: Window, request: Request) -> Values:
    """Return the candidates of a race."""
    entered = entrants(window.run(request), read_integer(request, "race"))
    return {
        "count": len(entered),
        "entrants": [as_values(entrant._asdict()) for entrant in entered[:MOST_ENTRANTS]],
    }


VIEW = View(
    "races",
    STATIC / "races.js",
    "Races",
    tab_of=has_races,
    answers={"races": describe, "race_entrants": describe_entrants},
)

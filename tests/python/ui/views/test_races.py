"""The tab of races."""

from collections.abc import Callable
from pathlib import Path

from starlette.applications import Starlette

from swarmwright import Experiment, Run, optimize
from swarmwright.runs.races import entrants
from tests.python.ui.client import call


def test_races_and_their_candidates(
    finished: Run, tmp_path: Path, open_app: Callable[[Path], Starlette]
) -> None:
    values = {
        "simulation": "minisim",
        "parameters": {"placement": "random", "maxSteps": 5},
        "ranking": {"kind": "race", "episodes": 6, "first_test": 3},
        "method": {"kind": "random_search", "population": 8, "generations": 3},
        "servers": "in-process",
        "validate": False,
    }
    run = optimize(Experiment.from_mapping(values), out=tmp_path / "race")
    app = open_app(tmp_path)
    assert "races" in call(app, "/api/tabs", run="race").values["tabs"]
    counts = call(app, "/api/races", run="race").values
    assert (counts["unit"], counts["numbers"], counts["steps"]) == ("episodes", [0, 1, 2], [1, 2, 3, 4, 5, 6])
    entered = call(app, "/api/race_entrants", run="race", race=1).values
    assert [entrant["candidate"] for entrant in entered["entrants"]] == [
        entrant.candidate for entrant in entrants(run, 1)
    ]
    answer = call(app, "/api/race_entrants", run="race", race=3)
    assert (answer.status, "has no generation 3" in answer.values["error"]) == (422, True)
    answer = call(open_app(finished.path.parent), "/api/races", run=finished.path.name)
    assert (answer.status, "has no races" in answer.values["error"]) == (422, True)

"""The tab of what servers did when."""

import base64
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from starlette.applications import Starlette

from swarmwright import Run
from tests.python.records import change, write_attempts
from tests.python.ui.client import call


def test_lanes_and_shares_are_those_of_the_library(copy: Path, open_app: Callable[[Path], Starlette]) -> None:
    write_attempts(copy)
    app = open_app(copy.parent)
    values = call(app, "/api/timeline", run=copy.name).values
    shares = Run(copy).servers()
    table = call(app, "/api/timeline_shares", run=copy.name).values
    assert [share["evaluations"] for share in table["shares"]] == [share.evaluations for share in shares]
    assert sum(share["share"] for share in table["shares"]) == pytest.approx(1)
    assert table["waiting"] == {"9": {"generations": 1, "seconds": 25.0}}
    lanes = (len(values["servers"]), values["bins"])
    busy = np.frombuffer(base64.b64decode(values["busy"]), "<f4").reshape(lanes)
    episodes = np.frombuffer(base64.b64decode(values["episodes"]), "<f4").reshape(lanes)
    by_server = {share.server: share for share in shares}
    for row, server in enumerate(values["servers"]):
        assert busy[row].sum() == pytest.approx(by_server[server].seconds, rel=1e-3)
        assert episodes[row].sum() == by_server[server].evaluations
    assert values["sessions"] == [1]
    assert [failure["reason"] for failure in values["failures"]] == ["out of fuel"]


def test_numbers_of_servers_stay_what_they_are(copy: Path, open_app: Callable[[Path], Starlette]) -> None:
    write_attempts(copy)
    number = 2**62 + 1  # browsers would round it
    change(copy, f"UPDATE attempt SET server = {number} WHERE server = 9")
    app = open_app(copy.parent)
    assert call(app, "/api/timeline", run=copy.name).values["servers"][-1] == str(number)
    table = call(app, "/api/timeline_shares", run=copy.name).values
    assert table["shares"][-1]["server"] == str(number)
    assert str(number) in table["waiting"]


@pytest.mark.parametrize(
    ("query", "message"),
    [
        ({"session": 7}, "has no session 7"),
        ({"begin": "5", "end": "2"}, "must be ascending seconds"),
        ({"begin": "soon"}, "begin: must be a number"),
        ({"end": "inf"}, "must be ascending seconds"),
        ({"begin": 0, "end": 1e-5}, "must be at least 0.001 s apart"),
        ({"begin": "1e300", "end": "1.1e300"}, "must be at least 0.001 s apart"),
        ({"begin": "nan"}, "must be ascending seconds"),
    ],
)
def test_wrong_requests_are_told_why(
    finished: Run, open_app: Callable[[Path], Starlette], query: dict[str, Any], message: str
) -> None:
    answer = call(open_app(finished.path.parent), "/api/timeline", **({"run": finished.path.name} | query))
    assert answer.status == 422
    assert message in answer.values["error"]

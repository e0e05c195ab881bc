"""No server fits: what is to be done about it."""

from typing import Any, cast

import pytest

from swarmwright import Experiment, RunError, _engine
from swarmwright.evaluation.through_broker import BrokerBackend


class Unanswered:
    """A pool that finds no server."""

    def __init__(self, found: str) -> None:
        self.found = found

    def wait_for_server(self, *, sizes: bool) -> tuple[int, int]:
        raise _engine.EngineError(f"no server fits ({sizes}); found: {self.found}")

    def listen(self, *_: object, **__: object) -> None: ...

    def announced_metrics(self) -> list[str]:
        return []


@pytest.mark.parametrize(
    ("title", "found", "hint"),
    [
        ("minisim", "no server at all", "; start one with: swarmwright serve minisim"),
        ("minisim", "server 4: offers chess, not minisim", ""),
        ("line", "no server at all", ""),
        ("minisin", "no server at all", "; did you mean 'minisim'?"),
    ],
)
def test_a_server_is_proposed_only_where_there_is_one_to_start(title: str, found: str, hint: str) -> None:
    experiment = Experiment.from_mapping({"simulation": title, "requirements": {"dimensions": 2}})
    with pytest.raises(RunError) as error:
        BrokerBackend(experiment, cast("Any", Unanswered(found)), None, "a broker")
    assert str(error.value) == f"no server fits (True); found: {found}{hint}"

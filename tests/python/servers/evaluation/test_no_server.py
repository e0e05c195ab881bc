"""No server fits: what is to be done about it."""

from pathlib import Path
from typing import Any, cast

import pytest

from swarmwright import Experiment, RunError, _engine
from swarmwright.servers.evaluation.opening import open_backend
from swarmwright.servers.evaluation.through_broker import BrokerBackend

STILL = """
from swarmwright import Simulation


class Still(Simulation):
    title, sensors, actuators = "still", 1, 1

    def reset(self, parameters, seed):
        return [[0.0]]

    def step(self, actions):
        return [[0.0]]

    def done(self):
        return True

    def fitness(self):
        return 0.0
"""

COMMAND = """
simulation: {command: [echo, "1"], log: stdout, fitness: value}
controller: {kind: parameter_set, parameters: {x: {type: real, range: [0, 1]}}}
"""


NOTHING = "no server answered"


class Unanswered:
    """A pool that finds no server."""

    def __init__(self, found: str) -> None:
        self.found = found

    def wait_for_server(self, *, sizes: bool) -> tuple[int, int]:
        kind = _engine.NoServerError if self.found == NOTHING else _engine.EngineError
        raise kind(f"no server fits ({sizes}); found: {self.found}")

    def listen(self, *_: object, **__: object) -> None: ...

    def announced_metrics(self) -> list[str]:
        return []


@pytest.mark.parametrize(
    ("title", "found", "hint"),
    [
        ("minisim", NOTHING, "; start one with: swarmwright serve minisim"),
        ("minisim", "server 4: offers chess, not minisim", ""),
        (
            "line",
            NOTHING,
            (
                "; start a server that offers 'line' on this broker, or set a launcher under `servers:` in "
                "the experiment. A server that does not announce itself answers only if its title, "
                "dimensions and max_agents match the requirements"
            ),
        ),
        ("line", "server 4: offers chess, not line", ""),
        ("minisin", NOTHING, "; did you mean 'minisim'?"),
    ],
)
def test_a_server_is_proposed_only_where_there_is_one_to_start(title: str, found: str, hint: str) -> None:
    experiment = Experiment.from_mapping({"simulation": title, "requirements": {"dimensions": 2}})
    with pytest.raises(RunError) as error:
        BrokerBackend(experiment, cast("Any", Unanswered(found)), None, "a broker")
    assert str(error.value) == f"no server fits (True); found: {found}{hint}"


def test_a_class_is_served_by_its_name_and_a_command_by_its_experiment(tmp_path: Path) -> None:
    folder = tmp_path / "two words"
    folder.mkdir()
    (folder / "still.py").write_text(STILL)
    (folder / "class.yaml").write_text("simulation: still.py:Still\n")
    (folder / "command.yaml").write_text(COMMAND)
    for file, served in (("class.yaml", "still.py:Still"), ("command.yaml", "command.yaml")):
        experiment = Experiment.load(folder / file)
        with pytest.raises(RunError) as error:
            BrokerBackend(experiment, cast("Any", Unanswered(NOTHING)), None, "a broker")
        assert str(error.value).endswith(f"; start one with: swarmwright serve '{folder / served}'")


def test_the_engine_says_that_there_is_none_in_these_words(embedded_broker: str) -> None:
    experiment = Experiment.from_mapping({"simulation": "minisim", "timeouts": {"discovery": 0.2}})
    with (
        pytest.raises(RunError, match=r"no server answered; start one with: swarmwright serve minisim$"),
        open_backend(experiment, broker=embedded_broker),
    ):
        pass

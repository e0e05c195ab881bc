"""What a simulation's code raises reaches the caller, also with a message longer than the engine keeps."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from swarmwright import Episodes, Experiment, Simulation, SimulationError, optimize, simulate
from swarmwright.common.errors import EpisodeError

LONG = ["z" * 3000, "é\n" * 1500, "name\udcff" + "\x1b" * 1990]


class Talkative(Simulation):
    title, dimensions, sensors, actuators = "talkative", 1, 1, 1
    parameters: Mapping[str, Any] = {"message": ""}

    def reset(self, parameters: dict[str, Any], seed: int) -> list[list[float]]:  # noqa: ARG002
        self.message = parameters["message"]
        return [[0.0]]

    def step(self, actions: Any) -> list[list[float]]:  # noqa: ARG002
        if int(self.message) == len(LONG):
            raise EpisodeError("z" * 3000, "its output")
        raise ValueError(LONG[int(self.message)])

    def done(self) -> bool:
        return False

    def fitness(self) -> float:
        return 0.0


def talkative(number: int) -> Experiment:
    return Experiment.from_mapping(
        {
            "simulation": Talkative,
            "parameters": {"message": str(number)},
            "controller": {"hidden": []},
            "method": {"population": 4, "generations": 2},
        }
    )


def check(error: SimulationError, cause: str | None) -> None:
    assert "Talkative.step: ValueError: " in str(error)
    assert str(error).isprintable()
    line = Talkative.step.__code__.co_firstlineno + 3
    assert str(error).endswith(f"... ({Path(__file__).relative_to(Path.cwd())}:{line})")
    assert error.stack is not None
    assert "raise ValueError(LONG" in error.stack
    if cause is None:
        assert error.__cause__ is None
    else:
        assert type(error.__cause__) is ValueError
        assert str(error.__cause__) == cause


@pytest.mark.parametrize("number", range(len(LONG)))
def test_long_messages_in_this_process(number: int, tmp_path: Path) -> None:
    experiment, message = talkative(number), LONG[number]
    with pytest.raises(SimulationError, match=r"^Talkative") as raised:
        Episodes(experiment).step([[0.0]])
    check(raised.value, message)
    with pytest.raises(SimulationError, match=r"^the episode failed: Talkative") as raised:
        simulate(experiment, servers="in-process")
    check(raised.value, message)
    with pytest.raises(SimulationError, match=r"^every candidate of generation 0 failed") as raised:
        optimize(experiment, servers="in-process", out=tmp_path / "run")
    check(raised.value, message)


@pytest.mark.slow
def test_long_messages_of_servers() -> None:
    with pytest.raises(SimulationError, match=r"^the episode failed: Talkative") as raised:
        simulate(talkative(0), servers=1)
    check(raised.value, None)


def test_long_messages_of_adapters() -> None:
    """Which say where it was."""
    with pytest.raises(SimulationError, match=r"^z{1997}[.]{3}$") as raised:
        Episodes(talkative(len(LONG))).step([[0.0]])
    assert raised.value.stack == "its output"
    with pytest.raises(SimulationError, match=r"^the episode failed: z{1997}[.]{3}$") as raised:
        simulate(talkative(len(LONG)), servers="in-process")
    assert raised.value.stack == "its output"

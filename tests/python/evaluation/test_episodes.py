"""Episodes that are steered from outside are those that controllers are evaluated in."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from swarmwright import Controller, Episodes, Experiment, InputError, RunError, Simulation, evaluate
from swarmwright.core.random_numbers import Stream
from swarmwright.evaluation.episodes import Observation


class Walk(Simulation):
    """Two agents walk along a line; the first one ends after three steps, and it fails with a large step."""

    sensors = 1
    actuators = 1
    max_agents = 2
    frame_seconds = 0.5
    metrics = {"far": "Distance of the first agent."}  # noqa: RUF012 - as in the base class

    def reset(self, _parameters: dict[str, Any], seed: int) -> NDArray[np.float64]:
        self.steps, self.at = 0, np.array([[float(seed)], [0.0]])
        return self.at

    def step(self, actions: NDArray[np.float32]) -> NDArray[np.float64]:
        self.steps += 1
        self.at = self.at + actions
        if self.at[0, 0] > 100:
            raise ValueError("too far")
        return self.at

    def done(self) -> bool:
        return self.steps == 3

    def fitness(self) -> float:
        return float(self.at.sum())

    def measure(self) -> dict[str, float]:
        return {"far": float(self.at[0, 0])}


@pytest.mark.parametrize(
    ("simulation", "parameters"),
    [
        ("minisim", {}),
        ("minisim", {"agents": [[0.5, 0.5], [0.5, 6.0]], "maxSteps": 40}),
        ("arena", {"mission": "foraging", "duration": 4, "robots": 5}),
        ("emergency_exit", {}),
    ],
)
@pytest.mark.parametrize("fitness", [None, "-2 * fitness"])
def test_a_network_gets_the_fitness_that_it_gets_when_it_is_evaluated(
    simulation: str, parameters: dict[str, Any], fitness: str | None
) -> None:
    values = {"simulation": simulation, "parameters": parameters, "fitness": fitness}
    values |= {"controller": {"kind": "layered", "hidden": [3]}, "ranking": {"episodes": 3}}
    experiment = Experiment.from_mapping(values)
    representation = experiment.representation()
    genome = representation.initial(Stream(3, "initial"))
    expected = evaluate(experiment, genome[np.newaxis], servers="in-process")[0]
    controller = Controller(representation.specification(genome))

    def network(seen: Observation) -> list[list[float]]:
        return [list(controller(row)) for row in seen.sensors]

    episodes = Episodes(experiment, seeds=range(3))
    found = episodes.run(network)
    assert float(np.mean(found)) == expected
    assert episodes.done
    assert {len(values) for values in episodes.metrics.values()} == {3}


def test_steps_can_be_taken_one_by_one() -> None:
    episodes = Episodes(Walk, seeds=[5, 7], watch=False)
    assert (episodes.sensors, episodes.actuators, episodes.seeds) == (1, 1, [5, 7])
    assert (episodes.step_seconds, episodes.acts_in_turn) == (0.5, False)
    while not episodes.done:
        seen = episodes.observe()
        assert seen is episodes.observe()
        assert seen.episodes.tolist() == [0, 0, 1, 1]
        assert seen.agents.tolist() == [0, 1, 0, 1]
        # Limited to -1..1.
        episodes.step([[1.0], [0.5], [-3.0], [2.0]])
    assert episodes.fitness.tolist() == [5 + 3 + 1.5, 7 - 3 + 3]
    assert episodes.metrics["far"].tolist() == [8, 4]
    assert len(episodes.observe().agents) == 0


def test_mistakes() -> None:
    with pytest.raises(InputError, match=r"'aren' is not built in, nor a class .*; did you mean 'arena'"):
        Episodes("aren")
    with pytest.raises(InputError, match=r"parameters\.mision: unknown parameter"):
        Episodes("arena", {"mision": "aac"})
    with pytest.raises(InputError, match="seeds: must be a list of integers"):
        Episodes(Walk, seeds=3)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"seeds\[1\]: must be from 0 to"):
        Episodes(Walk, seeds=[1, -1])
    with pytest.raises(InputError, match="seeds: is empty"):
        Episodes(Walk, seeds=[])
    with pytest.raises(InputError, match="simulation: must be a name"):
        Episodes(3)  # type: ignore[arg-type]
    episodes = Episodes(Walk)
    with pytest.raises(InputError, match=r"have the shape \(1, 1\); expected \(2, 1\)"):
        episodes.step([[0]])
    with pytest.raises(InputError, match=r"actuators: nan at \[1, 0\]"):
        episodes.step([[0.0], [np.nan]])
    with pytest.raises(InputError, match="controller: must be a function"):
        episodes.run(3)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"write Episodes\(\.\., watch=True\)"):
        episodes.save("x.png")
    episodes.run(lambda seen: np.zeros_like(seen.sensors))
    with pytest.raises(InputError, match="all episodes have ended"):
        episodes.step([[0], [0]])
    with pytest.raises(RunError, match="too far"):
        Episodes(Walk, seeds=[101]).step([[0], [0]])


def test_the_first_episode_is_saved(tmp_path: Path) -> None:
    parameters = {"mission": "stop", "robots": 3, "duration": 2}
    episodes = Episodes("arena", parameters, seeds=[4, 5], watch=True)
    episodes.run(lambda seen: np.ones((len(seen.agents), 2)))
    assert episodes.scene().step == 19
    for ending in ("png", "gif", "html"):
        episodes.save(tmp_path / f"rule.{ending}")
        assert (tmp_path / f"rule.{ending}").stat().st_size > 2000
    with pytest.raises(InputError, match="files end with"):
        episodes.save(tmp_path / "rule.txt")
    with pytest.raises(InputError, match="cannot be written"):
        episodes.save(tmp_path / "none" / "rule.png")
    with pytest.raises(RunError, match="nothing to show"):
        Episodes(Walk, watch=True)


def test_parameters_of_an_experiment_are_kept_where_none_is_given() -> None:
    experiment = Experiment.from_mapping(
        {"simulation": "arena", "parameters": {"mission": "decision", "robots": 4}, "fitness": "speed"}
    )
    episodes = Episodes(experiment, {"robots": 2, "duration": 1})
    assert len(episodes.observe().agents) == 2
    fitness = episodes.run(lambda seen: np.ones((len(seen.agents), 2)))
    assert fitness == episodes.metrics["speed"]

"""Episodes that are steered from outside are those that controllers are evaluated in."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from swarmwright import (
    Controller,
    Episodes,
    Experiment,
    Group,
    InputError,
    RunError,
    Simulation,
    evaluate,
    evaluate_episodes,
)
from swarmwright.common.random_numbers import Stream
from swarmwright.controllers.modules.grammar import BUILT_IN, PYTHON_KIND
from swarmwright.servers.evaluation.episodes import EpisodeSequence, Observation


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


class Pursuit(Simulation):
    """Two kinds of agents; the last hunter acts for a number of steps that the seed says."""

    groups = {  # noqa: RUF012 - as in the base class
        "hunters": Group(agents=2, sensors=2, actuators=2),
        "prey": Group(agents=1, sensors=1, actuators=1),
    }

    def reset(self, _parameters: dict[str, Any], seed: int) -> list[NDArray[np.float64]]:
        self.seed, self.steps, self.total = seed, 0, 0.0
        self.at = np.full((3, 2), float(seed) / 10)
        return self.look()

    def look(self) -> list[NDArray[np.float64]]:
        return [self.at[0], self.at[1], self.at[2, :1]]

    def step(self, actions: NDArray[np.float32]) -> list[NDArray[np.float64]]:
        self.steps += 1
        self.at = self.at / 2 + actions
        self.total += float(np.abs(self.at).sum()) * self.steps
        return self.look()

    def acting(self) -> list[int]:
        return [0, 1, 2] if self.steps < 2 + self.seed % 3 else [0, 2]

    def done(self) -> bool:
        return self.steps == 6 + self.seed % 4

    def fitness(self) -> float:
        return self.total


TEAM = {
    "kind": "team",
    "groups": {name: {"kind": "fully_meshed", "hidden": 1} for name in ("hunters", "prey")},
}


@pytest.mark.parametrize(
    ("simulation", "parameters", "controller"),
    [
        ("minisim", {"placement": "random", "numAgents": 3}, {"kind": "layered", "hidden": [3]}),
        ("minisim", {"placement": "random", "numAgents": 3}, {"kind": "fully_meshed", "hidden": 2}),
        ("arena", {"mission": "homing", "duration": 4, "robots": 5}, {"kind": "hebbian", "hidden": 1}),
        ("arena", {"mission": "aac", "robot": "e-puck-rm1.2", "duration": 4}, {"kind": "modules"}),
        ("emergency_exit", {}, {"kind": "fully_meshed", "hidden": 2}),
        (Pursuit, {}, TEAM),
    ],
)
def test_a_controller_gets_the_fitness_that_it_gets_when_it_is_evaluated(
    simulation: str | type, parameters: dict[str, Any], controller: dict[str, Any]
) -> None:
    values = {"simulation": simulation, "parameters": parameters, "controller": controller}
    experiment = Experiment.from_mapping(values | {"ranking": {"episodes": 12}})
    representation = experiment.representation()
    genomes = np.stack([representation.initial(Stream(seed, "initial")) for seed in (3, 4)])
    expected = evaluate_episodes(experiment, genomes, servers="in-process").episodes
    for genome, row in zip(genomes, expected, strict=True):
        evolved = Controller(representation.specification(genome))
        for _ in range(2):  # nothing is left of the episodes before
            assert Episodes(experiment, seeds=range(12)).run(evolved).tolist() == row.tolist()


def test_a_machine_of_modules_in_python_keeps_states_by_episode_and_agent() -> None:
    parameters = {"mission": "aac", "robot": "e-puck-rm1.2", "duration": 4, "robots": 3}
    experiment = Experiment.from_mapping(
        {"simulation": "arena", "parameters": parameters, "controller": {"kind": "modules"}}
    )
    representation = experiment.representation()
    machine = representation.specification(representation.initial(Stream(2, "initial")))
    built_in = {
        "behaviours": [one.as_mapping() for one in BUILT_IN.behaviours],
        "conditions": [one.as_mapping() for one in BUILT_IN.conditions],
    }
    fitness = [
        Episodes(experiment, seeds=range(5)).run(Controller(one)).tolist()
        for one in (machine, {**machine, "kind": PYTHON_KIND, **built_in})
    ]
    assert fitness[0] == fitness[1]


def test_controllers_that_do_not_fit_are_refused() -> None:
    values = {
        "version": 1,
        "kind": "layered",
        "sensors": 3,
        "actuators": 1,
        "hidden": [],
        "weights": [0.0] * 4,
    }
    values |= {"activation": "tanh", "output_range": [-1, 1]}
    words = "has 3 sensors and 1 actuators; agents of minisim have 4 and 1"
    with pytest.raises(InputError, match=words):
        Episodes("minisim").run(Controller(values))
    options = {"kind": "parameter_set", "parameters": {"speedDefenders": {"type": "real", "range": [0, 1]}}}
    representation = Experiment.from_mapping(
        {"simulation": "minisim", "parameters": {"steering": "rule"}, "controller": options}
    ).representation()
    with pytest.raises(InputError, match="is a parameter set"):
        Episodes("minisim").run(Controller(representation.specification(np.zeros(1, np.float32))))


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
    with pytest.raises(
        InputError, match=r"'aren' is neither built in nor a Python class; did you mean 'arena'"
    ):
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
    for given in ("pole.yaml", Path("pole.yaml")):
        with pytest.raises(InputError, match=r"pole\.yaml: there is no such file"):
            Episodes(given)
    episodes = Episodes(Walk)
    with pytest.raises(InputError, match=r"shape is \(1, 1\); expected \(2, 1\)"):
        episodes.step([[0]])
    with pytest.raises(InputError, match=r"actuators: \[1, 0\] is nan"):
        episodes.step([[0.0], [np.nan]])
    with pytest.raises(InputError, match="controller: must be a function"):
        episodes.run(3)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="create the episodes with watch=True"):
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
    with pytest.raises(InputError, match="unknown suffix"):
        episodes.save(tmp_path / "rule.txt")
    with pytest.raises(InputError, match="cannot be written"):
        episodes.save(tmp_path / "none" / "rule.png")
    with pytest.raises(InputError, match=r"Walk has nothing to display; add a method scene\(\)"):
        Episodes(Walk, watch=True)


class Drawn(Walk):
    """Draws itself: how far the first agent is, in pixels."""

    def done(self) -> bool:
        return bool(self.steps == self.at[0, 0])

    def picture(self) -> NDArray[np.uint8]:
        pixels = np.zeros((8, 64, 3), np.uint8)
        pixels[:, : int(self.at[0, 0])] = 200
        return pixels


@pytest.mark.parametrize("seeds", [[5], [5, 9]])
def test_the_pictures_of_a_simulation_that_draws_itself_are_saved(seeds: list[int], tmp_path: Path) -> None:
    episodes = Episodes(Drawn, seeds=seeds, watch=True)
    episodes.run(lambda seen: np.zeros((len(seen.agents), 1)))
    assert episodes._pictures is not None
    recording = episodes._pictures.recording(0.5)
    assert recording.steps == (0, 1, 2, 3, 4, 5)
    assert recording.fitness_so_far == (5.0,) * 6
    for ending in ("png", "gif", "html"):
        episodes.save(tmp_path / f"rule.{ending}")
        assert (tmp_path / f"rule.{ending}").stat().st_size > 100
    with pytest.raises(InputError, match="draws pictures instead of scenes"):
        episodes.scene()


def test_an_environment_of_gymnasium_is_watched(tmp_path: Path) -> None:
    pytest.importorskip("gymnasium")
    pytest.importorskip("pygame")
    episodes = Episodes("gymnasium:CartPole-v1", seeds=[3], watch=True)
    episodes.run(lambda seen: np.ones((len(seen.agents), episodes.actuators)))
    episodes.save(tmp_path / "pole.gif")
    assert (tmp_path / "pole.gif").stat().st_size > 2000


def test_parameters_of_an_experiment_are_kept_where_none_is_given() -> None:
    experiment = Experiment.from_mapping(
        {"simulation": "arena", "parameters": {"mission": "decision", "robots": 4}, "fitness": "speed"}
    )
    episodes = Episodes(experiment, {"robots": 2, "duration": 1})
    assert len(episodes.observe().agents) == 2
    fitness = episodes.run(lambda seen: np.ones((len(seen.agents), 2)))
    assert fitness == episodes.metrics["speed"]


def test_what_is_not_watched_is_not_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    def look(_episodes: Episodes) -> bool:
        pytest.fail("costs as much as a short step")

    monkeypatch.setattr(Episodes, "_first_goes_on", property(look))
    Episodes(Walk, seeds=[1, 2]).run(lambda seen: seen.sensors)


def test_the_next_episode_of_a_sequence_takes_the_place_of_the_one_before() -> None:
    sequence = EpisodeSequence(Walk)
    for seed in (4, 7):
        sequence.step([[1.0], [0.5]])
        sequence.restart(seed)
        assert sequence.seeds == [seed]
        expected = Episodes(Walk, seeds=[seed])
        assert sequence.observe().sensors.tolist() == expected.observe().sensors.tolist()
        assert sequence.run(lambda _: [[0.5], [0.25]]) == expected.run(lambda _: [[0.5], [0.25]])
        sequence.restart(seed)
    assert not hasattr(Episodes, "restart"), "several episodes, and what is kept of them"


def test_an_experiment_may_be_named_by_its_file_or_given_as_a_mapping(tmp_path: Path) -> None:
    file = tmp_path / "my.yaml"
    file.write_text("simulation: arena\nparameters: {robots: 3, duration: 2}\n")
    values = {"simulation": "arena", "parameters": {"robots": 3, "duration": 2}}
    expected = Experiment.from_mapping(values)
    for given in (file, str(file), values):
        assert Episodes(given).experiment.parameters == expected.parameters
    changed = Episodes(str(file), {"robots": 2})
    assert changed.experiment.parameters == {**expected.parameters, "robots": 2}
    assert len(changed.observe().agents) == 2

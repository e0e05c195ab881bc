"""Experiments whose candidates compete: sides, populations, and mistakes in them."""

from typing import Any

import pytest

from swarmwright import Experiment, InputError
from swarmwright.common.engine_types import SideFields
from swarmwright.controllers.kinds.team import Team
from swarmwright.experiment.competition import check_announced
from swarmwright.methods.competition import Competition
from swarmwright.methods.rankings.tournament import TournamentOptions

MINISIM = {
    "simulation": "minisim",
    "parameters": {
        "numAgents": 3,
        "numDefenders": 2,
        "placement": "random",
        "defenderSteering": "controller",
    },
    "servers": "in-process",
    "method": {"population": 6, "generations": 2},
}
POPULATIONS: dict[str, Any] = {
    "agents": {"controller": {"hidden": [3]}},
    "defenders": {"controller": {"kind": "fully_meshed", "hidden": 1}, "method": {"population": 4}},
}


def build(**changes: Any) -> Experiment:
    return Experiment.from_mapping({**MINISIM, **changes})


def sides_of(experiment: Experiment) -> Any:
    assert isinstance(experiment.ranking, TournamentOptions)
    return experiment.ranking.sides


def test_one_population_plays_all_sides() -> None:
    experiment = build(controller={"hidden": [2]}, ranking={"kind": "tournament"})
    assert sides_of(experiment) == {"agents": "fitness", "defenders": "-fitness"}
    representation = experiment.representation()
    assert isinstance(representation, Team)
    assert len({part.genome_size for part in representation.parts.values()}) == 1
    method = experiment.new_method()
    assert isinstance(method, Competition)
    assert [(each.name, each.sides) for each in method.populations] == [("agents", (0, 1))]


def test_each_population_has_its_controller_and_its_method() -> None:
    experiment = build(populations=POPULATIONS)
    assert experiment.ranking.kind == "tournament"
    method = experiment.new_method()
    assert isinstance(method, Competition)
    assert [each.name for each in method.populations] == ["agents", "defenders"]
    assert [getattr(each.method.options, "population", None) for each in method.populations] == [6, 4]
    seeds = {each.method.seed for each in method.populations}
    assert len(seeds) == 2, "populations have different random numbers"


@pytest.mark.parametrize(
    "changes",
    [
        {"populations": POPULATIONS, "ranking": {"pairing": "best"}},
        {"ranking": {"kind": "tournament", "sides": ["agents", "defenders"], "pairing": "swiss"}},
        {"ranking": {"kind": "tournament", "sides": {"agents": "-steps", "defenders": "steps"}}},
    ],
)
def test_what_is_written_out_loads_to_the_same(changes: dict[str, Any]) -> None:
    experiment = build(**changes)
    assert Experiment.from_mapping(experiment.to_mapping()) == experiment


def test_the_fitness_of_the_first_side_is_that_of_the_record() -> None:
    experiment = build(populations={**POPULATIONS, "agents": {"fitness": "-steps"}})
    assert experiment.fitness == "-steps"
    assert sides_of(experiment) == {"agents": "-steps", "defenders": "-fitness"}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"populations": {"agents": {}, "wolves": {}}}, "populations.wolves: unknown side 'wolves'"),
        ({"populations": {"agents": {}}}, "populations: a match needs at least two sides"),
        ({"populations": [1]}, "populations: must be a mapping"),
        ({"populations": {"agents": 3, "defenders": {}}}, "populations.agents: must be a mapping"),
        (
            {"populations": {"agents": {"controler": {}}, "defenders": {}}},
            "populations.agents.controler: unknown key; did you mean 'controller'?",
        ),
        (
            {"populations": {"agents": {"controller": {"hidden": "x"}}, "defenders": {}}},
            "populations.agents.controller.hidden: must be a list",
        ),
        (
            {"populations": {"agents": {"method": {"population": "x"}}, "defenders": {}}},
            "populations.agents.method.population: must be an integer, not 'x'",
        ),
        (
            {"populations": {"agents": {"method": {"kind": "cma"}}, "defenders": {}}},
            "populations.agents.method.kind: unknown method 'cma'",
        ),
        (
            {"populations": {"agents": {"method": {"evaluations": 9}}, "defenders": {}}},
            "populations.agents.method.evaluations: limits are those of the whole run; move it to method",
        ),
        (
            {"populations": {"agents": {"method": {"generations": 9}}, "defenders": {}}},
            "populations.agents.method.generations: limits are those of the whole run; move it to method",
        ),
        (
            {"populations": {"agents": {"method": {"kind": "mine.py:Mine"}}, "defenders": {}}},
            "populations.agents.method.kind: mine.py:Mine is a class in a file; install it as a plug-in",
        ),
        (
            {"populations": {"agents": {"fitness": "caugt"}, "defenders": {}}},
            "populations.agents.fitness: 'caugt' is not a metric of minisim; did you mean 'caught'?",
        ),
        ({"populations": POPULATIONS, "ranking": {"pairing": "swiss"}}, "ranking.pairing: swiss is for one"),
        (
            {"populations": POPULATIONS, "ranking": {"score": "elo"}},
            "ranking.score: elo is for one population",
        ),
        (
            {"populations": POPULATIONS, "ranking": {"score": "win_rate"}},
            "ranking.score: win_rate is for one population",
        ),
        (
            {"populations": POPULATIONS, "ranking": {"pairing": "frevo_swiss_system"}},
            "ranking.pairing: frevo_swiss_system is for one",
        ),
        ({"ranking": {"kind": "tournament", "win": 0}}, "ranking.win: must be"),
        ({"ranking": {"kind": "tournament", "draw": -1}}, "ranking.draw: must be"),
        ({"populations": POPULATIONS, "ranking": {"kind": "absolute"}}, "ranking.kind: must be tournament"),
        (
            {"populations": POPULATIONS, "method": {"kind": "racing"}},
            "populations.agents.method.kind: racing cannot evolve a population of a competition",
        ),
        (
            {"ranking": {"kind": "tournament"}, "method": {"operation": "steady_state"}},
            "method.operation: a competition has generations",
        ),
        ({"ranking": {"kind": "tournament", "sides": ["agents"]}}, "a match has 2 to 16 sides, not 1"),
        ({"ranking": {"kind": "tournament", "sides": ["agents", "agents"]}}, "names 'agents' twice"),
        ({"ranking": {"kind": "tournament", "sides": ["left", "right"]}}, "unknown side 'left'"),
        ({"ranking": {"kind": "tournament", "sides": {"agents": 3}}}, "a match has 2 to 16 sides, not 1"),
        (
            {"ranking": {"kind": "tournament", "sides": {"agents": "a b", "defenders": None}}},
            "ranking.sides.agents: 'a b' is not a valid expression",
        ),
        ({"ranking": {"kind": "tournament", "reevaluate": True}}, "survivors always compete again"),
        (
            {"ranking": {"kind": "tournament"}, "parameters": {}},
            "minisim has only one kind of agents with these parameters, so there are no sides",
        ),
        (
            {"simulation": "elsewhere", "parameters": {}, "ranking": {"kind": "tournament"}},
            "ranking.sides: a match needs at least two sides; name them all",
        ),
        (
            {"ranking": {"kind": "tournament"}, "controller": {"kind": "parameter_set", "parameters": {}}},
            "controller: ",
        ),
    ],
)
def test_mistakes_are_a_message(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as error:
        build(**changes)
    assert message in str(error.value)


def test_one_controller_cannot_play_sides_with_other_sensors(tmp_path: Any) -> None:
    (tmp_path / "game.py").write_text(
        "from swarmwright import Group, Simulation\n\n\n"
        "class Game(Simulation):\n"
        "    title = 'game'\n"
        "    groups = {'a': Group(1, sensors=2, actuators=1), 'b': Group(1, sensors=1, actuators=1)}\n"
        "    def reset(self, parameters, seed):\n        return [[0, 0], [0]]\n"
        "    def step(self, actions):\n        return [[0, 0], [0]]\n"
        "    def done(self):\n        return True\n"
        "    def fitness(self):\n        return 0\n",
        encoding="utf-8",
    )
    with pytest.raises(InputError, match="a has 2 sensors and b has 1, so one controller cannot play both"):
        build(simulation=f"{tmp_path}/game.py:Game", parameters={}, ranking={"kind": "tournament"})


ELSEWHERE: dict[str, Any] = {
    "simulation": "elsewhere",
    "sensors": 2,
    "actuators": 1,
    "controller": {"kind": "layered", "hidden": [2], "agents": 2},
    "ranking": {"kind": "tournament", "sides": ["a", "b"]},
}


def test_a_fitness_that_only_servers_know_is_not_overlooked() -> None:
    sides: list[SideFields] = [
        {"name": "A", "groups": ["a"], "fitness": "a_points"},
        {"name": "B", "groups": ["b"], "fitness": "b_points"},
    ]
    experiment = Experiment.from_mapping(ELSEWHERE)
    check_announced(experiment, [(1, []), (2, [{"name": "A", "groups": ["a"], "fitness": None}])])
    with pytest.raises(
        InputError, match=r"server 3 announces a fitness for each side; use it, sides: {a: a_p"
    ):
        check_announced(experiment, [(1, []), (3, sides)])
    explicit = experiment.replace(ranking={"sides": {"a": "a_points", "b": "2 * b_points"}})
    check_announced(explicit, [(3, sides)])

"""Experiments whose candidates compete: sides, populations, and mistakes in them."""

import json
from pathlib import Path
from typing import Any

import pytest

from swarmwright import Experiment, InputError
from swarmwright.common.engine_types import SideFields
from swarmwright.common.random_numbers import Stream
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
        (
            {"ranking": {"kind": "tournament"}, "method": {"kind": "random_search", "population": 1}},
            "method: has a single candidate, but random lets candidates meet; use more",
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


LAYERED = {"version": 1, "kind": "layered", "sensors": 4, "hidden": [2], "actuators": 1}
NETWORK: dict[str, Any] = {
    **LAYERED,
    "activation": "tanh",
    "output_range": [-1, 1],
    "weights": [0.5] * 13,
}
"""A controller of minisim's agents and defenders."""
OTHER = {**NETWORK, "hidden": [3], "weights": [0.5] * 19}
TOURNAMENT = {"controller": {"hidden": [2]}, "ranking": {"kind": "tournament"}}
ALONE = {"populations": {"agents": {"controller": {"hidden": [3]}}}}


def with_opponents(opponents: Any, **ranking: Any) -> dict[str, Any]:
    return {**TOURNAMENT, "ranking": {"kind": "tournament", **ranking, "opponents": opponents}}


def test_a_side_without_a_population_has_the_controller_of_its_opponents() -> None:
    experiment = build(**ALONE, ranking={"opponents": {"defenders": [NETWORK]}})
    representation = experiment.representation()
    assert isinstance(representation, Team)
    hidden = {name: part.architecture()["hidden"] for name, part in representation.parts.items()}
    assert hidden == {"agents": [3], "defenders": [2]}
    assert getattr(experiment.ranking, "pairing", None) == "opponents"
    method = experiment.new_method()
    assert isinstance(method, Competition)
    assert [(each.name, each.sides) for each in method.populations] == [("agents", (0,))]


@pytest.mark.parametrize(
    "controller",
    [
        {"kind": "layered", "hidden": [3, 2], "activation": "relu", "output_range": [0, 9]},
        {"kind": "fully_meshed", "hidden": 2, "iterations": 3},
        {"kind": "hebbian"},
        {"kind": "evostick"},
        {"kind": "neat", "sources": [[0, 1], [4, 2]]},
        {"kind": "mealy_fsm", "states": 3, "levels": [1, [0.25, 0.5], 3, 1]},
    ],
    ids=lambda controller: controller["kind"],
)
def test_opponents_alone_can_have_any_kind_of_controller(controller: dict[str, Any]) -> None:
    """A controller as a file has it, without its genes, plays with the same weights."""
    representation = build(
        populations={"agents": {}, "defenders": {"controller": controller}}
    ).representation()
    assert isinstance(representation, Team)
    part = representation.parts["defenders"]
    specification = part.specification(part.initial(Stream(1, "test", 0, 0)))
    experiment = build(**ALONE, ranking={"opponents": {"defenders": [specification]}})
    method = experiment.new_method()
    assert isinstance(method, Competition)
    matches = next(method.matches())
    (team, *_) = [method.representation.specification(row) for row in matches.genomes]
    weights = team["weights"][-len(specification["weights"]) :]
    assert {**team["groups"][1]["controller"], "weights": weights} == specification


@pytest.mark.parametrize(
    "changes",
    [
        with_opponents([NETWORK, {**NETWORK, "weights": [0.25] * 13}], pairing="swiss"),
        with_opponents({"defenders": [NETWORK]}),
        {**ALONE, "ranking": {"opponents": {"defenders": [NETWORK]}}},
    ],
)
def test_opponents_are_written_out_and_load_to_the_same(changes: dict[str, Any]) -> None:
    experiment = build(**changes)
    again = Experiment.from_mapping(experiment.to_mapping())
    assert again == experiment
    assert hash(again) == hash(experiment)
    assert again != experiment.replace(ranking={"rounds": 7})


def test_opponents_are_read_relative_to_the_file(tmp_path: Path) -> None:
    (tmp_path / "their.json").write_text(json.dumps(NETWORK))
    file = tmp_path / "soccer.yaml"
    lines = [f"{key}: {json.dumps(value)}" for key, value in {**MINISIM, **TOURNAMENT}.items()]

    def load(opponents: str) -> Experiment:
        file.write_text(
            "\n".join([*lines[:-1], "ranking:", "  kind: tournament", f"  opponents: {opponents}"])
        )
        return Experiment.load(file)

    ranking = load("[their.json]").ranking
    assert isinstance(ranking, TournamentOptions)
    assert [entry["from"] for entry in ranking.opponents] == ["their.json"]
    assert ranking.opponents[0]["weights"] == NETWORK["weights"]
    with pytest.raises(
        InputError, match=r"soccer\.yaml:8: ranking\.opponents\[1\]: no\.json: there is no such"
    ):
        load("[their.json, no.json]")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            with_opponents(["\x1b[2J"]),
            "ranking.opponents[0]: \\x1b[2J: there is no such file; expected a run",
        ),
        (
            with_opponents("run-a"),
            "ranking.opponents: must be a list of runs, bundles and controllers, such as",
        ),
        (with_opponents({"agents": []}), "ranking.opponents.agents: must be a list of runs"),
        (with_opponents([3]), "ranking.opponents[0]: opponent: 3 found; expected a run folder"),
        (with_opponents([{}]), "ranking.opponents[0]: opponent: controller: "),
        (with_opponents([NETWORK] * 257), "ranking.opponents: has 257 opponents; at most 256 are possible"),
        (with_opponents({"wolves": [NETWORK]}), "ranking.opponents.wolves: unknown side 'wolves'"),
        (
            with_opponents([NETWORK, {**LAYERED, **NETWORK, "sensors": 3, "weights": [1] * 11}]),
            "ranking.opponents[1]: opponent: has 3 sensors and 1 actuators, but the agents have 4 and 1",
        ),
        (with_opponents([OTHER]), "they differ in hidden ([3], here [2]; set controller.hidden)"),
        (
            with_opponents(
                [
                    {"from": "x.bundle", "architecture": LAYERED | NETWORK, "weights": [1] * 13}
                    | {"simulation": "arena"}
                ]
            ),
            "ranking.opponents[0]: x.bundle: was evolved in arena, not in minisim",
        ),
        (
            with_opponents([{**NETWORK, "weights": [float("nan")] * 13}]),
            "ranking.opponents[0]: opponent: controller: ",
        ),
        (
            {**TOURNAMENT, "ranking": {"kind": "tournament", "pairing": "opponents"}},
            "ranking.opponents: missing; with pairing: opponents, candidates meet nobody else",
        ),
        (
            {"ranking": {"opponents": [NETWORK]}},
            "ranking.opponents: unknown key; it is an option of other kinds: tournament",
        ),
        (
            {
                **TOURNAMENT,
                "populations": {"agents": {}, "defenders": {}},
                "ranking": {"pairing": "opponents", "opponents": {"defenders": [NETWORK]}},
            },
            "ranking.opponents: defenders would meet nobody; list opponents for another side",
        ),
        (
            {**ALONE, "ranking": {"pairing": "best", "opponents": {"defenders": [NETWORK]}}},
            "ranking.pairing: best needs a population of defenders; leave the key out",
        ),
        (
            {**ALONE, "ranking": {"opponents": {"defenders": [NETWORK, OTHER]}}},
            "ranking.opponents.defenders[1]: opponent is layered, 4-3-1, tanh",
        ),
        (
            {**ALONE, "ranking": {"opponents": {"defendrs": [NETWORK]}}},
            "ranking.opponents.defendrs: unknown side 'defendrs'; did you mean 'defenders'?",
        ),
        (
            {**ALONE, "ranking": {"opponents": [NETWORK]}},
            "name them all, or list opponents for it: ranking.opponents: {SIDE: [..]}",
        ),
        (
            {**ALONE, "ranking": {"opponents": {"defenders": ["nothing"]}}},
            "ranking.opponents.defenders[0]: nothing: there is no such file",
        ),
    ],
)
def test_mistakes_with_opponents_are_a_message(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as error:
        build(**changes)
    assert message in str(error.value)
    assert len(str(error.value).splitlines()) == 1
    assert str(error.value).isprintable()


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

"""Environments whose agents act in turn: the rewards of PettingZoo's loop, and sides of matches."""

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmwright import Experiment, Group, InputError, Side, optimize
from swarmwright.common.errors import SimulationError
from swarmwright.simulations.attached import load_adapter
from swarmwright.simulations.host import describe
from swarmwright.simulations.pettingzoo import PettingZoo
from tests.python.records import same_record

pytestmark = pytest.mark.filterwarnings("ignore:The old environment creation API:DeprecationWarning")

TICTACTOE = "pettingzoo.classic.tictactoe_v3"
GAMES = (TICTACTOE, "pettingzoo.classic.connect_four_v3", "pettingzoo.classic.go_v5?board_size=3", "in_turn")


@pytest.fixture(autouse=True)
def here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Modules are looked for in the working folder."""
    monkeypatch.chdir(Path(__file__).parent)
    monkeypatch.syspath_prepend(str(Path(__file__).parent))


def make(name: str) -> Any:
    return load_adapter(f"pettingzoo:{name}")()


def play(simulation: Any, seed: int, most: int = 10_000) -> dict[str, float]:
    """Return the metrics of an episode with random actuators."""
    random = np.random.default_rng(seed)
    simulation.reset({}, seed)
    while not simulation.done() and most:
        (agent,) = simulation.acting()
        actions = np.zeros((len(simulation.env.possible_agents), simulation.actuators), np.float32)
        actions[agent] = random.uniform(-1, 1, simulation.actuators)
        simulation.step(actions)
        most -= 1
    measured: dict[str, float] = simulation.measure()
    return measured


def loop(name: str, seed: int) -> dict[str, float]:
    """Return the sum of rewards of each agent in PettingZoo's own loop, with the same actuators."""
    module, _, options = name.partition("?")
    env = import_module(module).env(**({"board_size": 3} if options else {}))
    random = np.random.default_rng(seed)
    env.reset(seed=seed)
    rewards = dict.fromkeys(env.possible_agents, 0.0)
    for agent in env.agent_iter():
        observation, reward, terminated, truncated, _ = env.last()
        rewards[agent] += reward
        action = None
        if not (terminated or truncated):
            actuators = random.uniform(-1, 1, env.action_space(agent).n).astype(np.float32)
            action = int(np.where(observation["action_mask"], actuators, -np.inf).argmax())
        env.step(action)
    return rewards


@pytest.mark.parametrize("name", GAMES)
@settings(max_examples=8)
@given(st.integers(0, 2**32 - 1))
def test_rewards_are_those_of_its_own_loop(name: str, seed: int) -> None:
    rewards = loop(name, seed)
    simulation = make(name)
    measured = play(simulation, seed)
    assert simulation.fitness() == pytest.approx(sum(rewards.values()) / len(rewards))
    assert [measured[f"reward_{group}"] for group in simulation.groups] == pytest.approx(
        list(rewards.values())
    )
    assert (measured["worst"], measured["best"]) == pytest.approx(
        (min(rewards.values()), max(rewards.values()))
    )


def test_an_illegal_move_is_replaced_by_the_legal_one_with_the_largest_actuator() -> None:
    simulation = make(TICTACTOE)
    simulation.reset({}, 0)
    preferences = np.linspace(1, -1, 9, dtype=np.float32)
    moves = 0
    while not simulation.done():
        simulation.step(np.stack([preferences, preferences]))  # everybody wants the first field
        moves += 1
        assert np.flatnonzero(simulation.env.unwrapped.board.squares).tolist() == list(range(moves))
    assert moves == 7  # 0, 2, 4 and 6: a diagonal
    assert simulation.measure()["reward_player_1"] == 1


def test_an_agent_that_acts_again_keeps_its_rewards() -> None:
    simulation = make("in_turn?trouble=twice&agents=2")
    play(simulation, 5)
    assert simulation._rewards.sum() == pytest.approx(sum(simulation.env._collected.values()))


@pytest.mark.parametrize("most", [1, 2])
def test_rewards_that_an_agent_has_not_collected_count_already(most: int) -> None:
    simulation = make("in_turn?agents=3")
    measured = play(simulation, 1, most)
    assert 3 * simulation.fitness() == pytest.approx(simulation.env.total)
    assert measured["best"] > 0


def test_the_end_of_time_is_no_defeat() -> None:
    for trouble, truncated in (("none", False), ("truncated", True)):
        simulation = make(f"in_turn?agents=2&trouble={trouble}")
        play(simulation, 3)
        assert simulation.done()
        assert simulation.truncated() == truncated


@pytest.mark.parametrize(
    ("trouble", "message"),
    [
        ("selection", "in_turn: agent_selection is 'side7_0', which is not among its agents, side0_0, side1"),
        ("stays", r"in_turn: agent 'side\d_0' has ended, but stays among its agents after step\(None\)"),
        ("last", r"in_turn: last returned a tuple of 4 .* expected \(observation, reward, termination"),
        ("words", "in_turn: its reward is 'much', expected a number"),
    ],
)
def test_what_an_environment_does_wrongly_is_said(trouble: str, message: str) -> None:
    with pytest.raises(SimulationError, match=message):
        play(make(f"in_turn?trouble={trouble}&new_each_episode=false"), 0)


def test_pictures_are_those_of_the_environment() -> None:
    drawing = load_adapter("pettingzoo:in_turn").make_rendering_class()()  # type: ignore[union-attr]
    play(drawing, 0, 2)
    assert drawing.picture().shape == (2, 2, 3)


def sides(name: str) -> list[tuple[str, str | None]]:
    return [(side.name, side.fitness) for side in describe(make(name)).sides]


def test_each_group_is_a_side_with_its_mean_reward() -> None:
    assert sides("mpe2.simple_tag_v3") == [("adversary", "reward_adversary"), ("agent", "reward_agent")]
    assert sides("mpe2.simple_spread_v3") == []
    assert sides("pettingzoo.classic.go_v5?board_size=3") == [
        ("black", "reward_black"),
        ("white", "reward_white"),
    ]


def test_players_of_a_game_are_a_side_each() -> None:
    players = [("player_1", "reward_player_1"), ("player_2", "reward_player_2")]
    assert sides(TICTACTOE) == players
    assert sides(f"{TICTACTOE}?group_by=agent") == players
    assert sides(f"{TICTACTOE}?group_by=kind") == []
    assert [name for name, _ in sides("mpe2.simple_spread_v3?N=2&group_by=agent")] == ["agent_0", "agent_1"]


def test_other_ways_to_group_are_refused() -> None:
    for value in ("side", "true", "1"):
        with pytest.raises(InputError, match=f"group_by={value.title() if value == 'true' else value} found"):
            make(f"{TICTACTOE}?group_by={value}")
    kind = type("Odd", (PettingZoo,), {"environment": TICTACTOE, "group_by": "side"})
    with pytest.raises(InputError, match=r"Odd.group_by: 'side' found, expected agent, kind or None"):
        kind()


def test_names_of_metrics_are_valid_and_differ(monkeypatch: pytest.MonkeyPatch) -> None:
    names = ["a.b_0", "a-b_0", "ä_0", "a b_0"]
    monkeypatch.setattr("in_turn.Counting.__init__", lambda self: setattr(self, "possible_agents", names))
    monkeypatch.setattr("in_turn.Counting.trouble", "none", raising=False)
    simulation = make("in_turn?new_each_episode=false")
    described = describe(simulation)
    assert [side.fitness for side in described.sides] == [
        "reward_a_b",
        "reward_a_b_2",
        "reward__",
        "reward_a_b_3",
    ]
    assert set(play(simulation, 2)) == set(described.metrics)


class Ordered(PettingZoo):
    """A class that declares its own groups and sides."""

    environment = "in_turn"
    groups = {"first": Group(1, 1, 3), "rest": Group(2, 1, 3), "none": Group(0, 1, 3)}  # noqa: RUF012
    sides = {"attack": Side(["first", "none"], "reward_first"), "rest": Side()}  # noqa: RUF012


def test_a_class_declares_its_own_groups_and_sides() -> None:
    simulation = Ordered()
    assert [(side.name, side.groups) for side in describe(simulation).sides] == [
        ("attack", ("first", "none")),
        ("rest", ("rest",)),
    ]
    simulation.new_each_episode = False  # type: ignore[misc]
    measured = play(simulation, 4)
    assert measured["reward_first"] == simulation._rewards[0]
    assert measured["reward_rest"] == simulation._rewards[1:].mean()
    assert np.isnan(measured["reward_none"])


def test_a_class_with_its_own_metrics_has_sides_without_fitness() -> None:
    kind = type("Own", (PettingZoo,), {"environment": TICTACTOE, "metrics": ("reward_player_2",)})
    assert [side.fitness for side in describe(kind()).sides] == [None, "reward_player_2"]


def test_a_class_of_pettingzoo_is_named_by_its_module() -> None:
    with pytest.raises(
        InputError, match=r"return it from env\(\) in the module, and write pettingzoo:in_turn"
    ):
        Experiment.from_mapping({"simulation": "in_turn.py:Counting"})


@pytest.mark.slow
def test_one_record_of_a_game_here_and_on_servers_in_every_mode(tmp_path: Path) -> None:
    experiment = Experiment.from_mapping(
        {
            "simulation": f"pettingzoo:{TICTACTOE}",
            "controller": {
                "kind": "team",
                "groups": {"player_1": {"hidden": []}, "player_2": {"hidden": []}},
            },
            "method": {"population": 6, "generations": 2},
            "fitness": "reward_player_1 - reward_player_2",
        }
    )
    run = optimize(experiment, servers="in-process", out=tmp_path / "here")
    for mode, servers in (("stepwise", 1), ("batched", 2), ("offloaded", 2)):
        same_record(optimize(experiment.replace(mode=mode), servers=servers, out=tmp_path / mode), run)

"""Every kind of controller can be drawn, and the drawing says what the controller is."""

import logging
from collections.abc import Sequence
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch
from PIL import Image

from swarmwright import InputError
from swarmwright.controllers.figures import Names, figure
from swarmwright.controllers.kinds.mealy_fsm.figure import find_transitions
from swarmwright.controllers.modules.grammar import states_of
from swarmwright.controllers.modules.machine_texts import condition_words, words_of
from swarmwright.display.figures.style import save
from swarmwright.simulations.catalogue import description
from tests.python.export.specifications import ALL, modules, tree

Specification = dict[str, Any]


def network(
    kind: str, sensors: int, hidden: Any, actuators: int, weights: Any = None, **more: Any
) -> Specification:
    sizes = [sensors, *(hidden if isinstance(hidden, list) else [hidden]), actuators]
    if kind == "layered":
        genes = sum(here * (before + 1) for before, here in pairwise(sizes))
    else:
        genes = sum(sizes[1:]) * (sum(sizes) + 1)
    drawn = np.random.default_rng(1).standard_normal(genes).tolist() if weights is None else weights * genes
    return {
        "version": 1, "kind": kind, "sensors": sensors, "hidden": hidden, "actuators": actuators,
        "activation": "tanh", "weights": drawn, **more,
    }  # fmt: skip


def machine(states: int, thresholds: list[list[float]], rows: Sequence[Sequence[float]]) -> Specification:
    return {
        "version": 1, "kind": "mealy_fsm", "sensors": len(thresholds), "actuators": len(rows[0]) - 1,
        "states": states, "thresholds": thresholds, "weights": [number for row in rows for number in row],
    }  # fmt: skip


def said(drawn: Figure) -> str:
    """Everything written on the figure."""
    from matplotlib.text import Text

    return "\n".join(text.get_text() for text in drawn.findobj(Text))


def flat(drawn: Figure) -> str:
    """The same in one line, wherever it was wrapped."""
    return " ".join(said(drawn).split())


def written(drawn: Figure, path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """It can be written, fills its picture, and matplotlib complains of nothing."""
    with caplog.at_level(logging.INFO):
        save(drawn, path / "x.png")
    assert [record.message for record in caplog.records if record.levelno >= logging.WARNING] == []
    with Image.open(path / "x.png") as picture:
        dark = np.asarray(picture.convert("L")) < 230
    rows, columns = np.flatnonzero(dark.any(axis=1)), np.flatnonzero(dark.any(axis=0))
    assert (rows[0], columns[0]) > (0, 0), "nothing is cut off"
    assert rows[-1] < dark.shape[0] - 1
    assert columns[-1] < dark.shape[1] - 1


@pytest.mark.parametrize(
    ("specification", "arrows"),
    [
        (network("layered", 4, [8], 1), 0),
        (network("layered", 10, [2], 2), 0),
        (network("layered", 1, [], 1), 0),
        (network("layered", 3, [5, 7, 4], 2), 0),
        (network("layered", 4, [3], 1, weights=[0.0]), 0),
        (network("layered", 4, [3], 1, weights=[1e30]), 0),
        # From 4 nodes to 4 nodes, without the 4 that go on from hidden ones to outputs.
        (network("fully_meshed", 10, 2, 2, iterations=2), 12),
        (network("fully_meshed", 4, 0, 1, iterations=1), 1),
        (network("fully_meshed", 4, 0, 3, iterations=1), 9),
    ],
    ids=["4-8-1", "10-2-2", "1-1", "deep", "zero", "huge", "meshed 10-2-2", "meshed 4-1", "meshed 4-3"],
)
def test_networks(
    specification: Specification, arrows: int, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    drawn = figure(specification, title="a $title")
    recurrent = drawn.findobj(FancyArrowPatch)
    assert len(recurrent) == arrows
    text = said(drawn)
    for name in ("a $title", "sensor 0", "actuator 0", "tanh", specification["kind"]):
        assert name in text
    written(drawn, tmp_path, caplog)


@pytest.mark.slow
def test_sensors_and_actuators_have_the_simulations_names() -> None:
    text = said(figure(network("layered", 4, [8], 1), simulation=description("minisim")))
    for name in ("goal x", "defender y", "heading"):
        assert name in text
    text = said(
        figure(network("fully_meshed", 10, 2, 2, iterations=2), simulation=description("emergency_exit"))
    )
    for name in ("exit y", "NW free", "move x"):
        assert name in text
    assert "sensor 2" in said(figure(network("layered", 3, [8], 1), simulation=description("minisim"))), (
        "it has 4"
    )


@pytest.mark.slow
def test_long_names_are_shortened(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    long = [f"{index}{'x' * 80}y" for index in range(14)]
    simulation = {"sensor_names": long[:4], "actuator_names": long}
    for specification in (
        network("fully_meshed", 4, 2, 14, iterations=2),
        network("layered", 4, [40], 14),  # matrices
        machine(2, [[0.5]] * 4, [[index % 2, *[0.5] * 14] for index in range(32)]),
    ):
        drawn = figure(specification, simulation=simulation)
        # Both ends: names of kinds of robots stand before those of sensors.
        assert f"1{'x' * 10}…{'x' * 11}y" in said(drawn)
        assert "x" * 12 not in said(drawn)
        written(drawn, tmp_path, caplog)


def test_strong_weights_are_wide_and_signs_have_colours() -> None:
    from matplotlib.collections import LineCollection

    weights = [0.0, 1.0, -4.0]  # the bias, two sensors
    drawn = figure({**network("layered", 2, [], 1), "weights": weights})
    (lines,) = drawn.findobj(LineCollection)
    weak, strong = np.asarray(lines.get_linewidth())
    assert strong > 3 * weak
    positive, negative = np.asarray(lines.get_colors())
    assert positive[2] > positive[0], "blue"
    assert negative[0] > negative[2], "orange"


@pytest.mark.parametrize("hidden", [[64, 64], [30], [2000]])
def test_large_networks_are_matrices(
    hidden: list[int], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    drawn = figure(network("layered", 10, hidden, 2), title="large", simulation=description("emergency_exit"))
    images = [image for axes in drawn.axes for image in axes.images]
    assert [image.get_array().shape for image in images] == [  # type: ignore[union-attr]
        (size, before + 1) for before, size in zip([10, *hidden], [*hidden, 2], strict=True)
    ]
    assert drawn.get_figheight() < 25
    written(drawn, tmp_path, caplog)


def test_a_machines_transitions_are_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    # One sensor in three intervals; state 0: to 1 above 0.5, else stay; 1: always back; 2: unused.
    rows = [(0, -1), (0, -0.5), (1, 1), (0, 0), (0, 0), (0, 0), (2, 0), (2, 0), (7.9, 5)]
    drawn = figure(machine(3, [[-0.5, 0.5]], rows), title="machine")
    text = said(drawn)
    assert "→ 0  when sensor 0 ≤ 0.5: actuator 0 -1 to -0.5" in text
    assert "→ 1  when sensor 0 > 0.5: actuator 0 1" in text
    assert "→ 0  always: actuator 0 0" in text
    assert "state 2 (never reached)" in text
    assert "→ 2  always: actuator 0 0 to 1" in text, "next states and outputs are limited to what there is"
    assert len(drawn.findobj(FancyArrowPatch)) == 4
    written(drawn, tmp_path, caplog)


def test_conditions_are_said_in_few_parts() -> None:
    # Two sensors in two intervals each: to 1 when exactly one of them is above 0.
    rows = [(0, 0), (1, 0), (1, 0), (0, 0)] * 2
    text = flat(figure(machine(2, [[0], [0]], rows)))
    assert "→ 1 when sensor 0 ≤ 0, sensor 1 > 0; or sensor 0 > 0, sensor 1 ≤ 0: " in text
    # To 1 when either is above 0: parts may overlap.
    rows = [(0, 0), (1, 0), (1, 0), (1, 0)] * 2
    text = flat(figure(machine(2, [[0], [0]], rows)))
    assert (
        "→ 1 when sensor 1 > 0; or sensor 0 > 0: " in text
        or "→ 1 when sensor 0 > 0; or sensor 1 > 0: " in text
    )
    assert "→ 0 when sensor 0 ≤ 0, sensor 1 ≤ 0: " in text
    # A checkerboard has too many parts.
    rows = [(index.bit_count() % 2, 0) for index in range(16)] * 2
    text = flat(figure(machine(2, [[0]] * 4, rows)))
    assert "→ 1 in 8 of 16 cases, such as sensor 0 ≤ 0, sensor 1 ≤ 0," in text


@pytest.mark.slow
@given(st.lists(st.integers(0, 2), min_size=24, max_size=24))
def test_exact_conditions_hold_for_their_rows_alone(targets: list[int]) -> None:
    thresholds = [[0.0], [-0.5, 0.5], [-1.0, 0.0, 1.0]]
    specification = machine(3, thresholds, [(target, 0) for target in targets] * 3)
    values = [[-1.0, 1.0], [-1.0, 0.0, 1.0], [-2.0, -0.5, 0.5, 2.0]]  # one within each interval
    for one in find_transitions(specification, Names.from_specification(specification)):
        for index, sensed in enumerate(product(*values)):
            holds = any(
                all(_holds(part, sensed) for part in box.split(", ") if part)
                for box in one.condition.split("; or ")
            )
            if one.exact:
                assert holds == (targets[index] == one.target)
            elif holds:
                assert targets[index] == one.target


def _holds(words: str, sensed: tuple[float, ...]) -> bool:
    number = words.index("sensor ") + len("sensor ")
    value = sensed[int(words[number])]
    condition = words.replace(f"sensor {words[number]}", repr(value)).replace("≤", "<=")
    return bool(eval(condition))  # `-0.5 < 0.0 <= 0.5`


@pytest.mark.slow
@pytest.mark.parametrize("states", [1, 2, 16, 17, 300])
def test_machines_of_any_size(states: int, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    random = np.random.default_rng(1)
    rows = np.column_stack([random.integers(0, states, states * 8), random.uniform(-1, 1, states * 8)])
    drawn = figure(machine(states, [[0.0], [], [-0.5, 0, 0.5]], rows.tolist()), title="machine")
    assert drawn.get_figheight() <= 14
    written(drawn, tmp_path, caplog)


def test_parameters_lie_on_their_ranges(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    specification = {
        "version": 1, "kind": "parameter_set", "weights": [0.5, 3.9, 1.2, 0.01, 7.0],
        "parameters": [
            {"name": "speed", "type": "real"}, {"name": "agents", "type": "integer"},
            {"name": "way", "type": "categorical", "choices": ["left", "right"]},
            {"name": "gain", "type": "real"},
            {"name": "many", "type": "categorical", "choices": [f"choice {index}" for index in range(9)]},
        ],
    }  # fmt: skip
    options = {
        "parameters": {
            "speed": {"range": [0, 2]}, "agents": {"range": [1, 9]},
            "gain": {"range": [1e-4, 1], "scale": "log"},
        }
    }  # fmt: skip
    drawn = figure(specification, options=options)
    text = said(drawn)
    for shown in ("speed", "0.5", "3", "right", "gain", "logarithmic", "choice 7", "one of 9"):
        assert shown in text
    places = [line.get_xdata()[0] for line in drawn.axes[0].lines if line.get_marker() == "o"]  # type: ignore[index]
    assert places == pytest.approx([0.25, 0.25, 0.5])
    written(drawn, tmp_path, caplog)
    assert "3" in said(figure(specification)), "without ranges the values alone"


def test_other_kinds_are_refused() -> None:
    with pytest.raises(InputError, match="'magic' cannot be drawn"):
        figure({"kind": "magic"})


def test_evosticks_network() -> None:
    weights = [float(number) for number in np.random.default_rng(3).uniform(-5, 5, 50)]
    drawn = figure({"version": 1, "kind": "evostick", "sensors": 24, "actuators": 2, "weights": weights})
    text = said(drawn)
    for name in ("evostick 24-2", "sensor 23", "actuator 1"):
        assert name in text


def test_a_network_that_learns() -> None:
    weights = [0.0625, *np.random.default_rng(3).uniform(-2, 2, 4 * 15).tolist()]
    sizes = {"sensors": 10, "actuators": 2, "hidden": 2, "iterations": 2}
    drawn = figure({"version": 1, "kind": "hebbian", **sizes, "weights": weights})
    for name in ("hebbian 10-2-2, learning rate 0.062", "sensor 9", "actuator 1", "and to itself"):
        assert name in said(drawn)


@pytest.mark.slow
@pytest.mark.parametrize("hidden", [2, 30])
def test_a_network_with_given_connections(hidden: int) -> None:
    """Two connections between the same nodes are drawn, too; many nodes become matrices."""
    nodes = 3 + hidden + 1
    sources = [*[[0, 1, nodes - 1]] * hidden, [3, *range(3, 3 + hidden), 2, nodes - 1]]
    weights = np.random.default_rng(3).uniform(-2, 2, 5 * hidden + 5).tolist()
    sizes = {"sensors": 3, "actuators": 1, "sources": sources, "iterations": 3}
    text = said(figure({"version": 1, "kind": "neat", **sizes, "weights": weights}))
    for name in (f"neat 3-{hidden}-1, tanh, at the actuators sigmoid", "sensor 2", "actuator 0"):
        assert name in text


@pytest.mark.parametrize(("states", "seed"), [(4, 1), (1, 2), (16, 3)])
def test_machines_of_modules(
    states: int, seed: int, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    specification = modules(states, 4, seed)
    drawn = figure(specification, title="a $title")
    found = states_of(specification)
    assert len(found) == states
    arrows = sum(len({one.target for one in state.transitions}) for state in found)
    assert len(drawn.findobj(FancyArrowPatch)) == arrows
    text = flat(drawn)
    for state in found:
        assert words_of(state) in text
        for transition in state.transitions:
            assert words_of(transition) in text
    written(drawn, tmp_path, caplog)


@pytest.mark.parametrize(("subtrees", "seed"), [(4, 1), (1, 2)])
def test_trees_of_modules(subtrees: int, seed: int, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    specification = tree(subtrees, seed)
    drawn = figure(specification, title="a $title")
    text = flat(drawn)
    for subtree in states_of(specification):
        assert words_of(subtree) in text.replace("- ", "-")  # where a line ends
        assert condition_words(subtree) in text
    assert f"tree of {len(states_of(specification))} subtree" in text
    assert "sequence*: sequence with memory" in text
    assert "?: selector" in text
    written(drawn, tmp_path, caplog)


def test_groups_of_a_team_have_names_of_their_own_sensors(monkeypatch: pytest.MonkeyPatch) -> None:
    """The drawings of groups are pictures in that of the team: what they were given is looked at."""
    from swarmwright.controllers import kinds
    from swarmwright.controllers.kinds.team import figure as of_team

    parts = {
        "scouts": network("layered", 2, [], 1, output_range=[-1, 1]),
        "guards": network("layered", 3, [], 1, output_range=[-1, 1]),
    }
    team = {
        "kind": "team", "version": 1,
        "groups": [
            {"name": name, "agents": 2, "controller": {k: v for k, v in part.items() if k != "weights"}}
            for name, part in parts.items()
        ],
        "weights": [weight for part in parts.values() for weight in part["weights"]],
    }  # fmt: skip
    simulation = {
        "sensor_names": [], "actuator_names": [],
        "groups": [
            {"name": "scouts", "sensor_names": ["near", "far"], "actuator_names": ["ahead"]},
            {"name": "guards", "sensor_names": ["a", "b", "c"], "actuator_names": ["turn"]},
        ],
    }  # fmt: skip
    drawn = []
    draw = kinds.draw_controller

    def watched(*one: Any, **named: Any) -> Any:
        drawn.append(draw(*one, **named))
        return drawn[-1]

    monkeypatch.setattr(of_team, "draw_controller", watched)
    figure(team, simulation=simulation)
    scouts, guards = map(said, drawn)
    assert all(name in scouts for name in ("near", "far", "ahead"))
    assert all(name in guards for name in ("a", "b", "c", "turn"))


def test_a_network_of_which_no_node_sees_anything(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    drawn = figure(ALL["neat-deaf"])
    for name in ("sensor 0", "actuator 0", "neat"):
        assert name in said(drawn)
    written(drawn, tmp_path, caplog)

"""Diagrams of state machines can be read: nothing covers a label, and states have colours of their own."""

from itertools import combinations
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.colors import to_hex
from matplotlib.patches import Circle, FancyArrowPatch

from swarmwright.controllers import kinds
from swarmwright.controllers.diagram import Arrow, Diagram, Node, new_figure_with_list
from swarmwright.controllers.figures import figure
from swarmwright.controllers.kinds.team import figure as of_team
from swarmwright.controllers.modules.grammar import states_of
from swarmwright.display.machines import state_color
from tests.python.controllers.test_figures import machine
from tests.python.export.specifications import modules


@st.composite
def machines(draw: st.DrawFn) -> tuple[list[Node], list[Arrow]]:
    """Up to 16 states with up to four targets each."""
    count = draw(st.integers(1, 16))
    states = st.integers(0, count - 1)
    labels = st.sampled_from(["1", "2, 3", "1, 2, 3, 4", "1,024"])
    arrows = [
        Arrow(source, target, draw(labels))
        for source in range(count)
        for target in sorted(draw(st.sets(states, max_size=4)))
    ]
    name = draw(st.sampled_from(["", "exploration", "anti-phototaxis"]))
    return [Node(name)] * count, arrows


@pytest.mark.slow
@given(machines())
@settings(max_examples=60, deadline=None)
def test_labels_lie_beside_each_other_and_beside_states(made: tuple[list[Node], list[Arrow]]) -> None:
    diagram = Diagram(*made)
    boxes = [box for box in diagram.labels if box is not None]
    for one, other in combinations(boxes, 2):
        apart = one[2] <= other[0] or other[2] <= one[0] or one[3] <= other[1] or other[3] <= one[1]
        assert apart, (one, other)
    for left, low, right, high in boxes:
        for x, y in diagram.positions:
            nearest = np.clip(x, left, right) - x, np.clip(y, low, high) - y
            assert np.hypot(*nearest) > diagram.radius
        assert max(abs(left), abs(low), abs(right), abs(high)) < diagram.size / 2, "nothing is cut off"
    assert len(boxes) >= 0.9 * len(made[1]) - 1, "few are without space"
    for place, near in combinations(diagram.positions, 2):
        assert np.hypot(place[0] - near[0], place[1] - near[1]) > 2 * diagram.radius


@pytest.mark.parametrize(("states", "seed"), [(4, 1), (8, 2), (8, 3), (16, 4), (16, 5)])
def test_what_is_written_lies_in_its_box(states: int, seed: int) -> None:
    """As matplotlib draws it, no label lies on another or on a state."""
    drawn = figure(modules(states, 4, seed))
    drawn.canvas.draw()
    labels = [text for text in drawn.axes[0].texts if text.get_gid() == "label"]
    arrows = drawn.findobj(FancyArrowPatch)
    assert len(labels) == len(arrows) > 0
    boxes = [text.get_bbox_patch().get_window_extent() for text in labels]  # type: ignore[union-attr]
    for one, other in combinations(boxes, 2):
        assert not one.overlaps(other), (one, other)
    for circle in drawn.findobj(Circle):
        around = circle.get_window_extent()
        middle, radius = np.array([around.x0 + around.x1, around.y0 + around.y1]) / 2, around.width / 2
        for box in boxes:
            nearest = np.clip(middle, [box.x0, box.y0], [box.x1, box.y1])
            assert np.hypot(*(nearest - middle)) > radius


@pytest.mark.slow
@given(machines())
@settings(max_examples=30, deadline=None)
def test_both_ways_between_two_states_are_apart(made: tuple[list[Node], list[Arrow]]) -> None:
    diagram = Diagram(*made)
    middles = {
        (one.source, one.target): way.along[len(way.along) // 2]
        for one, way in zip(made[1], diagram.ways, strict=True)
    }
    for (source, target), middle in middles.items():
        if source < target and (target, source) in middles:
            assert np.hypot(*(middle - middles[target, source])) > 0.1


def test_states_have_the_colours_of_episodes() -> None:
    drawn = figure(modules(16, 4, 2))
    rings = [to_hex(circle.get_edgecolor()).upper() for circle in drawn.findobj(Circle)]
    assert rings == [state_color(state) for state in range(16)]


def test_groups_of_a_team_have_colours_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    parts = {"scouts": modules(3, 2, 1), "carriers": modules(2, 2, 2)}
    team = {
        "kind": "team", "version": 1,
        "groups": [
            {"name": name, "controller": {key: value for key, value in part.items() if key != "weights"}}
            for name, part in parts.items()
        ],
        "weights": [weight for part in parts.values() for weight in part["weights"]],
    }  # fmt: skip
    drawn = []
    draw = kinds.draw_controller

    def watched(*one: Any, **named: Any) -> Any:
        drawn.append(draw(*one, **named))
        return drawn[-1]

    monkeypatch.setattr(of_team, "draw_controller", watched)
    figure(team)
    rings = [to_hex(circle.get_edgecolor()).upper() for group in drawn for circle in group.findobj(Circle)]
    states = sum(len(states_of(part)) for part in parts.values())
    assert rings == [state_color(index) for index in range(states)], "as on pages"


def test_many_transitions_are_a_matrix_with_numbers() -> None:
    random = np.random.default_rng(1)
    rows = np.column_stack([random.integers(0, 16, 16 * 16), random.uniform(-1, 1, 16 * 16)]).tolist()
    drawn = figure(machine(16, [[0.0], [0.5], [0.1], [0.2]], rows))
    assert not drawn.findobj(FancyArrowPatch)
    (picture,) = drawn.axes[0].images
    shares = np.asarray(picture.get_array())
    written = sorted(int(text.get_text()) for text in drawn.axes[0].texts)
    assert written == sorted((shares[shares > 0] * 16).round().astype(int).tolist())


def test_a_long_list_has_columns_and_says_what_is_left_out() -> None:
    blocks = [[f"state {index}", "  a", "  b"] for index in range(60)]
    drawn, _ = new_figure_with_list("", "", 7.0, blocks, letters=20)
    columns = [text.get_text().split("\n") for text in drawn.texts[:-2]]
    assert len(columns) == 3
    assert all(column[0].startswith("state") for column in columns), "states stay together"
    assert [line for column in columns for line in column] == [line for block in blocks for line in block]
    drawn, _ = new_figure_with_list("", "", 7.0, blocks, letters=20, highest=5.0)
    assert drawn.get_figheight() < 9
    shown = "\n".join(text.get_text() for text in drawn.texts[:-2]).split("\n")
    assert shown[-1] == f"and {180 - len(shown) + 1} lines more"

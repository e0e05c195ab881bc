from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.patches import Rectangle
from PIL import Image

from swarmwright import Controller, Experiment, _engine
from swarmwright.common.random_numbers import Stream
from swarmwright.display import Body, Recording, Scene, Wall, record
from swarmwright.display.drawing import LEFT, RIGHT, STATUS, WIDTH, Picture, cell_step
from swarmwright.display.files import save


def texts(picture: Picture) -> dict[str, Any]:
    """Everything written on the picture."""
    return {text.get_text(): text for axes in picture.figure.axes for text in axes.texts}


def test_still_shows_the_whole_way(crossing: Any, tmp_path: Path) -> None:
    path = tmp_path / "crossing.png"
    save(record(crossing), path)
    with Image.open(path) as still:
        assert still.width >= 1000
        # A line of one colour runs from the start to the goal: more than half of the width.
        pixels = np.asarray(still.convert("RGB")).astype(int)
    greenish = (pixels[:, :, 1] > pixels[:, :, 0] + 40) & (pixels[:, :, 1] > pixels[:, :, 2])
    assert greenish.sum(axis=1).max() > pixels.shape[1] / 2


@pytest.mark.parametrize("message", ["costs $5 or \\frac{", "", "x" * 500, "two\nlines", "日本語 🤖"])
def test_any_message_can_be_shown(crossing: Any, tmp_path: Path, message: str) -> None:
    crossing.message = message
    save(record(crossing), tmp_path / "message.png")
    assert (tmp_path / "message.png").stat().st_size > 5000


@pytest.mark.parametrize("sign", ["W", "i"])
def test_a_long_message_ends_before_step_and_fitness(crossing: Any, sign: str) -> None:
    crossing.message = sign * 300
    picture = Picture(record(crossing), dpi=80)
    (title,) = (text for shown, text in texts(picture).items() if shown.startswith(sign))
    right = title.get_window_extent().x1 / 80
    assert WIDTH - RIGHT - STATUS - 0.2 < right < WIDTH - RIGHT - STATUS + 0.1 or sign == "i"
    assert right < WIDTH - RIGHT - STATUS + 0.1
    assert right > LEFT + 1


def test_the_heading_shows_the_fitness_so_far(crossing: Any) -> None:
    recording = record(crossing)
    picture = Picture(recording, dpi=80)
    for step, shown in ((0, "step 0 of 12   fitness -12"), (7, "step 7 of 12   fitness -5")):
        artists = picture.draw(recording.scenes[step], step)
        assert shown in texts(picture)
        for artist in artists:
            artist.remove()


def test_cells_are_numbered_from_the_top_left_at_their_middle() -> None:
    field = {"width": 8, "height": 3, "exits": [[7, 0]], "agents": [[0, 2]], "blockades": []}
    experiment = Experiment.from_mapping(
        {"simulation": "emergency_exit", "parameters": {"field": field}, "servers": "local"}
    )
    representation = experiment.representation()
    controller = Controller(representation.specification(representation.initial(Stream(1, "initial"))))
    episode = _engine.Episode("emergency_exit", experiment.parameters, controller.json)
    recording = record(episode)
    assert recording.scenes[0].grid
    axes = Picture(recording, dpi=80).figure.axes[0]
    rows = [
        (label.get_text(), at) for label, at in zip(axes.get_yticklabels(), axes.get_yticks(), strict=True)
    ]
    assert rows == [("0", 2.5), ("1", 1.5), ("2", 0.5)]
    columns = [(x.get_text(), at) for x, at in zip(axes.get_xticklabels(), axes.get_xticks(), strict=True)]
    assert columns == [(str(i), i + 0.5) for i in range(8)]
    exit_, agent = recording.scenes[0].bodies
    assert (exit_.x, exit_.y) == (7.5, 2.5), "column 7, row 0"
    assert (agent.x, agent.y) == (0.5, 0.5), "column 0, row 2"


def test_numbers_are_in_the_coordinates_of_the_simulation() -> None:
    scene = Scene(3.1, 2.35, 0, "", [Body("agent", 1.55, 1.05)], origin=(-1.55, -1.05))
    axes = Picture(Recording((scene,), (0.0,), 0.1), dpi=80).figure.axes[0]
    for axis, low, expected in ((axes.xaxis, 1.55, ["−1", "0", "1"]), (axes.yaxis, 1.05, ["−1", "0", "1"])):
        shown = [label.get_text() for label in axis.get_ticklabels()]
        assert shown == expected
        places = [float(label.replace("−", "-")) + low for label in shown]
        np.testing.assert_allclose(axis.get_ticklocs(), places, atol=1e-12)


@pytest.mark.parametrize("grid", [True, False])
def test_maps_say_their_unit_and_have_a_frame(grid: bool) -> None:
    scene = Scene(3, 2, 0, "", [Body("agent", 1, 1)], grid=grid, walls=[Wall([(0, 1), (1, 1)])])
    picture = Picture(Recording((scene,), (0.0,), 0.1), dpi=80)
    assert ("m" in texts(picture)) == (not grid)
    patches = picture.figure.axes[0].patches
    frames = [one for one in patches if isinstance(one, Rectangle) and not one.get_fill()]
    assert [one.get_bbox().bounds for one in frames] == [(0, 0, 3, 2)]


@pytest.mark.parametrize(("cells", "step"), [(1, 1), (12, 1), (13, 2), (24, 2), (30, 5), (1000, 100)])
def test_numbers_of_cells_leave_each_other_room(cells: int, step: int) -> None:
    assert cell_step(cells) == step


def test_the_legend_of_a_still_has_what_is_on_it() -> None:
    """A film has one legend for all scenes; a still shows the last one."""
    scenes = [Scene(3, 2, step, "", [Body("agent", 1, 1, state=state)]) for step, state in enumerate("abc")]
    recording = Recording(tuple(scenes), (0.0,) * 3, 0.1)
    for still, names in ((False, ["agent, a", "agent, b", "agent, c"]), (True, ["agent, c"])):
        (legend,) = Picture(recording, dpi=80, still=still).figure.legends
        assert [text.get_text() for text in legend.get_texts()] == names

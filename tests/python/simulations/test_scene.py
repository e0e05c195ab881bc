"""Simulations in Python are shown as built-in ones are, and what is wrong with a scene is said."""

import dataclasses
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from swarmwright import Experiment, RunError, Simulation, optimize
from swarmwright.display import Body, Light, Patch, Ray, Scale, Scene, Style, Wall, record
from swarmwright.display.files import save
from swarmwright.runs.replay import Replay


class Seen(Simulation):
    """One agent that walks, with a scene that may be wrong."""

    sensors = actuators = 1
    frame_seconds = 0.25
    parameters = {"scene": "good"}  # noqa: RUF012

    def reset(self, parameters: dict[str, Any], seed: int) -> Any:
        self.kind, self.x, self.steps = parameters["scene"], float(seed), 0
        return [[self.x]]

    def step(self, actions: Any) -> Any:
        self.x += float(actions[0, 0])
        self.steps += 1
        return [[self.x]]

    def done(self) -> bool:
        return self.steps == 4

    def fitness(self) -> float:
        return -abs(self.x)

    def scene(self) -> Any:
        bodies = [Body("pond", 1, 1, radius=0.5), Body("agent", self.x, 2.0, "crashed")]
        return {
            "good": Scene(5, 4, self.steps, "walking", bodies),
            "none": None,
            "text": "a view",
            "nan": Scene(5, 4, 0, "", [Body("agent", float("nan"), 0)]),
            "step": Scene(5, 4, -1, "", bodies),
        }[self.kind]


def replay(scene: str, folder: Path) -> Replay:
    experiment = Experiment.from_mapping(
        {
            "simulation": Seen,
            "parameters": {"scene": scene, "seed": 2},
            "method": {"population": 4, "generations": 1},
        }
    )
    return Replay.of(optimize(experiment, servers="in-process", out=folder))


@pytest.mark.slow
def test_it_is_replayed(tmp_path: Path) -> None:
    played = replay("good", tmp_path / "run")
    recording = record(played.episode())
    assert len(recording.scenes) == 5
    assert recording.step_size == 0.25
    assert recording.fitness == played.run.best.fitness
    first = recording.scenes[0]
    assert (first.width, first.height, first.message) == (5, 4, "walking")
    assert first.bodies == (Body("pond", 1, 1, "", 0.5), Body("agent", 2, 2, "crashed", 0))
    for ending in ("gif", "png", "html"):
        save(recording, tmp_path / f"x.{ending}")
    with Image.open(tmp_path / "x.gif") as film:
        assert film.n_frames > 5  # type: ignore[attr-defined]
    text = played.episode().text(60, False, 20, True)
    assert "walking" in text
    assert "crashed 1" in text


@pytest.mark.parametrize(
    ("scene", "words"),
    [
        ("none", "this simulation has nothing to show"),
        ("text", r"Seen.scene: 'a view' returned, expected a swarmwright.display.Scene or None"),
        ("nan", r"Seen.scene: .* returned: bodies\[0\].x: nan found, expected a finite number"),
        ("step", r"seen: scene\.step: -1 found, expected a whole number"),
    ],
)
def test_a_scene_that_is_none(scene: str, words: str, tmp_path: Path) -> None:
    from swarmwright.common.errors import engine_errors

    episode = replay(scene, tmp_path / "run").episode()
    with pytest.raises(RunError, match=words), engine_errors():
        episode.scene()


@dataclass
class Wrong:
    """A scene with something wrong, and what is said about it."""

    scene: Scene
    words: str


def body(**other: Any) -> Body:
    return Body("agent", 1, 1, **other)


WRONG = {
    "heading": Wrong(
        Scene(5, 4, 0, "", [body(heading="north")]),
        r"bodies\[0\].heading: 'north' found, expected a number",
    ),
    "heading as text": Wrong(
        Scene(5, 4, 0, "", [body(heading="1.18")]),
        r"bodies\[0\].heading: the text '1.18' found, expected a number",
    ),
    "heading nan": Wrong(
        Scene(5, 4, 0, "", [body(heading=math.nan)]),
        r"bodies\[0\].heading: nan found, expected a finite",
    ),
    "value": Wrong(
        Scene(5, 4, 0, "", [body(value=[1])]),
        r"bodies\[0\].value: \[1\] found, expected a number",
    ),
    "radius": Wrong(
        Scene(5, 4, 0, "", [body(radius=-1)]),
        r"bodies\[0\].radius: -1 found, expected at least 0",
    ),
    "kind": Wrong(
        Scene(5, 4, 0, "", [Body(3, 1, 1)]),  # type: ignore[arg-type]
        r"bodies\[0\].kind: 3 found, expected text",
    ),
    "empty kind": Wrong(
        Scene(5, 4, 0, "", [Body("", 1, 1)]),
        r"bodies\[0\].kind: is empty",
    ),
    "body": Wrong(
        Scene(5, 4, 0, "", ["agent"]),  # type: ignore[list-item]
        r"bodies\[0\]: 'agent' found, expected a swarmwright.display.Body",
    ),
    "agent": Wrong(
        Scene(5, 4, 0, "", [body(agent=-1)]),
        r"bodies\[0\].agent: -1 found, expected at least 0",
    ),
    "origin": Wrong(
        Scene(5, 4, 0, "", [], origin=(math.inf, 0)),
        r"origin\[0\]: inf found, expected a finite number",
    ),
    "no origin": Wrong(
        Scene(5, 4, 0, "", [], origin=3),  # type: ignore[arg-type]
        "origin: 3 found, expected x and y",
    ),
    "ray": Wrong(
        Scene(5, 4, 0, "", [body(rays=[Ray(0, 1, reading=2)])]),
        r"bodies\[0\].rays\[0\].reading: 2 found, expected from 0 to 1",
    ),
    "floor": Wrong(
        Scene(5, 4, 0, "", [], floor=2),
        "floor: 2 found, expected from 0 to 1",
    ),
    "patch": Wrong(
        Scene(5, 4, 0, "", [], patches=[Patch(0, [(0, 0), (1, 1)])]),
        r"patches\[0\].points: 2 points found, expected one",
    ),
    "point": Wrong(
        Scene(5, 4, 0, "", [], walls=[Wall([(0, 0), 7])]),  # type: ignore[list-item]
        r"walls\[0\].points\[1\]: 7 found, expected x and y",
    ),
    "wall": Wrong(
        Scene(5, 4, 0, "", [], walls=[Wall([(0, 0), (1, 1)], solid=True)]),
        r"walls\[0\].points: 2 found, expected at least 3",
    ),
    "link": Wrong(
        Scene(5, 4, 0, "", [body()], links=[(0, 1)]),
        r"links\[0\]: \(0, 1\) found, expected indices of the 1 bodies",
    ),
    "color": Wrong(
        Scene(5, 4, 0, "", [], styles=[Style("agent", color="blue")]),
        r'styles\[0\].color: \'blue\' found, expected "#rrggbb"',
    ),
    "shape": Wrong(
        Scene(5, 4, 0, "", [], styles=[Style("agent", shape="ring")]),
        r"styles\[0\].shape: 'ring' found, expected one of circle",
    ),
    "scale": Wrong(
        Scene(5, 4, 0, "", [], scale=Scale("x", 1, 1)),
        "scale: from 1 to 1, expected low to be less than high",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_cannot_be_drawn_is_said_with_its_place(name: str) -> None:
    wrong = WRONG[name]
    with pytest.raises((ValueError, TypeError), match=wrong.words):
        wrong.scene.plain()


WHOLE = Scene(
    5, 4, 3, "all",
    [Body("robot", 1, 2, "busy", 0.5, 0.25, 0.75, "R1", 1, (Ray(0.5, 1.0, 0.25, 0.5),)), Body("base", 3, 3)],
    floor=Patch(0.5, ((0.0, 0.0), (5.0, 0.0), (5.0, 4.0))), patches=(Patch.circle(1, 1, 0.5, 0, "spot"),),
    walls=(Wall(((0.0, 0.0), (1.0, 1.0))),), lights=(Light(1, 1, 0),), links=[(0, 1)],
    styles=(Style("robot", "busy", "#102030", "diamond"),), scale=Scale("load", 0, 2),
)  # fmt: skip


class Whole(Seen):
    """With all that a scene can have."""

    def scene(self) -> Any:
        return WHOLE


def test_all_of_a_scene_comes_through_the_engine(tmp_path: Path) -> None:
    experiment = Experiment.from_mapping(
        {"simulation": Whole, "parameters": {"seed": 2}, "method": {"population": 4, "generations": 1}}
    )
    replayed = Replay.of(optimize(experiment, servers="in-process", out=tmp_path / "run"))
    episode: Any = replayed.episode()
    assert Scene.from_fields(episode.scene()) == dataclasses.replace(WHOLE, bodies=tuple(WHOLE.bodies))
    first = record(episode).scenes[0]
    assert list(first.bodies) == WHOLE.bodies
    assert np.asarray(first.links).tolist() == [[0, 1]]
    assert dataclasses.replace(first, bodies=WHOLE.bodies, links=WHOLE.links) == WHOLE

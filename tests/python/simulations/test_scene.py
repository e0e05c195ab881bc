"""Simulations in Python are shown as built-in ones are, and what is wrong with a scene is said."""

from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from swarmwright import Experiment, RunError, Simulation, optimize
from swarmwright.display import Body, Scene, record
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
        ("step", r"seen: scene: invalid value: integer `-1`"),
    ],
)
def test_a_scene_that_is_none(scene: str, words: str, tmp_path: Path) -> None:
    from swarmwright.core.errors import engine_errors

    episode = replay(scene, tmp_path / "run").episode()
    with pytest.raises(RunError, match=words), engine_errors():
        episode.scene()

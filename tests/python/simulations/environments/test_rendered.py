"""Environments that draw themselves are replayed in pictures, which change nothing about the episode."""

import io
import json
import sys
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from PIL import Image

from swarmwright import Experiment, InputError, Run, optimize
from swarmwright.display import pictures as recording
from swarmwright.display.files import FORMATS
from swarmwright.display.pictures import PictureRecording, record, save
from swarmwright.runs.replay import Replay
from swarmwright.simulations import attached
from swarmwright.simulations.gymnasium import Gymnasium
from swarmwright.simulations.host import choose_display, make_drawing_class

CART = "gymnasium:CartPole-v1"
SPREAD = "pettingzoo:mpe2.simple_spread_v3?max_cycles=6"


def evolved(name: str, folder: Path, **changes: Any) -> Run:
    experiment = {
        "simulation": name,
        "controller": {"kind": "layered", "hidden": []},
        "method": {"population": 4, "generations": 1},
        **changes,
    }
    return optimize(Experiment.from_mapping(experiment), servers="local", out=folder)


@pytest.mark.slow
@pytest.mark.parametrize("name", [CART, SPREAD])
def test_the_pictures_are_those_of_the_recorded_episode(name: str, tmp_path: Path) -> None:
    run = evolved(name, tmp_path / "run", parameters={"seed": 5})
    replay = Replay.of(run)
    pictures = replay.pictures()
    assert pictures.fitness == run.best.fitness
    assert len(pictures.pictures) == len(pictures.fitness_so_far)
    assert pictures.steps == tuple(range(len(pictures.fitness_so_far)))
    assert len(set(pictures.pictures)) > len(pictures.pictures) / 2
    assert replay.outcome(pictures.fitness).count("Fitness") == 1
    assert "in the run: this simulation is not bit-identical here" in replay.outcome(pictures.fitness + 1)


@pytest.mark.slow
def test_a_picture_is_what_the_environment_renders(tmp_path: Path) -> None:
    run = evolved(CART, tmp_path / "run", parameters={"seed": 5})
    pictures = Replay.of(run).pictures()
    env = gymnasium.make("CartPole-v1", render_mode="rgb_array")
    env.reset(seed=5)
    drawn: Any = env.render()
    assert np.array_equal(np.asarray(pictures.image(0)), drawn)
    assert pictures.step_size == pytest.approx(1 / env.metadata["render_fps"])


@pytest.mark.slow
def test_every_file_from_the_command_line(program: Any, tmp_path: Path) -> None:
    evolved(SPREAD, tmp_path / "run")
    for ending in FORMATS:
        shown = program("replay", "run", "--save", f"x{ending}", "--json")
        assert (shown.returncode, shown.stderr) == (0, ""), ending
        assert json.loads(shown.stdout)["steps"] == 6  # and nothing that libraries say
        assert (tmp_path / f"x{ending}").stat().st_size > 1000
    with Image.open(tmp_path / "x.gif") as animation:
        assert 4 <= animation.n_frames <= 7  # type: ignore[attr-defined] # equal ones are one
    page = (tmp_path / "x.html").read_text()
    assert page.count("data:image/jpeg;base64,") == 7
    assert '"picture_steps":[0,1,2,3,4,5,6]' in page
    told = program("replay", "run")
    assert told.returncode == 0
    assert told.stdout.count("\nstep ") == 7
    assert "@" in told.stdout
    scenes = program("replay", "run", "--json")
    assert scenes.returncode == 2
    assert "draws pictures instead of scenes; use --save FILE.html, .gif, .mp4 or .png" in scenes.stderr


@pytest.mark.slow
@pytest.mark.parametrize("name", [CART, None])
def test_the_hint_to_watch_stands_where_there_is_something_to_see(
    program: Any, tmp_path: Path, name: str | None
) -> None:
    (tmp_path / "walk.py").write_text(WALK)
    if name is None:
        name = "walk.py:Walk"
    for simulation, seen in ((name, True), ("walk.py:Blind", False)):
        (tmp_path / "x.yaml").write_text(
            f"simulation: {simulation}\ncontroller: {{kind: layered, hidden: []}}\n"
            "method: {population: 3, generations: 1}\n"
        )
        done = program("optimize", "x.yaml", "--servers", "local", "--out", f"run-{seen}")
        assert done.returncode == 0, done.stderr
        assert ("Watch the best controller:" in done.stdout) == seen
        assert (f"replay run-{seen}" in done.stdout) == seen
    nothing = program("replay", "run-False")
    assert nothing.returncode == 2
    assert "Blind has nothing to display; add a method scene()" in nothing.stderr


WALK = """
import numpy as np
from swarmwright import Simulation
from swarmwright.display import Scene

class Blind(Simulation):
    sensors = 1
    actuators = 1
    def reset(self, parameters, seed):
        self.n = 0
        return np.zeros((1, 1))
    def step(self, actions):
        self.n += 1
        return np.zeros((1, 1))
    def done(self):
        return self.n == 2
    def fitness(self):
        return float(self.n)

class Walk(Blind):
    def scene(self):
        return Scene(4, 4, self.n, "walk", [])
"""


class Drawn(Gymnasium):
    """A make() of somebody's own that does not hand its options on."""

    environment = "CartPole-v1"

    def make(self, options: dict[str, Any]) -> Any:
        del options
        return gymnasium.make(self.environment)


def test_environments_that_cannot_render_say_why(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(gymnasium.make("CartPole-v1").unwrapped.metadata, "render_modes", ["ansi"])
    for ask in (choose_display, make_drawing_class):
        with pytest.raises(InputError, match=r"pictures need the render mode rgb_array"):
            ask(type("Other", (Drawn,), {}))
    monkeypatch.undo()
    assert choose_display(Drawn) == "picture"
    with pytest.raises(InputError, match=r"Drawn CartPole-v1: cannot be rendered, because .*options to"):
        make_drawing_class(Drawn)


def test_what_rendering_needs_and_is_not_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pygame", None)
    with pytest.raises(InputError, match=r"CartPole-v1: cannot be rendered: .*pygame is not installed"):
        make_drawing_class.__wrapped__(attached.load_adapter(CART))


class Steps:
    """An episode of so many steps, whose pictures say how many there were."""

    fitness = 0.0
    step_size = 0.1

    def __init__(self, count: int) -> None:
        self.count = count
        self.now = 0

    @property
    def done(self) -> bool:
        return self.now == self.count

    def step(self) -> None:
        self.now += 1

    def draw(self) -> np.ndarray[Any, np.dtype[np.uint8]]:
        return np.full((2, 3, 3), self.now % 256, np.uint8)


def kept(count: int) -> PictureRecording:
    episode: Any = Steps(count)
    return record(episode, episode.draw)


def test_long_episodes_are_thinned_and_keep_their_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recording, "MOST_PICTURES", 10)
    for count in (0, 1, 9, 10, 57, 100):
        pictures = kept(count)
        assert len(pictures.pictures) <= 11
        assert (pictures.steps[0], pictures.steps[-1], len(pictures.fitness_so_far)) == (0, count, count + 1)
        for index, step in enumerate(pictures.steps):
            assert pictures.image(index).getpixel((0, 0)) == (step, step, step)


def test_films_are_as_long_as_the_episode(tmp_path: Path) -> None:
    pictures = kept(40)
    chosen, seconds = pictures.select_pictures(1000, 1 / 30, 1.0)
    assert len(chosen) == 41
    assert seconds == pytest.approx(0.1)
    chosen, seconds = pictures.select_pictures(11, 0.06, 2.0)
    assert len(chosen) == 11
    assert seconds == pytest.approx(0.2)
    save(pictures, tmp_path / "x.gif")
    with Image.open(io.BytesIO((tmp_path / "x.gif").read_bytes())) as opened:
        assert opened.size == (3, 2)
    with pytest.raises(ValueError, match="unknown suffix"):
        save(pictures, tmp_path / "x.bmp")

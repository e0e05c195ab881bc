"""Episodes of simulations that are not in this process are shown here, by the scenes that servers send."""

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from swarmwright import InputError, Run, RunError, _engine
from swarmwright.display import Recording
from swarmwright.runs.replay import Replay
from swarmwright.servers.evaluation import shown
from tests.system.brokers import BrokerProcess
from tests.system.conftest import Experiment, Launch
from tests.system.plain_server import Json, PlainServer
from tests.system.scene_server import SceneServer
from tests.system.test_plain_server import TOY

TOGETHER = TOY.replace("generations: 3", "generations: 1").replace("step: 10", "step: 3")
Evolved = Callable[[str, str], Path]


@pytest.fixture
def evolved(launch: Launch, experiment: Experiment) -> Evolved:
    """Evolves on the servers of a broker, and returns the run's folder."""

    def evolve(text: str, url: str) -> Path:
        path = experiment(text)
        program = launch("optimize", path, "--broker", url, "--out", "result")
        assert program.wait() == 0, program.stderr
        return path.parent / "result"

    return evolve


def scenes_of(text: str) -> tuple[list[Json], Json]:
    """What `replay --json` prints: scenes, and the last line."""
    *scenes, last = [json.loads(line) for line in text.splitlines()]
    return scenes, last


def plain(recording: Recording) -> list[Any]:
    """Scenes that can be compared."""
    return [scene.plain() for scene in recording.scenes]


def test_a_plain_server_is_shown_by_its_scenes(
    broker: BrokerProcess, connect: Any, launch: Launch, evolved: Evolved, tmp_path: Path
) -> None:
    server = connect(SceneServer, broker.url)
    run = evolved(TOGETHER, broker.url)
    best = Run.open(run).best
    assert server.sent == 0, "evolution needs no scenes"
    shown = launch("replay", "result", "--broker", broker.url, "--json")
    assert shown.wait() == 0, shown.stderr
    scenes, last = scenes_of("\n".join(shown.lines))
    assert last["fitness"] == best.fitness == scenes[-1]["fitness"], "as recorded"
    assert [scene["step"] for scene in scenes] == list(range(len(scenes)))
    assert server.sent == len(scenes) > 1
    first = scenes[0]
    assert first["message"] == "Meet at 0"
    assert [body["x"] for body in first["bodies"]] == [10, 14, 7.5, 16.25]
    assert [body["kind"] for body in first["bodies"]] == ["goal", "agent", "agent", "agent"]
    assert first["bodies"][0].get("heading") is None
    assert first["bodies"][1]["label"] == "4.0"
    assert first["links"] == [[1, 2]]
    assert first["rays"][0]["length"] == 2
    for name in ("film.gif", "page.html", "still.png"):
        saved = launch("replay", "result", "--broker", broker.url, "--save", name)
        assert saved.wait() == 0, saved.stderr
        assert f"Fitness {best.fitness + 0.0:.6g}. " in "\n".join(saved.lines), "and no word of another one"
    with Image.open(tmp_path / "film.gif") as film:
        assert getattr(film, "n_frames", 1) >= len(scenes)
    page = (tmp_path / "page.html").read_text()
    assert "Meet at 0" in page
    assert '"met"' in page, "a curve for each metric"


def test_what_agents_sensed_and_did_is_kept(embedded: BrokerProcess, connect: Any, evolved: Evolved) -> None:
    connect(SceneServer, embedded.url)
    run = Run.open(evolved(TOGETHER, embedded.url))
    recording = Replay.of(run, broker=embedded.url).recording()
    trace = recording.trace
    assert trace is not None
    assert trace.sensors.shape == (len(recording.scenes) - 1, 3, 2)
    moved = recording.scenes[1].bodies.x[1] - recording.scenes[0].bodies.x[1]  # type: ignore[attr-defined] # arrays
    assert trace.actuators[0, 0, 0] == pytest.approx(moved, abs=1e-5)
    assert trace.metrics["steps"].tolist() == list(range(len(recording.scenes)))
    assert recording.fitness == run.best.fitness
    page = run.replay(broker=embedded.url)
    assert page.fitness == run.best.fitness


@pytest.mark.journey
def test_an_experiment_is_shown_before_any_run(
    embedded: BrokerProcess, connect: Any, launch: Launch, experiment: Experiment, tmp_path: Path
) -> None:
    connect(SceneServer, embedded.url)
    path = experiment(f"{TOGETHER}broker: {embedded.url}\n")
    saved = launch("simulate", path, "--save", "before.png")
    assert saved.wait() == 0, saved.stderr
    printed = launch("simulate", path)
    assert printed.wait() == 0, printed.stderr
    assert saved.lines == [f"{printed.lines[0]} The picture is in before.png"]
    assert (tmp_path / "before.png").is_file()


def test_the_run_knows_its_broker(
    embedded: BrokerProcess, connect: Any, launch: Launch, evolved: Evolved
) -> None:
    connect(SceneServer, embedded.url)
    evolved(f"{TOGETHER}broker: {embedded.url}\n", embedded.url)
    shown = launch("replay", "result", "--speed", "100")
    assert shown.wait() == 0, shown.stderr
    assert sum("Meet at 0" in line for line in shown.lines) > 1


class Doubling(SceneServer):
    """Every message comes twice, scenes a step later once more."""

    last: Json | None = None

    def show(self, topic: str, scene: Json) -> None:
        for again in (scene, scene, self.last or scene):
            super().show(topic, again)
        self.last = scene

    def send(self, topic: str, **fields: Any) -> None:
        for _ in range(2 if self.reply and topic in ("sensor", "fitness") else 1):
            super().send(topic, **fields)

    def actuated(self, content: Json) -> None:
        if self._toy is not None and content["agent"] in self._toy.acting:
            super().actuated(content)


class Losing(SceneServer):
    """Scenes of two steps do not arrive."""

    def show(self, topic: str, scene: Json) -> None:
        if scene["step"] not in (2, 3):
            super().show(topic, scene)


class Late(SceneServer):
    """Sensors and the fitness overtake scenes."""

    held: tuple[str, Json] | None = None

    def show(self, topic: str, scene: Json) -> None:
        self.held = (topic, scene)

    def sense(self) -> None:
        super().sense()
        if self.held:
            SceneServer.show(self, *self.held)


class Forgetting(SceneServer):
    """The actuators of an agent are lost in the first episode that is shown."""

    lost = False

    def actuated(self, content: Json) -> None:
        assert self._toy is not None
        if self.reply and self._toy.step == 2 and not self.lost:
            self.lost = True
            return
        super().actuated(content)


class Stumbling(SceneServer):
    """The sensors of an agent are lost in the first episode that is shown."""

    lost = False

    def send(self, topic: str, **fields: Any) -> None:
        if topic == "sensor" and self.reply and self._toy and self._toy.step == 2 and not self.lost:
            self.lost = True
            return
        super().send(topic, **fields)


@pytest.mark.parametrize("kind", [Doubling, Losing, Late, Forgetting, Stumbling])
def test_lost_late_and_double_messages_change_nothing(
    embedded: BrokerProcess, connect: Any, evolved: Evolved, kind: type[SceneServer], caplog: Any
) -> None:
    connect(kind, embedded.url)
    run = Run.open(evolved(TOGETHER.replace("step: 3", "step: 1.5"), embedded.url))
    recording = Replay.of(run, broker=embedded.url).recording()
    assert recording.fitness == run.best.fitness
    steps = [scene.step for scene in recording.scenes]
    left_out = {2, 3} if kind is Losing else set()
    assert steps == [step for step in range(steps[-1] + 1) if step not in left_out]
    assert ("server 4711: 2 scenes did not arrive" in caplog.text) == (kind is Losing)
    assert ("restarting the episode" in caplog.text) == (kind in (Forgetting, Stumbling))


class Silent(SceneServer):
    """Falls silent in the middle of every episode that is shown."""

    def sense(self) -> None:
        assert self._toy is not None
        if not self.reply or self._toy.step < 2:
            super().sense()


class Speechless(SceneServer):
    """Announces scenes, and sends none."""

    def show(self, topic: str, scene: Json) -> None:
        pass


class Garbled(SceneServer):
    """Sends scenes whose arrays do not fit each other."""

    def picture(self) -> Json:
        scene = super().picture()
        scene["bodies"]["y"] = floats = scene["bodies"]["y"][:-4]
        assert floats
        return scene


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        (Silent, "server 4711 sent nothing for 1.5 s after step 1; tried 3 times"),
        (Speechless, "server 4711 announces scenes, but sent none; tried 3 times"),
        (Garbled, 'server 4711: scene message: "bodies.y" has 3 entries, expected 4'),
        (PlainServer, 'server 4711 on {url} offers "toy" without scenes (capabilities.swarmwright.scenes)'),
    ],
    ids=lambda value: value.__name__ if isinstance(value, type) else "",
)
def test_a_server_that_cannot_is_named_in_one_message(
    embedded: BrokerProcess, connect: Any, launch: Launch, evolved: Evolved, kind: type, message: str
) -> None:
    connect(kind, embedded.url)
    text = TOGETHER.replace("step: 3", "step: 1.5")
    evolved(text, embedded.url)
    shown = launch("replay", "result", "--broker", embedded.url, "--save", "page.html")
    assert shown.wait() == 1
    assert message.format(url=embedded.url) in shown.stderr
    assert "Traceback" not in shown.stderr


def test_without_a_server_or_a_broker_it_is_said_what_is_missing(
    embedded: BrokerProcess, connect: Any, launch: Launch, evolved: Evolved
) -> None:
    server = connect(SceneServer, embedded.url)
    run = evolved(TOGETHER.replace("discovery: 4", "discovery: 1"), embedded.url)
    server.close()
    with pytest.raises(InputError, match=r"--broker URL"):
        Replay.of(Run.open(run))
    with pytest.raises(RunError, match=r'no free server on .* offers "toy" \(1\.\d s waited\)'):
        Replay.of(Run.open(run), broker=embedded.url).recording()
    embedded.stop()
    shown = launch("replay", "result", "--broker", embedded.url)
    assert shown.wait() == 1
    assert "cannot be reached" in shown.stderr or "no broker" in shown.stderr


MINISIM = """\
simulation: minisim
parameters: {numAgents: 3, numDefenders: 2, placement: random, maxSteps: 12}
controller: {kind: fully_meshed, hidden: 2}
method: {kind: random_search, population: 4, generations: 1}
"""
RULE = """\
simulation: minisim
parameters: {steering: rule, maxSteps: 12, numAgents: 3, placement: random}
controller: {kind: parameter_set, parameters: {avoidance: {type: real, range: [0, 5]}}}
method: {kind: random_search, population: 4, generations: 1}
"""
ARENA = """\
simulation: arena
parameters: {mission: aac, robot: e-puck-rm1.2, robots: 6, duration: 3}
controller: {kind: modules}
method: {kind: random_search, population: 3, generations: 1}
"""


@pytest.mark.parametrize("text", [MINISIM, RULE, ARENA], ids=["minisim", "rule", "arena"])
def test_a_server_shows_what_this_process_would(
    embedded: BrokerProcess, launch: Launch, evolved: Evolved, text: str
) -> None:
    """The same scenes, fitness, metrics and states of controllers, to the bit."""
    title = text.split()[1]
    launch("serve", title, "--broker", embedded.url, "--id", 1, "--json").until_event("ready", server=1)
    run = Run.open(evolved(text, embedded.url))
    here, there = (Replay.of(run, broker=broker).recording() for broker in (None, embedded.url))
    assert there.fitness == here.fitness == run.best.fitness
    assert there.fitness_so_far == here.fitness_so_far
    assert there.step_size == here.step_size
    assert plain(there) == plain(here)
    assert here.trace is not None
    assert there.trace is not None
    if text != RULE:  # no agent acts
        assert np.array_equal(there.trace.sensors, here.trace.sensors, equal_nan=True)
        assert np.array_equal(there.trace.actuators, here.trace.actuators, equal_nan=True)
    assert {name: list(values) for name, values in there.trace.metrics.items()} == {
        name: list(values) for name, values in here.trace.metrics.items()
    }
    states = [trace.states for trace in (here.trace, there.trace)]
    assert (states[0] is None) == (states[1] is None) == (title != "arena")
    assert states[0] is None or (states[0] == states[1]).all()


@pytest.mark.timeout(600)  # it may build the wrappers
@pytest.mark.parametrize("text", [MINISIM, RULE], ids=["minisim", "rule"])
@pytest.mark.parametrize("language", ["java", "cpp"])
def test_a_server_in_another_language_shows_the_same(
    embedded: BrokerProcess, request: pytest.FixtureRequest, evolved: Evolved, text: str, language: str
) -> None:
    request.getfixturevalue(f"serve_{language}")(embedded.url)
    run = Run.open(evolved(text, embedded.url))
    here, there = (Replay.of(run, broker=broker).recording() for broker in (None, embedded.url))
    assert there.fitness == here.fitness == run.best.fitness
    assert there.fitness_so_far == here.fitness_so_far
    assert plain(there) == plain(here)
    assert there.step_size == here.step_size


def test_a_server_is_free_after_an_episode_was_left(
    embedded: BrokerProcess, connect: Any, evolved: Evolved
) -> None:
    server = connect(SceneServer, embedded.url)
    run = Run.open(evolved(TOGETHER, embedded.url))
    episode: Any = Replay.of(run, broker=embedded.url).episode()
    episode.step()
    episode.close()
    assert Replay.of(run, broker=embedded.url).recording().fitness == run.best.fitness
    deadline = time.monotonic() + 10
    # The one that was left, the one that was played to its end, and then the server is freed.
    while [control["run"] for control in server.controls][-3:] != [False, True, False]:
        assert time.monotonic() < deadline, server.controls
        time.sleep(0.02)
    with pytest.raises(ValueError, match="closed"):
        episode.step()


def test_attempts_end() -> None:
    tried = []

    def attempt() -> None:
        tried.append(1)
        raise _engine.LostError("server 3 sent nothing")

    with pytest.raises(RunError, match="server 3 sent nothing; tried 3 times"):
        shown.retry_lost(attempt)
    assert len(tried) == 3

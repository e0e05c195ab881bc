"""Shown runs: asked for through the protocol, drawn by the server, at the pace of `stepSize`."""

import itertools
from typing import Any

import pytest

from tests.system.brokers import BrokerProcess
from tests.system.conftest import Experiment, Launch, Serve
from tests.system.recorder import Recorder, Referee, check_shapes

STEPS, PACE = 5, 0.2
SHOWN = f"""\
simulation: minisim
parameters: {{maxSteps: {STEPS}, stepSize: {PACE * 1000:.0f}, numDefenders: 0, helloMessage: Hello there}}
mode: stepwise
"""


def steps_of(recorder: Recorder) -> list[float]:
    """When the sensor messages came, as distances in seconds."""
    times = [message.at for message in recorder.messages if message.topic == "sensor"]
    return [later - sooner for sooner, later in itertools.pairwise(times)]


@pytest.mark.journey
def test_a_server_draws_when_the_control_message_says_so(
    broker: BrokerProcess, serve: Serve, launch: Launch, connect: Any, experiment: Experiment
) -> None:
    recorder: Recorder = connect(Recorder, broker.url)
    servers = serve(broker.url)
    path = experiment(SHOWN)
    shown = launch("simulate", path, "--broker", broker.url, "--visual")
    assert shown.wait() == 0, shown.stderr
    recorder.settle()
    (control,) = [content for content in recorder.on("control") if content["run"]]
    assert control["visual"] is True
    assert all(pause >= 0.9 * PACE for pause in steps_of(recorder))
    assert len(recorder.on("sensor")) == STEPS
    # Standard output of `serve --json` is for its events alone.
    frames = sum("Hello there" in line for line in servers.errors)
    assert frames == STEPS + 1, "the beginning and each step"
    assert not any("Hello there" in line for line in servers.lines)
    check_shapes(recorder.messages)
    Referee().follow(recorder.messages)
    (fitness,) = [content["fitness"] for content in recorder.on("fitness")]

    recorder.messages.clear()
    silent = launch("simulate", path, "--broker", broker.url, "--json")
    assert silent.wait() == 0, silent.stderr
    recorder.settle()
    assert [content["visual"] for content in recorder.on("control") if content["run"]] == [False]
    assert sum(steps_of(recorder)) < PACE * STEPS / 2
    assert sum("Hello there" in line for line in servers.errors) == frames
    assert [content["fitness"] for content in recorder.on("fitness")] == [fitness], "watching changes nothing"


def test_without_a_broker_the_frames_come_here(launch: Launch, experiment: Experiment) -> None:
    shown = launch("simulate", experiment(SHOWN.replace("200", "20")), "--visual")
    assert shown.wait() == 0, shown.stderr
    assert sum("Hello there" in line for line in shown.lines) == STEPS + 1
    assert any(line.startswith("Fitness -") for line in shown.lines)

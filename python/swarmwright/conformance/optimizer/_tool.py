"""The optimization tool under test: restarted for each scene, or started once by another party."""

import signal
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from swarmwright.conformance._peers import Door, Process
from swarmwright.conformance.optimizer._stage import OTHER_MODES, TOOL_TOPICS, Actor, Record, Stage
from swarmwright.conformance.rules import Rule, Rules, Skip
from swarmwright.servers.broker.client import TO_SERVER, TOPICS, Client, Failure

GROUPS = {
    "O1": "Discovery",
    "O2": "Episodes",
    "O3": "Actuators",
    "O4": "Wrong messages",
    "O5": "Servers that fail",
    "O6": "Extensions",
    "O7": "The end",
}
RULES = Rules("optimizer", GROUPS)
rule = RULES.rule


SILENCE_S = 3.0
"""Seconds of silence after which the run of a tool that the kit did not start counts as ended."""


@dataclass
class ToolSettings:
    """Known properties of a tool, and the announcement of the kit's servers."""

    title: str | None
    """Title of the requested simulation; None accepts any."""
    sensors: int
    """Sensor values per agent."""
    actuators: int
    """Actuator values per agent."""
    episodes: int | None
    """Episodes per candidate, if known."""
    lasts: float
    """Time limit of a run in seconds."""
    wait: float
    """Seconds to wait for its first message."""
    mode: str = "stepwise"
    """How episodes are evaluated: stepwise, batched or offloaded."""


class Tool:
    """The tool as the rules see it: the records of scenes, each of which is played once."""

    def __init__(
        self, address: str, prefix: str, settings: ToolSettings, *, door: Door | None, process: Process | None
    ) -> None:
        self.address = address
        self.prefix = prefix
        self.settings = settings
        self.door = door
        self.process = process
        self._scenes: dict[str, Record] = {}

    def plain(self) -> Record:
        """Play a scene with two servers that follow all rules."""
        return self.scene("plain", [Actor(1), Actor(2)])

    def stepwise(self) -> Record:
        """Play like `plain`; skip the rule if the tool plays no stepwise episodes.

        A tool that finds no server for its mode may exit with an error; one that is killed by a signal has
        crashed.
        """
        record = self.plain()
        crashed = record.status is not None and record.status < 0
        if not crashed and not record.on("parameters") and (mode := self.find_other_mode()):
            raise Skip(
                f"the tool evaluates nothing stepwise, only {mode}; with stepwise servers: "
                f"{record.ended or 'it sent no parameters'}",
                doubt="it played no episode stepwise: is that meant?",
            )
        return record

    def find_other_mode(self) -> str:
        """Return the first request mode that the tool uses if servers offer it; empty if there is none."""
        for mode in OTHER_MODES:
            # Only one scene can be played with a tool that the kit does not start.
            with suppress(Skip):
                if self.requests(mode).requests:
                    return mode
        return ""

    def requests(self, mode: str) -> Record:
        """Play a scene with two servers that offer one of `OTHER_MODES`."""
        kind = OTHER_MODES[mode]
        return self.scene(mode, [kind(1), kind(2)], mode="auto")

    def scene(
        self,
        name: str,
        actors: Sequence[Actor],
        *,
        interrupt: bool = False,
        cut: bool = False,
        mode: str = "stepwise",
    ) -> Record:
        """Play a scene, or return its record if it was played before.

        interrupt: send SIGINT in the middle. cut: cut the connection in the middle. mode: mode of the
        experiments that the kit writes.
        """
        self.settings.mode = mode
        if name not in self._scenes:
            if self.process is None and self._scenes:
                raise Skip("the tool has to be started anew for this: let the kit do it (--exec)")
            if interrupt and self.process is None:
                raise Skip("the kit did not start the tool (--exec)")
            if cut and self.door is None:
                raise Skip("the kit is not between tool and broker")
            self._scenes[name] = self._play_scene(actors, interrupt=interrupt, cut=cut)
        return self._scenes[name]

    def _play_scene(self, actors: Sequence[Actor], *, interrupt: bool, cut: bool) -> Record:
        topics = [*TOOL_TOPICS, *(f"{TO_SERVER}{actor.server}" for actor in actors)]
        with Client(self.address, self.prefix, topics) as client:
            stage = Stage(
                client,
                actors,
                title=self.settings.title,
                sensors=self.settings.sensors,
                actuators=self.settings.actuators,
            )
            if self.process is not None:
                self.process.start()
            if interrupt or cut:
                stage.play(lambda: self._has_ended() or self._is_in_the_middle(stage), self.settings.lasts)
                if interrupt and self.process is not None:
                    self.process.signal(signal.SIGINT)
                elif self.door is not None:
                    self.door.shut()
                    self.door.open()
            last = time.monotonic() + self.settings.wait
            count_before = 0

            def is_over() -> bool:
                nonlocal last, count_before
                count = len(stage.record.messages) + len(stage.record.requests)
                if count > count_before:
                    count_before, last = count, time.monotonic() + SILENCE_S
                return self._has_ended() if self.process is not None else time.monotonic() > last

            stage.play(is_over, self.settings.lasts)
            record = stage.record
            if self.process is not None:
                record.ended, record.status = self.process.ended, self.process.status
                self.process.stop()
        return record

    @staticmethod
    def _is_in_the_middle(stage: Stage) -> bool:
        return bool(stage.record.finished) and any(actor.episode is not None for actor in stage.actors)

    def _has_ended(self) -> bool:
        return self.process is not None and bool(self.process.ended)

    def list_retained(self) -> list[str]:
        """Return the retained messages on the seven topics."""
        with Client(self.address, self.prefix, TOPICS) as client:
            return [str(message) for message in client.drain(0.1) if message.retained and message.payload]

    # `run` requires these of a peer; no state is kept between rules.

    def ready(self, rule: Rule) -> None:
        """Do nothing; each scene starts from scratch."""

    def recover(self) -> str:
        """Return nothing; each scene starts from scratch."""
        return ""

    def revive(self) -> bool:
        """Return true; each scene starts the tool."""
        return True

    def describe_exit(self) -> str:
        """Return nothing; the exit of the tool is in the record."""
        return ""


def must_go_on(tool: Tool, name: str, actors: Sequence[Actor], sent: str) -> Record:
    """Play a scene. Raises Failure unless as many episodes end as without faults."""
    count = len(tool.stepwise().finished)
    record = tool.scene(name, actors)
    if "reaction" in record.notes:
        expected = "silence: the right message is still to come"
        raise Failure(f"{record.notes['reaction']} arrived", expected, record.notes["reaction to"])
    if len(record.finished) < count:
        finished = f"{len(record.finished)} of {count} episodes came to their end"
        came = f"{finished}; {record.ended or 'no more arrived'}"
        raise Failure(
            came, "a run as if nothing had arrived in between", record.notes.get("last wrong", sent)
        )
    if record.unasked:
        raise Failure(f"{record.unasked[0]} arrived", "answers to sound messages only", sent)
    return record


EXPERIMENT = """\
# What the conformance kit gives to a Swarmwright tool. Each candidate, which has a state, plays two episodes.
simulation: {title}
requirements: {{dimensions: 2}}
parameters: {{note: conformance}}
sensors: {sensors}
actuators: {actuators}
controller: {{kind: fully_meshed, hidden: 1, activation: tanh}}
method: {{kind: nnga, population: 6, generations: 2}}
ranking: {{episodes: 2}}
mode: {mode}
broker: {broker}
seed: 1
timeouts: {{discovery: 8, step: 1}}
"""


def write_experiment(folder: Path, broker: str, settings: ToolSettings) -> Path:
    """Write an experiment file for tools that read Swarmwright's experiments."""
    path = folder / "experiment.yaml"
    title = settings.title or "conformance"
    text = EXPERIMENT.format(
        title=title, mode=settings.mode, sensors=settings.sensors, actuators=settings.actuators, broker=broker
    )
    with suppress(OSError):
        path.write_text(text, encoding="utf-8")
    return path

"""O5: servers that are reserved by others, fall silent, or are temporarily unreachable."""

import time

from swarmwright.conformance.optimizer._rules import rule
from swarmwright.conformance.optimizer._stage import Actor
from swarmwright.conformance.optimizer._tool import Tool, must_go_on
from swarmwright.servers.broker.client import Failure


class TakenByOthers(Actor):
    """Answers discovery, but is then reserved by another tool, whose control came first."""

    gone = False

    def answers(self, content: dict[str, object]) -> bool:
        """Return whether it is still free."""
        return not self.gone and super().answers(content)

    def begin(self, hash_: str) -> None:
        """Begin nothing for this tool."""
        self.gone = True
        self.stage.record.notes["tried"] = hash_


@rule(
    "O5.1",
    "If a server answered but does not begin, another one gets the episode.",
    where="protocol.md, Reservation of servers",
    fix="measure the time since control; without a sensor message, look for another server",
    needs=["O3.1"],
    seconds=600,
)
def avoids_reserved(tool: Tool) -> str:
    """Play a server that never begins and one that does."""
    record = must_go_on(tool, "taken", [TakenByOthers(1), Actor(2)], "no sensor message from server 1")
    return f"in {record.seconds:.1f} s" if "tried" in record.notes else "the tool never tried the server"


class FallsSilent(Actor):
    """Falls silent after the first step of its second episode."""

    def ask(self) -> None:
        """Ask agents until it falls silent."""
        mine = [episode for episode in self.stage.record.episodes if episode.server == self.server]
        if len(mine) < 2 or not mine[-1].answers:
            super().ask()

    def answers(self, content: dict[str, object]) -> bool:
        """Answer discovery until it falls silent."""
        mine = [episode for episode in self.stage.record.episodes if episode.server == self.server]
        return len(mine) < 2 and super().answers(content)


@rule(
    "O5.2",
    "If a server falls silent during an episode, another one gets the episode.",
    where="protocol.md, Reservation of servers",
    fix="measure the time since the last answer; evaluate the candidate elsewhere",
    needs=["O3.1"],
    seconds=600,
)
def replaces_silent(tool: Tool) -> str:
    """Play a server that falls silent in its second episode and one that does not."""
    record = must_go_on(tool, "lost", [FallsSilent(1), Actor(2)], "nothing after the first step")
    return f"in {record.seconds:.1f} s"


@rule(
    "O5.3",
    "It reconnects to the broker, and the run continues.",
    where="decision 003",
    fix="let the MQTT client reconnect and subscribe again; repeat current evaluations",
    needs=["O3.1"],
    seconds=600,
)
def cut(tool: Tool) -> str:
    """Cut the connection in the middle of an episode."""
    expected = len(tool.stepwise().finished)
    record = tool.scene("cut", [Patient(1), Patient(2)], cut=True)
    if len(record.finished) < expected:
        finished = f"{len(record.finished)} of {expected} episodes came to their end"
        came = f"{finished}; {record.ended or 'no more arrived'}"
        raise Failure(came, "a whole run all the same", "the connection was cut")
    return f"in {record.seconds:.1f} s"


class Patient(Actor):
    """Aborts an episode whose actuators do not arrive within a second."""

    since = 0.0

    def ask(self) -> None:
        """Store the time of the step."""
        self.since = time.monotonic()
        super().ask()

    def tick(self) -> None:
        """Abort the episode after the time-out."""
        if self.episode is not None and time.monotonic() > self.since + 1:
            self.episode = None

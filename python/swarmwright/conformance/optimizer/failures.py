"""O5 to O7: servers that are reserved or fall silent, requests to servers with extensions, the end."""

import json
import time

from swarmwright.conformance.optimizer._stage import Actor, Json, Offloading, Record
from swarmwright.conformance.optimizer._tool import Tool, must_go_on, rule
from swarmwright.conformance.rules import Skip
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


NUMBERS = "protocol.md, Messages of numbers"


def play_offloaded(tool: Tool) -> Record:
    """Play a run on two servers that evaluate offloaded; skip the rule if the tool does not use them."""
    record = tool.requests("offloaded")
    if not record.requests:
        raise Skip("the tool sends no evaluate: it does not offload")
    return record


def must_be_whole(tool: Tool, record: Record, done: str) -> None:
    """Raise Failure unless as many episodes were evaluated as stepwise, if that number is known.

    done: verb for the message, such as "asked for".
    """
    expected = len(tool.plain().finished)
    if expected and record.evaluated < expected:
        raise Failure(f"{record.evaluated} of {expected} episodes were {done}; {record.ended}", "a whole run")
    if not expected and (not record.evaluated or record.status):
        raise Failure(f"{record.evaluated} episodes were {done}; {record.ended}", "a whole run, and status 0")


@rule(
    "O6.1",
    "evaluate has its keys, a controller, whole candidates and seeds; request numbers are unique.",
    where=f"{NUMBERS}; protocol/schemas/evaluate.schema.json",
    fix="write every field with its type; count requests",
    needs=["O3.1"],
    seconds=600,
)
def evaluates(tool: Tool) -> str:
    """Play a run on two servers that announce offloaded evaluation."""
    record = play_offloaded(tool)
    if record.wrong:
        raise record.wrong[0]
    numbers = [request.get("request") for request in record.requests]
    if len(set(numbers)) < len(numbers):
        raise Failure(f"the requests {numbers}", "a new number for each request")
    must_be_whole(tool, record, "asked for")
    return f"{record.evaluated} episodes in {len(numbers)} requests"


class Refusing(Offloading):
    """Refuses the first request as taken."""

    refused = False

    def serve(self, request: Json) -> None:
        """Refuse the first request."""
        if not self.refused:
            self.refused = True
            error = {"kind": "taken", "reason": "taken by another tool"}
            self.reply(request, fitness=b"", error=error, seconds=0.0)
        else:
            super().serve(request)


@rule(
    "O6.2",
    "Work refused as taken is evaluated by another server, or later.",
    where=NUMBERS,
    fix="resend a request with error taken to another server or later",
    needs=["O6.1"],
    seconds=600,
)
def retries_refused(tool: Tool) -> str:
    """Play two servers, one of which refuses the first request."""
    without = play_offloaded(tool)
    expected = len(tool.plain().finished) or without.evaluated
    record = tool.scene("refused", [Refusing(1), Offloading(2)], mode="auto")
    if record.evaluated < expected:
        came = f"{record.evaluated} of {expected} episodes were evaluated; {record.ended}"
        raise Failure(came, "a whole run", "error taken for the first request to server 1")
    return f"in {record.seconds:.1f} s"


@rule(
    "O6.3",
    "A batch's actuators match the step and rows of their sensors, from -1 to +1.",
    where="protocol.md, Batched stepwise",
    fix="answer each sensors message with as many rows, the same request and step",
    needs=["O3.1"],
    seconds=600,
)
def batches(tool: Tool) -> str:
    """Play a run on two servers that announce batches of four episodes."""
    record = tool.requests("batched")
    starts = [request for request in record.requests if request.get("kind") == "start"]
    if not starts:
        raise Skip("the tool sends no start: it does not use batches")
    if record.wrong:
        raise record.wrong[0]
    must_be_whole(tool, record, "played")
    return f"{record.evaluated} episodes in {len(starts)} batches"


TAKEN = "protocol.md, Reservation of servers"


def release(record: Record) -> str:
    """Return the name of the tool; skip the rule if it has none."""
    names = {str(content["tool"]) for _, content in record.messages if "tool" in content}
    if not names:
        raise Skip("the tool does not name itself: its servers are free after each episode")
    if len(names) > 1:
        raise Failure(f"it calls itself {' and '.join(sorted(names))}", "one name in all its messages")
    return names.pop()


def must_give_back(record: Record) -> None:
    """Raise Failure unless each used server received run: false after its last episode."""
    for server in sorted({episode.server for episode in record.episodes}):
        mine = [content for content in record.on("control") if content.get("server") == server]
        if not mine or mine[-1].get("run", True) is not False:
            came = f"the last control for server {server} was {json.dumps(mine[-1]) if mine else 'none'}"
            raise Failure(came, f'control with "run": false; {record.ended}')


@rule(
    "O7.1",
    "A tool that names itself releases its servers at the end: control with run: false.",
    where=TAKEN,
    fix="publish control with run: false, tool and the last hash for each server that you used",
    needs=["O2.1"],
    seconds=600,
)
def gives_back(tool: Tool) -> str:
    """Check the last control message for each server."""
    record = tool.stepwise()
    name = release(record)
    must_give_back(record)
    return f'it calls itself "{name}"'


@rule(
    "O7.2",
    "On SIGINT, it ends its episodes with run: false, and exits.",
    where=TAKEN,
    fix="on SIGINT, publish control with run: false for every server with an episode of yours",
    needs=["O2.1"],
    seconds=600,
)
def interrupt(tool: Tool) -> str:
    """Send SIGINT in the middle of an episode."""
    tool.stepwise()
    record = tool.scene("interrupt", [Slow(1), Slow(2)], interrupt=True)
    if not record.ended:
        raise Failure(f"it went on for {record.seconds:.0f} s", "its end", "SIGINT")
    must_give_back(record)
    return f"exit status {record.status}"


class Slow(Actor):
    """Answers slowly, so that an episode can be interrupted in the middle."""

    at = 0.0

    def ask(self) -> None:
        """Postpone the step."""
        self.at = time.monotonic() + 0.05

    def tick(self) -> None:
        """Perform the postponed step."""
        if self.episode is not None and 0 < self.at < time.monotonic():
            self.at = 0.0
            super().ask()

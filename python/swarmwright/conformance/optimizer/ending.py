"""O7: how a tool releases its servers."""

import json
import time

from swarmwright.conformance.optimizer._rules import rule
from swarmwright.conformance.optimizer._stage import Actor, Record
from swarmwright.conformance.optimizer._tool import Tool
from swarmwright.conformance.rules import Skip
from swarmwright.servers.broker.client import Failure

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

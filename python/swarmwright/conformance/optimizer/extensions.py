"""O6: requests to servers that announce extensions."""

from swarmwright.conformance.optimizer._requests import Offloading
from swarmwright.conformance.optimizer._rules import rule
from swarmwright.conformance.optimizer._stage import Json, Record
from swarmwright.conformance.optimizer._tool import Tool
from swarmwright.conformance.rules import Skip
from swarmwright.servers.broker.client import Failure

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

"""Check a server or an optimization tool: try rules in sequence, with deadlines."""

import shutil
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Protocol

from swarmwright.common.errors import InputError, RunError
from swarmwright.conformance import optimizer
from swarmwright.conformance import server as servers
from swarmwright.conformance._peers import OPEN, Process, open_broker
from swarmwright.conformance._server_under_test import ServerPeer, Settings, await_answer
from swarmwright.conformance.optimizer._tool import Tool, ToolSettings, write_experiment
from swarmwright.conformance.results import BAD, Report, Result
from swarmwright.conformance.rules import Note, NotTried, Profile, Rule, Skip
from swarmwright.servers.broker.client import PRESENCE, TO_TOOL, Client, Failure, Overdue


class Peer(Protocol):
    """Interface of a peer for `run`."""

    def ready(self, rule: Rule) -> None:
        """Prepare for a rule: discard earlier messages, set the deadline."""
        ...

    def recover(self) -> str:
        """Prepare the peer for the next rule; return why that is impossible, empty if it succeeded."""
        ...

    def revive(self) -> bool:
        """Restart the peer if possible; return whether it was."""
        ...

    def describe_exit(self) -> str:
        """Describe how its process ended; empty while it runs, or if unknown."""
        ...


def run(peer: Peer, rules: Sequence[Rule], tell: Callable[[Result], None]) -> list[Result]:
    """Try rules on a peer; `tell` receives each result immediately."""
    results: dict[str, Result] = {}
    lost = ""
    for rule in rules:
        unmet = next(
            (need for need in rule.needs if need in results and results[need].status in (*BAD, "not run")),
            None,
        )
        if lost:
            result = _result(rule, "not run", lost)
        elif unmet:
            result = _result(rule, "not run", f"needs {unmet}")
        else:
            result = _try_rule(peer, rule)
            if result.status == "died" and not peer.revive():
                lost = f"the peer had exited after {rule.id}"
        results[rule.id] = result
        tell(result)
    return list(results.values())


def _result(rule: Rule, status: str, detail: str = "", **more: object) -> Result:
    return Result(rule.id, rule.sentence, rule.source, rule.where, status, detail, **more)  # type: ignore[arg-type]


def _try_rule(peer: Peer, rule: Rule) -> Result:
    start = time.monotonic()
    status, detail, advice, doubt, failure = "passed", "", "", "", None
    try:
        peer.ready(rule)
        result = rule.check(peer)
        note = result if isinstance(result, Note) else Note(result or "")
        detail, doubt = note.text, note.doubt
    except Skip as skip:
        status, detail, advice, doubt = "skipped", str(skip), skip.advice, skip.doubt
    except NotTried as unknown:
        status, detail = "not run", str(unknown)
    except Failure as error:
        status, failure = "failed", error
    except Overdue:
        status = "failed"
        failure = Failure(
            f"the rule did not finish within {time.monotonic() - start:.0f} s", "an end in time"
        )
    seconds = time.monotonic() - start
    lost = peer.recover()
    if lost:
        before = f"{failure.came}; then " if failure else ""
        failure = Failure(
            before + (peer.describe_exit() or lost),
            failure.expected if failure else "alive and free after the rule",
            failure.sent if failure else "",
        )
        status = "died"
    if failure is None:
        return _result(rule, status, detail, seconds=seconds, advice=advice, doubt=doubt)
    return _result(
        rule,
        status,
        sent=failure.sent,
        came=failure.came,
        expected=failure.expected,
        fix=rule.fix,
        seconds=seconds,
    )


GUESSES = (2.0, 3.0, 1.0)
"""Dimensions to try by default."""
INFORMING = ("S1.1", "S2.3")
"""Rules that measure what other rules need: the server's announcement and an undisturbed episode."""


def check_server(
    *,
    server: int = 1,
    command: str | None = None,
    start: Callable[[str], object] | None = None,
    broker: str | None = None,
    prefix: str = "",
    simulation: str | None = None,
    dimensions: float | None = None,
    parameters: Mapping[str, Any] | None = None,
    sensors: int | None = None,
    actuators: int | None = None,
    step_timeout: float | None = None,
    timeout: float = 5.0,
    wait: float = 30.0,
    vary: Mapping[str, Any] | None = None,
    rules: Sequence[str] = (),
    profile: Profile = "all",
    tell: Callable[[Result], None] | None = None,
    say: Callable[[str], None] | None = None,
) -> Report:
    """Check a simulation server against the rules.

    Args:
        server: ID of the server.
        command: command that starts the server, with {broker}, {id} and {prefix}; None if another party
            starts it.
        start: function that starts the server in this process, called with the broker's address; the caller
            stops it.
        broker: address; None starts an embedded broker.
        prefix: topic prefix.
        simulation: title of the simulation; None takes it from the server's presence.
        dimensions: number of dimensions; None tries 2, 3 and 1.
        parameters: parameters of all episodes; short episodes shorten the check.
        sensors: numbers in a sensor message, if the server does not announce them.
        actuators: numbers in an actuator message, if the server does not announce them.
        step_timeout: seconds after which the server aborts an episode, if known.
        timeout: time limit of an answer, in seconds.
        wait: seconds to wait for the server to appear.
        vary: parameters that change an episode, if the seed does not.
        rules: ids and groups of rules to try; `-S6` excludes a group. Default: all. Rules that measure what
            these rules need are tried first and not reported, unless they are excluded.
        profile: `d6.1` tries only the rules that D6.1 demands.
        tell: called with each result immediately.
        say: called with instructions for the user.

    Raises InputError (invalid arguments) and RunError (no broker).

    """
    chosen = servers.RULES.select(rules, profile)
    tell, say = tell or _nothing, say or _nothing
    with ExitStack() as stack:
        address, direct, door = open_broker(broker, stack, stranger=command is None and start is None)
        if direct is not None:
            say(OPEN)
        process = None
        if command is not None:
            values = {"broker": door.url if door else address, "id": server, "prefix": prefix}
            process = Process(command, lambda: values)
            stack.callback(process.close)
        own_presence = f"{PRESENCE}{server}"
        probe = Settings(
            server=server,
            title=simulation or "",
            dimensions=0.0,
            parameters=dict(parameters or {}),
            sensors=sensors,
            actuators=actuators,
            timeout=timeout,
            step_timeout=step_timeout,
            vary=dict(vary or {}),
        )
        client = stack.enter_context(_connect(address, prefix, own_presence))
        peer = ServerPeer(client, probe, door=door, process=process, own_broker=direct, prefix=prefix)
        client.close()
        client = stack.enter_context(_connect(address, prefix, own_presence, peer.token))
        peer.client = client
        if process is not None:
            process.start()
        elif start is not None:
            start(door.url if door else address)
        else:
            where = door.url if door else address
            say(
                f"Start the server now, if it does not run: id {server}, broker {where}. "
                f"Waiting {wait:g} s for it."
            )
        peer.settings.title = simulation or _title(peer, own_presence, wait)
        measured = _dimensions(peer, dimensions, wait)
        peer.settings.dimensions = measured
        report = Report(f"server {server} ({peer.settings.title})")
        # Their results are not reported, since they were not requested.
        run(peer, _add_informing_rules(chosen, rules), _nothing)
        report.results = run(peer, chosen, tell)
        return report


def _add_informing_rules(chosen: Sequence[Rule], requested: Sequence[str]) -> list[Rule]:
    """Return the rules that measure what the chosen rules need, unless they are excluded."""
    names = [name.strip() for text in requested for name in text.split(",")]
    left = {name.removeprefix("-") for name in names if name.startswith("-")}
    needed, chosen_ids = servers.RULES.needed(chosen), {rule.id for rule in chosen}
    missing = [number for number in INFORMING if number in needed and number not in chosen_ids]
    # They precede all chosen rules, and each needs the findings of those before it.
    last = INFORMING.index(missing[-1]) if missing else -1
    rules = [servers.RULES[number] for number in INFORMING[: last + 1]]
    return [rule for rule in rules if not {rule.id, rule.group} & left]


def _nothing(_: object) -> None:
    pass


def _connect(address: str, prefix: str, presence: str, token: str = "") -> Client:
    topics = ["server", "sensor", "fitness", "swarmwright/v1/failed", presence]
    if token:
        topics += [TO_TOOL + token, f"conformance/{token}"]
    return Client(address, prefix, topics)


def _title(peer: ServerPeer, topic: str, wait: float) -> str:
    """Return the first title in the server's presence message."""
    message = peer.client.next(lambda message: message.topic == topic and bool(message.payload), wait)
    if message is not None:
        titles = message.maybe.get("simulations")
        if isinstance(titles, list) and titles and isinstance(titles[0], str):
            return titles[0]
    gone = peer.describe_exit()
    if gone:
        raise RunError(f"--exec: {gone}")
    raise InputError(
        f"server {peer.id}: no presence on {topic} within {wait:g} s, so its simulation is not known; "
        "name it with --simulation TITLE, and see that the server runs and has this id and this broker"
    )


def _dimensions(peer: ServerPeer, requested: float | None, wait: float) -> float:
    """Wait for an answer to discovery; return its dimensions, or the first guess without an answer."""
    guesses = GUESSES if requested is None else (requested,)
    limit = time.monotonic() + wait
    while time.monotonic() < limit:
        for guess in guesses:
            peer.settings.dimensions = guess
            answer = await_answer(peer, 0.15)
            if answer is not None:
                capabilities = answer.get("capabilities")
                announced = capabilities.get("dimensions") if isinstance(capabilities, dict) else None
                return float(announced) if isinstance(announced, int | float) else guess
        if peer.describe_exit():
            raise RunError(f"--exec: {peer.describe_exit()}")
    return guesses[0]


def check_optimizer(
    *,
    command: str | None = None,
    broker: str | None = None,
    prefix: str = "",
    simulation: str | None = None,
    sensors: int = 3,
    actuators: int = 2,
    episodes: int | None = None,
    lasts: float = 30.0,
    wait: float = 30.0,
    rules: Sequence[str] = (),
    profile: Profile = "all",
    tell: Callable[[Result], None] | None = None,
    say: Callable[[str], None] | None = None,
) -> Report:
    """Check an optimization tool against the rules; the kit acts as the simulation servers.

    Args:
        command: command that starts the tool, with {broker}, {prefix}, {experiment} (a file that the kit
            writes for tools that read Swarmwright's experiments) and {folder} (an empty folder); None if
            another party starts it.
        broker: address; None starts an embedded broker.
        prefix: topic prefix.
        simulation: the only title that is offered; None offers every requested title.
        sensors: sensor values per agent.
        actuators: actuator values per agent.
        episodes: episodes per candidate, if known; 2 with {experiment}.
        lasts: time limit of a run, in seconds.
        wait: seconds to wait for a tool that another party starts.
        rules: ids and groups of rules to try; `-O5` excludes a group. Default: all.
        profile: `d6.1` tries only the rules that D6.1 demands.
        tell: called with each result immediately.
        say: called with instructions for the user.

    Raises InputError (invalid arguments) and RunError (no broker).

    """
    chosen = optimizer.RULES.select(rules, profile)
    starts_tool = command is not None and "{experiment}" in command
    settings = ToolSettings(
        title=simulation,
        sensors=sensors,
        actuators=actuators,
        episodes=2 if starts_tool and episodes is None else episodes,
        lasts=lasts,
        wait=wait,
    )
    with ExitStack() as stack:
        address, direct, door = open_broker(broker, stack, stranger=command is None)
        if direct is not None and say is not None:
            say(OPEN)
        reach = door.url if door else address
        process = None
        if command is not None:
            process = Process(command, lambda: _values(reach, prefix, settings, stack))
            stack.callback(process.close)
        elif say is not None:
            say(f"Start the optimization tool now, on broker {reach}. Waiting {wait:g} s for it.")
        tool = Tool(address, prefix, settings, door=door, process=process)
        report = Report("the optimization tool")
        report.results = run(tool, chosen, tell or (lambda _: None))
        return report


def _values(broker: str, prefix: str, settings: ToolSettings, stack: ExitStack) -> Mapping[str, object]:
    """Return the values of the placeholders, including a new folder."""
    folder = Path(tempfile.mkdtemp(prefix="conformance-"))
    stack.callback(shutil.rmtree, folder, ignore_errors=True)
    experiment = write_experiment(folder, broker, settings)
    return {"broker": broker, "prefix": prefix, "experiment": experiment, "folder": folder}

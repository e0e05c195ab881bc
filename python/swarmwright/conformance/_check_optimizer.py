"""The check of one optimization tool: broker, process, scenes, rules."""

import shutil
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path

from swarmwright.conformance._broker import OPEN, open_broker
from swarmwright.conformance._process import Process
from swarmwright.conformance._run import run
from swarmwright.conformance.optimizer import RULES
from swarmwright.conformance.optimizer._tool import Tool, ToolSettings, write_experiment
from swarmwright.conformance.results import Report, Result
from swarmwright.conformance.rules import Profile


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
        command: what starts it, with {broker}, {prefix}, {experiment} (a file that the kit writes for
            the tools of Swarmwright) and {folder} (an empty one) in it; None when it is started by others.
        broker: address; None starts an embedded broker.
        prefix: what topics begin with.
        simulation: the only title that is offered; None offers whatever is asked for.
        sensors: numbers that an agent senses.
        actuators: numbers that an agent is steered by.
        episodes: in how many episodes the tool evaluates each candidate, if known; with {experiment} it is 2.
        lasts: seconds of one run at most.
        wait: seconds in which a tool that is started by others must be there.
        rules: ids and groups that are wanted, `-O5` for those that are not; default: all.
        profile: `d6.1` for those rules alone that D6.1 demands.
        tell: gets each result at once.
        say: gets a line for people where they have to act.

    Raises InputError (what was given is wrong) and RunError (no broker).

    """
    chosen = RULES.chosen(rules, profile)
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
    """New values of the placeholders, with a new folder."""
    folder = Path(tempfile.mkdtemp(prefix="conformance-"))
    stack.callback(shutil.rmtree, folder, ignore_errors=True)
    experiment = write_experiment(folder, broker, settings)
    return {"broker": broker, "prefix": prefix, "experiment": experiment, "folder": folder}

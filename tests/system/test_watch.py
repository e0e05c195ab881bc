"""`swarmwright servers --watch` with real servers: one is killed, one is stopped; which one is waited for?"""

import re
import signal
from typing import Any

import pytest

from tests.system.brokers import BrokerProcess
from tests.system.conftest import Experiment, Launch, Serve
from tests.system.processes import Program

LONG = """\
simulation: minisim
mode: {mode}
method: {{kind: nnga, population: 40, generations: 100000}}
ranking: {{episodes: 4}}
parameters: {{maxSteps: 100, numAgents: 4}}
faults: {{backup: false}}
seed: 1
"""


def views(watcher: Program) -> list[dict[str, Any]]:
    return [event for event in watcher.events() if "servers" in event]


def until(watcher: Program, what: str, reached: Any) -> dict[str, Any]:
    """The first view of which it is so."""
    watcher.until(lambda _: any(reached(view) for view in views(watcher)), what, 60)
    return next(view for view in views(watcher) if reached(view))


@pytest.mark.journey
@pytest.mark.timeout(150)
@pytest.mark.parametrize("mode", ["stepwise", "batched", "offloaded"])
def test_the_watch_names_the_server_that_is_waited_for(
    embedded: BrokerProcess, serve: Serve, launch: Launch, experiment: Experiment, mode: str
) -> None:
    servers = serve(embedded.url, "--no-restart", count=4)
    watcher = launch("servers", "--watch", "--json", "--every", 0.2, "--broker", embedded.url)
    lines = launch("servers", "--watch", "--every", 0.2, "--broker", embedded.url)
    until(watcher, "four servers", lambda view: len(view["servers"]) == 4)
    tool = launch("optimize", experiment(LONG.format(mode=mode)), "--broker", embedded.url, "--out", "here")
    begun = until(watcher, "a run", lambda view: any(one.get("generations") for one in view["tools"]))
    assert begun["tools"][0]["run"] == "here"
    assert begun["tools"][0]["generations"] == 100000

    servers.signal_server(2, signal.SIGKILL)

    def lost(view: dict[str, Any]) -> bool:
        return any(server["server"] == 2 and server["state"] == "lost" for server in view["servers"])

    until(watcher, "the killed server's loss", lost)
    servers.signal_server(3, signal.SIGSTOP)
    blocked = until(
        watcher, "a server that blocks", lambda view: view["blocking"] and view["blocking"]["silent"] > 2
    )
    assert blocked["blocking"]["server"] == 3
    assert re.match(r"server 3 has not .* for \d+\.\d s$", blocked["blocking"]["words"])
    (row,) = (server for server in blocked["servers"] if server["server"] == 3)
    kinds = {"stepwise": "episode", "batched": "batch", "offloaded": "block"}
    assert row["doing"][0]["kind"] == kinds[mode]
    assert row["tool"] == blocked["tools"][0]["tool"]
    assert blocked["tools"][0]["waits_for"].startswith("server 3 has not")
    lines.until(lambda program: any("server 3 has not" in line for line in program.lines), "the words", 10)

    servers.signal_server(3, signal.SIGCONT)
    tool.signal(signal.SIGINT)
    tool.wait()
    until(watcher, "the tool's farewell", lambda view: not view["tools"] and lost(view))
    for program in (watcher, lines):
        program.signal(signal.SIGINT)
        assert program.wait() == 0
        assert program.stderr == ""


def test_the_watch_names_a_server_that_is_reserved_for_a_tool_that_was_killed(
    embedded: BrokerProcess, serve: Serve, launch: Launch, experiment: Experiment
) -> None:
    serve(embedded.url)
    watcher = launch("servers", "--watch", "--json", "--every", 0.2, "--broker", embedded.url)
    lines = launch("servers", "--watch", "--every", 0.2, "--broker", embedded.url)
    text = LONG.format(mode="stepwise")
    tool = launch("optimize", experiment(text), "--broker", embedded.url, "--out", "here")
    until(watcher, "a run", lambda view: any(one.get("run") for one in view["tools"]))
    tool.signal(signal.SIGKILL)
    tool.wait()
    killed = until(watcher, "the killed tool's end", lambda view: not view["tools"] and view["abandoned"])
    assert killed["abandoned"] == [1]
    lines.until(
        lambda program: any("server 1 is still reserved for" in line for line in program.lines),
        "the words",
        10,
    )


def test_the_watch_shows_how_far_a_run_in_steady_state_is(
    embedded: BrokerProcess, serve: Serve, launch: Launch, experiment: Experiment
) -> None:
    """Evaluations count from the run's beginning, also when it is resumed; no generation is under way."""
    serve(embedded.url, count=2)
    watcher = launch("servers", "--watch", "--json", "--every", 0.2, "--broker", embedded.url)
    lines = launch("servers", "--watch", "--every", 0.2, "--broker", embedded.url)
    path = experiment(
        "simulation: minisim\nmode: stepwise\nseed: 1\nranking: {episodes: 2}\nparameters: {maxSteps: 100}\n"
        "method: {kind: nnga, population: 20, generations: 100000, operation: steady_state}\n"
    )
    tool = launch("optimize", path, "--broker", embedded.url, "--out", "steady", "--json")
    tool.until(lambda program: len(program.lines) >= 2, "two generations")

    def far(view: dict[str, Any], done: int) -> bool:
        return any(one.get("run") == "steady" and one["done"] >= done for one in view["tools"])

    seen = until(watcher, "two generations' evaluations", lambda view: far(view, 80))["tools"][0]
    assert seen["total"] == 20 * 100000 * 2
    assert "generation" not in seen
    lines.until(
        lambda program: any("run steady, 0 % of 4000000 evaluations" in line for line in program.lines), "it"
    )
    tool.signal(signal.SIGINT)
    assert tool.wait() == 130
    until(watcher, "its farewell", lambda view: not view["tools"])
    count = len(views(watcher))
    again = launch("resume", "steady", "--broker", embedded.url, "--json")
    again.until(lambda program: len(program.lines) >= 1, "a generation")
    watcher.until(lambda _: any(far(view, 1) for view in views(watcher)[count:]), "the resumed run")
    first = next(view for view in views(watcher)[count:] if far(view, 1))
    assert first["tools"][0]["done"] >= 80
    again.signal(signal.SIGINT)
    assert again.wait() == 130


def test_a_run_goes_well_where_access_rules_know_no_status(
    tmp_path: Any, cleanup: Any, launch: Launch, experiment: Experiment
) -> None:
    """Those of an older `broker --init`. Mosquitto 2.0.11 ends the connection of who publishes there."""
    from tests.system.ready_made import ReadyMade

    for kind in ("mosquitto", "embedded"):
        made = ReadyMade(tmp_path / kind, kind)
        cleanup.callback(made.stop)
        rules = made.folder / "acl"
        rules.write_text("".join(line for line in rules.read_text().splitlines(True) if "status" not in line))
        made.start()
        server = launch("serve", "minisim", "--id", 1, "--json", env=made.variables("server"))
        server.until_event("ready")
        out = tmp_path / f"out {kind}"
        path = experiment(LONG.format(mode="stepwise").replace("100000", "3"))
        tool = launch("optimize", path, "--out", out, env=made.variables("tool"))
        assert tool.wait(60) == 0, tool.stderr
        assert "monitors of servers and tools do not see this tool" in tool.stderr
        if "lost the broker" in tool.stderr:
            assert kind == "mosquitto"
            assert tool.stderr.count("lost the broker") == 1
        server.stop()

"""What is put together of what servers and tools say, with a clock of the test's own."""

from typing import Any

import pytest

from swarmwright.servers.broker.watching import (
    FORGET_S,
    MOST_SERVERS,
    MOST_TOOLS,
    STALE_S,
    Watch,
    describe_owed_message,
)

Json = dict[str, Any]
TOOL = "swarmwright@lab/1/00ff"


class Clock:
    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def presence(server: int, state: str = "busy", tool: str | None = TOOL) -> Json:
    return {
        "presence": {"server": server, "state": state, "simulations": ["minisim"], "tool": tool, "since": "?"}
    }


def work(server: int, silent: float, **more: Any) -> Json:
    text = f"server {server} has not answered a block of 12 evaluations for {silent:.1f} s"
    block = {"server": server, "kind": "block", "missing": "result", "evaluations": 12}
    return {**block, "silent": silent, "words": text, **more}


def status(*waiting_for: Json, token: str = "a", **more: Any) -> Json:
    least = {
        "version": 1,
        "tool": TOOL,
        "state": "evaluating",
        "simulation": "minisim",
        "done": 5,
        "total": 9,
    }
    return {"token": token, "status": {**least, "waiting_for": list(waiting_for), "servers": [], **more}}


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def watch(clock: Clock) -> Watch:
    return Watch(clock)


def test_the_server_that_was_silent_for_the_longest_time_is_the_blocking_one(watch: Watch) -> None:
    for server in (1, 2, 3):
        watch.update(presence(server))
    watch.update(status(work(1, 0.2), work(2, 1.5), work(3, 7.25)))
    blocking = watch.view().blocking
    assert blocking is not None
    assert blocking.server == 3
    assert describe_owed_message(blocking) == "server 3 has not answered a block of 12 evaluations for 7.2 s"
    assert watch.view().tools[0].waits_for == work(1, 0.2)["words"] or watch.view().tools[0].waits_for is None
    record = watch.view().record()
    assert record["blocking"] == {"server": 3, "silent": 7.25, "words": describe_owed_message(blocking)}
    assert [server["server"] for server in record["servers"]] == [1, 2, 3]


def test_a_server_whose_tool_has_ended_is_named(watch: Watch) -> None:
    watch.update(presence(1, "ready", None))
    watch.update(presence(2))
    watch.update(status(work(2, 0.2)))
    assert not watch.view().abandoned
    # Its last will.
    watch.update(presence(3))
    watch.update(status(state="left"))
    assert [(row.server, row.tool) for row in watch.view().abandoned] == [(2, TOOL), (3, TOOL)]
    assert watch.view().gone == {TOOL}
    assert watch.view().record()["abandoned"] == [2, 3]
    # It had only lost its connection.
    watch.update(status(work(2, 0.1)))
    assert watch.view().record()["abandoned"] == []


def test_a_server_is_reserved_for_a_tool_that_was_never_heard(watch: Watch, clock: Clock) -> None:
    watch.update(presence(1))
    assert not watch.view().abandoned
    clock.now += STALE_S + 0.1
    assert watch.view().abandoned
    watch.update(presence(1, "ready", None))
    assert not watch.view().abandoned


def test_nobody_blocks_while_everything_moves(watch: Watch) -> None:
    watch.update(presence(1))
    watch.update(status(work(1, 0.9)))
    assert watch.view().blocking is None
    assert watch.view().tools[0].waits_for is None
    assert watch.view().record()["blocking"] is None


def test_what_a_tool_said_long_ago_blames_no_server(watch: Watch, clock: Clock) -> None:
    """Between two generations a tool says nothing; what it said last is no news of its servers."""
    watch.update(presence(1))
    watch.update(status(work(1, 3.0)))
    assert watch.view().blocking is not None
    clock.now += STALE_S + 1
    view = watch.view()
    assert view.blocking is None
    assert view.servers[0].doing == []
    assert "no message for 4 s" in str(view.tools[0].waits_for)
    clock.now += FORGET_S
    assert watch.view().tools == []


def test_servers_and_tools_leave(watch: Watch) -> None:
    watch.update(presence(1, "ready", None))
    watch.update(status())
    watch.update(status(token="b"))
    assert (len(watch.view().servers), len(watch.view().tools)) == (1, 2)
    watch.update({"left": 1})
    watch.update({"left": 4})
    watch.update(status(state="left"))
    assert (len(watch.view().servers), len(watch.view().tools)) == (0, 1)


def test_a_server_that_says_nothing_of_itself_is_known_by_what_tools_say(watch: Watch) -> None:
    used = {"server": 9, "mode": "stepwise", "speed": 2.5, "failures": 0}
    watch.update(status(work(9, 0.1, kind="episode", step=4), servers=[used]))
    (server,) = watch.view().servers
    assert (server.server, server.state, server.tool, server.use["speed"]) == (9, None, TOOL, 2.5)
    assert server.doing[0]["step"] == 4


def test_of_two_tools_the_one_that_gave_it_work_says_how_fast_a_server_is(watch: Watch) -> None:
    for token, speed, works in (("a", 1.0, []), ("b", 2.0, [work(1, 0.1)]), ("c", 3.0, [])):
        used = {"server": 1, "mode": "offloaded", "speed": speed, "failures": 0}
        watch.update(status(*works, token=token, servers=[used], tool=f"tool {token}"))
    (server,) = watch.view().servers
    assert (server.use["speed"], server.tool) == (2.0, "tool b")


def test_work_without_a_server_is_told(watch: Watch) -> None:
    watch.update(status(no_server={"seconds": 12.5, "found": "server 1: has 3 dimensions"}))
    assert watch.view().tools[0].waits_for == "waiting for a server for 12.5 s (server 1: has 3 dimensions)"
    assert watch.view().blocking is None


def test_after_the_broker_was_lost_only_those_who_are_there_are_shown(watch: Watch) -> None:
    watch.update(presence(1))
    watch.update({"broker": "lost", "reason": "it closed the connection"})
    assert watch.view().broker_lost == "it closed the connection"
    assert len(watch.view().servers) == 1
    watch.update({"broker": "back"})
    watch.update(presence(2))
    assert watch.view().broker_lost is None
    assert [server.server for server in watch.view().servers] == [2]


def test_memory_is_bounded_where_peers_announce_themselves_without_end(watch: Watch) -> None:
    for server in range(MOST_SERVERS + 50):
        watch.update(presence(server))
    for number in range(MOST_TOOLS + 50):
        watch.update(status(work(1, 0.2), token=str(number)))
    view = watch.view()
    assert (len(view.servers), len(view.tools)) == (MOST_SERVERS, MOST_TOOLS)
    watch.update(presence(0, "lost"))
    assert watch.view().servers[0].state == "lost", "those that are known are kept up to date"
    for number in range(2 * MOST_SERVERS):
        watch.update(status(token="a", state="left", tool=f"tool {number}"))
    assert len(watch.view().gone) <= MOST_SERVERS


def test_texts_of_announcements_are_cut(watch: Watch) -> None:
    long = presence(1, tool="x" * 100_000)
    long["presence"]["capabilities"] = {"of any size": ["y" * 1000] * 1000}
    long["presence"]["simulations"] = ["z" * 100_000] * 1000
    watch.update(long)
    [row] = watch.view().servers
    assert len(str(row.record())) < 50_000
    assert "capabilities" not in (row.presence or {})

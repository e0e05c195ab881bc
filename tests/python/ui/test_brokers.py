"""What a window shows of brokers: one connection for all who look, and only to its owner's brokers."""

import json
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from swarmwright import InputError, _engine
from swarmwright.servers.broker.credentials import location_of
from swarmwright.servers.broker.watching import Watch
from swarmwright.ui import brokers
from swarmwright.ui.app import create_app
from swarmwright.ui.brokers import MOST_BROKERS, MOST_ROWS, Brokers, BrokerWatch, describe, list_endpoints
from tests.python.servers.broker.test_watching import presence, status, work
from tests.python.ui.client import call

HOSTILE = "</script><img src=x onerror=alert(1)>\u202e"


@pytest.fixture
def broker() -> Iterator[Any]:
    started = _engine.Broker()
    yield started
    started.stop()


def until(ask: Callable[[], Any], holds: Callable[[Any], bool], seconds: float = 20) -> Any:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        answer = ask()
        if holds(answer):
            return answer
        time.sleep(0.05)
    pytest.fail(f"still so: {answer}")


def look(watch: BrokerWatch) -> dict[str, Any]:
    answer: dict[str, Any] = json.loads(watch.look())
    return answer


def test_all_who_look_share_a_connection_that_ends_with_them(
    broker: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(brokers, "UNWATCHED_S", 0.2)
    monkeypatch.setattr(brokers, "EVERY_S", 0.1)
    watch = BrokerWatch(broker.url, "")
    assert not watch.is_connected, "nobody has looked"
    assert look(watch)["state"] == "connected"
    thread = watch._thread
    assert watch.look() is watch.look(), "what is shown is made once for all"
    assert watch._thread is thread
    until(lambda: watch.is_connected, lambda connected: not connected)
    assert look(watch)["state"] == "connected", "it comes back with the next who looks"
    assert watch.count() == 0
    watch.close()
    assert not watch.is_connected


def test_a_broker_that_is_away_is_told_and_found_when_it_comes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(brokers, "RETRY_S", 0.1)
    first = _engine.Broker()
    port, url = first.port, first.url
    first.stop()
    watch = BrokerWatch(url, "")
    away = until(lambda: look(watch), lambda answer: answer["state"] == "away")
    assert len(away["messages"]) == 1
    assert str(port) in away["messages"][0]
    assert watch.count() is None
    again = _engine.Broker(port=port)
    until(lambda: look(watch), lambda answer: answer["state"] == "connected")
    again.stop()
    lost = until(lambda: look(watch), lambda answer: answer["state"] == "away")
    assert "is lost" in lost["messages"][0]
    watch.close()


def test_servers_are_described_with_their_work_and_their_run() -> None:
    watch = Watch()
    watch.update(presence(2**62, "busy"))
    watch.update(presence(5, "ready", None))
    used = [{"server": 2**62, "mode": "offloaded", "failures": 2, "speed": 12.3456, "reason": HOSTILE}]
    watch.update(status(work(2**62, 0.25), run=HOSTILE, generation=3, generations=9, servers=used))
    values = describe(watch.view(), {5: {"run": "before", "speed": 3.0, "at": 1.0}})
    idle, busy = values["servers"]
    assert (idle["server"], idle["state"], idle["work"], idle["last"]["run"]) == (
        "5",
        "ready",
        None,
        "before",
    )
    assert (busy["server"], busy["run"], busy["work"]) == (str(2**62), HOSTILE, "block of 12")
    assert (busy["speed"], busy["silent"], busy["failures"]) == (12.3, 0.25, 2)
    assert values["tools"][0]["generation"] == 3


def test_of_many_servers_some_are_listed_and_the_others_counted() -> None:
    watch = Watch()
    for server in range(MOST_ROWS + 7):
        watch.update(presence(server, "ready", None))
    values = describe(watch.view(), {})
    assert (len(values["servers"]), values["more_servers"]) == (MOST_ROWS, 7)


@pytest.mark.parametrize(
    ("url", "prefix", "message"),
    [
        ("http://lab", "", "broker: the address must begin with"),
        ("mqtt://user:secret@lab", "", "must not contain a user or a password"),
        ("mqtt://", "", "has no host"),
        ("mqtt://lab", "a/#", "prefix: must not contain"),
        (HOSTILE, "", "broker: the address"),
    ],
)
def test_addresses_that_are_none_are_refused(url: str, prefix: str, message: str) -> None:
    chosen = Brokers("mqtt://localhost:1883")
    with pytest.raises(InputError, match=message) as refusal:
        chosen.add(url, prefix)
    assert "secret" not in str(refusal.value)


def test_brokers_are_those_of_the_owner_and_not_many() -> None:
    chosen = Brokers("mqtt://localhost:1883", "lab")
    assert chosen.find("", "").prefix == "lab"
    with pytest.raises(InputError, match="does not show that broker"):
        chosen.find("mqtt://elsewhere", "")
    for number in range(3 * MOST_BROKERS):
        chosen.add(f"mqtt://host-{number}", "")
    addresses = chosen.list_addresses()
    assert list_endpoints("mqtt://lab,mqtts://lab") == list_endpoints("mqtt://lab:1883, mqtts://lab:8883")
    assert addresses[0] == ("mqtt://localhost:1883", "lab")
    assert len(addresses) == MOST_BROKERS


def test_one_more_than_all_brokers_that_are_watched_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(BrokerWatch, "is_connected", True)
    chosen = Brokers("mqtt://localhost:1883")
    for number in range(MOST_BROKERS - 1):
        chosen.add(f"mqtt://host-{number}", "")
    with pytest.raises(InputError, match=r"at most 8 are watched at once; close the page of another"):
        chosen.add("mqtt://another", "")
    chosen.add("mqtt://host-0", "")
    assert len(chosen.list_addresses()) == MOST_BROKERS


def test_the_queue_asks_only_brokers_of_the_window(broker: Any) -> None:
    chosen = Brokers(broker.url)
    assert chosen.count_servers("mqtt://elsewhere", "") is None
    chosen.require(f" {broker.url}/")
    for other in (f"mqtts://{location_of(broker.url)}", "mqtt://elsewhere", f"{broker.url},mqtt://elsewhere"):
        with pytest.raises(InputError, match="sends it no account"):
            chosen.require(other)
    assert chosen.list_addresses() == [(broker.url, "")]
    assert chosen.count_servers(broker.url, "elsewhere") is None
    assert until(lambda: chosen.count_servers(broker.url, ""), lambda count: count is not None) == 0
    assert chosen.count_servers(f" {broker.url}/", "") == 0
    broker.stop()
    watch = chosen.find("", "")
    until(lambda: look(watch), lambda answer: answer["state"] == "away")
    assert chosen.count_servers(broker.url, "") is None, "its servers may be gone"
    chosen.close()
    assert not watch.is_connected


def test_a_watch_goes_on_after_a_message_that_nobody_has_thought_of(
    broker: Any, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(brokers, "RETRY_S", 0.1)
    watch = BrokerWatch(broker.url, "")
    answers: dict[str, Any] = {}
    with monkeypatch.context() as patch:
        patch.setattr(brokers, "describe", lambda *_: answers["new"])
        away = until(lambda: look(watch), lambda answer: answer["state"] == "away")
        assert "cannot be shown: KeyError" in away["messages"][0]
    until(lambda: look(watch), lambda answer: answer["state"] == "connected")
    assert f"the servers on {broker.url} cannot be shown" in caplog.text
    watch.close()


def test_all_are_closed_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(brokers, "CLOSE_S", 0.3)
    chosen = Brokers("mqtt://localhost:1883")
    stuck = threading.Event()
    for number in range(MOST_BROKERS - 1):
        chosen.add(f"mqtt://host-{number}", "")
        watch = chosen.find(f"mqtt://host-{number}", "")
        watch._thread = threading.Thread(target=stuck.wait, daemon=True)
        watch._thread.start()
    begin = time.monotonic()
    chosen.close()
    assert time.monotonic() - begin < 1.0
    assert all(chosen.find(*key)._closed.is_set() for key in chosen.list_addresses())
    stuck.set()


def post(app: Any, name: str, values: Any) -> Any:
    body = json.dumps(values).encode()
    return call(app, f"/api/{name}", method="POST", headers={"content-type": "application/json"}, body=body)


@pytest.mark.parametrize(
    ("name", "values", "message"),
    [
        ("broker", {}, "broker: must be text"),
        ("broker", {"broker": "mqtt://a:b@c", "prefix": ""}, "must not contain a user"),
        ("serve", {"broker": "mqtt://elsewhere", "prefix": ""}, "does not show that broker"),
        ("serve", {"broker": "", "prefix": "", "count": 0, "simulation": "minisim"}, "count: must be from 1"),
        ("serve", {"broker": "", "prefix": "", "count": "2.5", "simulation": "minisim"}, "whole number"),
        ("serve", {"broker": "", "prefix": "", "count": 2, "simulation": ""}, "simulation: enter"),
        ("serve", {"broker": "", "prefix": "", "count": 2, "simulation": "a\n--trust"}, "simulation: enter"),
        ("start_broker", {"port": 0}, "port: must be from 1"),
        ("start_broker", {"port": True}, "whole number"),
    ],
)
def test_wrong_requests_start_nothing(tmp_path: Path, name: str, values: Any, message: str) -> None:
    app = create_app(tmp_path, token=None)
    answer = post(app, name, values)
    assert answer.status == 422
    assert message in answer.values["error"]
    assert call(app, "/api/brokers").values["jobs"] == []


def test_a_window_for_showing_connects_to_its_own_broker_alone(tmp_path: Path, broker: Any) -> None:
    app = create_app(tmp_path, token=None, read_only=True, broker=broker.url)
    assert call(app, "/api/servers").values["state"] == "connected"
    assert post(app, "broker", {"broker": "mqtt://elsewhere", "prefix": ""}).status == 405
    other = call(app, "/api/servers", broker="mqtt://elsewhere")
    assert (other.status, "does not show" in other.values["error"]) == (422, True)


def test_a_simulation_is_never_an_option(tmp_path: Path) -> None:
    app = create_app(tmp_path, token=None)
    values = {"broker": "", "prefix": "", "count": 2, "simulation": "--restart"}
    answer = post(app, "serve", {**values, "broker": "mqtt://localhost:1883"})
    assert answer.values["jobs"][0]["arguments"][-2:] == ["--", "--restart"]

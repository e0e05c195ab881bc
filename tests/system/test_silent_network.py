"""Connections that fail without a word, as where a firewall forgets them or a machine changes its network."""

import asyncio
import time
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.paced_simulation import written
from tests.system.brokers import BrokerProcess
from tests.system.conftest import Experiment, Launch
from tests.system.proxy import Proxy
from tests.system.runs import record, warnings


class Relay(Proxy):
    """Passes bytes on to a broker of this machine; after `hush` none on connections that were made before."""

    def __init__(self, port: int) -> None:
        super().__init__(port)
        self._open: list[asyncio.Event] = []
        self._tasks: set[asyncio.Task[None]] = set()
        self._writers: list[asyncio.StreamWriter] = []

    def hush(self) -> None:
        """Have all connections fail silently; new ones can be made."""

        def clear() -> None:
            for one in self._open:
                one.clear()
            self._open.clear()

        self._loop.call_soon_threadsafe(clear)

    async def _stop(self) -> None:
        await super()._stop()
        for writer in self._writers:
            writer.transport.abort()
        await asyncio.sleep(0)

    async def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        there, onwards = await asyncio.open_connection("127.0.0.1", self._port)
        self._writers += [writer, onwards]
        passes = asyncio.Event()
        passes.set()
        self._open.append(passes)
        for way in (self._pass(reader, onwards, passes), self._pass(there, writer, passes)):
            self._tasks.add(asyncio.ensure_future(way))

    async def _pass(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, passes: asyncio.Event
    ) -> None:
        try:
            while data := await reader.read(1 << 16):
                await passes.wait()
                writer.write(data)
                await writer.drain()
        except OSError:
            pass
        finally:
            # The end of a hushed connection does not pass either.
            if passes.is_set():
                writer.close()


@pytest.mark.parametrize("silent", ["tool", "servers", "all"])
def test_a_run_goes_on_when_connections_fail_silently(
    silent: str,
    embedded: BrokerProcess,
    launch: Launch,
    experiment: Experiment,
    tmp_path: Path,
    cleanup: ExitStack,
) -> None:
    relay = cleanup.enter_context(Relay(embedded.port))
    method = "{kind: nnga, population: 12, generations: 10}"
    path = experiment(
        f"simulation: {written(tmp_path)}\nrequirements: {{dimensions: 1}}\nmethod: {method}\n"
        "mode: stepwise\nvalidate: false\ntimeouts: {keep_alive: 1}\n"
    )
    local = launch("optimize", path, "--servers", "in-process", "--out", "local")
    url = embedded.url if silent == "tool" else relay.url
    servers = launch(
        "serve",
        f"{tmp_path}/paced.py:Paced",
        *("--broker", url, "--count", 2, "--json"),
        env={"SWARMWRIGHT_KEEP_ALIVE": "1"},
    )
    servers.until_event("ready", 2)
    there = experiment(path.read_text().replace(f"{tmp_path}/paced.py:Paced", "paced"), "there.yaml")
    url = embedded.url if silent == "servers" else relay.url
    run = launch("optimize", there, "--broker", url, "--out", "result", "--json")
    run.until(lambda program: sum("best_so_far" in line for line in program.lines) >= 2, "two generations")
    began = time.monotonic()
    relay.hush()
    if silent != "servers":
        run.until_error("the broker has not answered a ping", 10)
        assert time.monotonic() - began < 5
    assert run.wait(60) == 0, run.stderr
    assert local.wait() == 0, local.stderr
    assert record(tmp_path / "result") == record(tmp_path / "local")
    told = any("has not answered a ping for 0.5 s" in text for text in warnings(tmp_path / "result"))
    assert told == (silent != "servers")


def test_a_keep_alive_interval_that_cannot_be_is_named(launch: Launch, experiment: Experiment) -> None:
    server = launch("serve", "minisim", env={"SWARMWRIGHT_KEEP_ALIVE": "often"})
    assert server.wait() != 0
    assert "SWARMWRIGHT_KEEP_ALIVE (environment): expected whole seconds from 1 to 3600" in server.stderr
    run = launch("optimize", experiment("simulation: minisim\ntimeouts: {keep_alive: 0}\n"))
    assert run.wait() == 2
    assert "keep_alive" in run.stderr

"""Stepwise evaluation and bare MQTT, on the embedded broker and on Mosquitto."""

import contextlib
from collections.abc import Iterator

from benchmarks import bare, paho
from benchmarks.measurement import Samples
from benchmarks.processes import Broker, embedded, mosquitto, peak_memory, servers
from benchmarks.stepwise import Stepwise, message_sizes

SERVERS = 8
AGENTS = (1, 10, 100)


class BrokerSuite:
    """All that is measured on one broker; its servers run from start to end."""

    def __init__(self, broker: Broker, seconds: float, round_trips: int, flood: int) -> None:
        self._broker, self._round_trip_count, self._flood_count = broker, round_trips, flood
        self._sizes = message_sizes(broker, "bench/1")
        on = f"({broker.name})"
        self._pingpong = Samples(f"bare ping-pong {on}", "us")
        self._paho = Samples(f"paho ping-pong {on}", "us", self._pingpong)
        self._step = Samples(f"step round trip {on}", "us", self._pingpong, "<= 1.5")
        self._episode = Samples(f"episode without its steps {on}", "us", self._pingpong)
        self._flood = Samples(f"bare flood, one to one {on}", "messages/s")
        self._floors: dict[int, Samples] = {}
        self._ours: dict[int, Samples] = {}
        self._counts: dict[int, int] = {}
        for agents in AGENTS:
            shape = f"{SERVERS} servers, {agents} {'agents' if agents > 1 else 'agent'} each {on}"
            self._floors[agents] = Samples(f"bare messages, {shape}", "agent-steps/s")
            self._ours[agents] = Samples(
                f"stepwise, {shape}", "agent-steps/s", self._floors[agents], ">= 0.8"
            )

            rate = bare.swarm(broker, 5 + 200 // agents, self._sizes, SERVERS, agents)
            self._counts[agents] = max(5, round(rate * seconds / (SERVERS * agents)))

    def repeat(self) -> None:
        """Take one sample of everything."""
        self._round_trips()
        for agents in AGENTS:
            self._saturated(agents)

    def _round_trips(self) -> None:
        broker, sizes, count = self._broker, self._sizes, self._round_trip_count
        self._pingpong.add(bare.pingpong(broker, count, sizes))
        with contextlib.closing(Stepwise(broker, "bench/1", 1, 1, count)) as pool:
            long = pool.evaluate(1)
        per_step = long.episode_seconds / long.steps
        self._step.add(per_step * 1e6)
        with contextlib.closing(Stepwise(broker, "bench/1", 1, 1, 1)) as pool:
            short = pool.evaluate(50)
        self._episode.add((short.episode_seconds / short.episodes - per_step) * 1e6)
        self._paho.add(paho.pingpong(broker, max(20, count // 5), sizes))
        self._flood.add(bare.flood(broker, self._flood_count, sizes))

    def _saturated(self, agents: int) -> None:
        steps = self._counts[agents]
        self._floors[agents].add(bare.swarm(self._broker, steps, self._sizes, SERVERS, agents))
        with contextlib.closing(Stepwise(self._broker, "bench/8", SERVERS, agents, steps)) as pool:
            done = pool.evaluate(SERVERS)
        self._ours[agents].add(done.agent_steps / done.seconds)

    def samples(self) -> Iterator[Samples]:
        """Everything measured, in the order of the table."""
        yield from (self._pingpong, self._step, self._episode, self._paho, self._flood)
        for agents in AGENTS:
            yield self._floors[agents]
            yield self._ours[agents]


class MqttSuite:
    """Both brokers, each in a process of its own."""

    def __init__(self, seconds: float, round_trips: int, flood: int) -> None:
        bare.build()
        self._stack = contextlib.ExitStack()
        self._brokers = [self._stack.enter_context(start()) for start in (embedded, mosquitto)]
        for broker in self._brokers:
            self._stack.enter_context(servers(broker, 1, "bench/1"))
            self._stack.enter_context(servers(broker, SERVERS, "bench/8"))
        self._suites = [BrokerSuite(broker, seconds, round_trips, flood) for broker in self._brokers]

    def repeat(self) -> None:
        """Take one sample of everything."""
        for suite in self._suites:
            suite.repeat()

    def samples(self) -> list[Samples]:
        """Everything measured, in the order of the table; the brokers' memory after all of it."""
        found = [one for suite in self._suites for one in suite.samples()]
        for broker in self._brokers:
            name = f"peak memory, {broker.name} broker"
            found.append(Samples(name, "MB", values=[peak_memory(broker.pid)]))
        return found

    def close(self) -> None:
        """End brokers and servers."""
        self._stack.close()

"""What is measured, in which order: everything once in each repetition, so that all meet the same noise."""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass

from benchmarks import bare, paho, program
from benchmarks.measurement import Samples
from benchmarks.processes import Broker, embedded, mosquitto, peak_memory, servers
from benchmarks.stepwise import Stepwise, message_sizes

SERVERS = 8
AGENTS = (1, 10, 100)


@dataclass(frozen=True, kw_only=True)
class Scale:
    """How much is done for one sample. seconds: what a saturated sample of the floor is to take.

    round_trips: of a ping-pong and of an episode.
    """

    repetitions: int = 5
    seconds: float = 0.7
    round_trips: int = 5000
    flood: int = 200_000
    program: bool = True


QUICK = Scale(repetitions=1, seconds=0.02, round_trips=100, flood=2000, program=False)


class BrokerSuite:
    """All that is measured on one broker; its servers run from start to end."""

    def __init__(self, broker: Broker, scale: Scale) -> None:
        self._broker, self._scale = broker, scale
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
            self._counts[agents] = max(5, round(rate * scale.seconds / (SERVERS * agents)))

    def repeat(self) -> None:
        """Take one sample of everything."""
        self._round_trips()
        for agents in AGENTS:
            self._saturated(agents)

    def _round_trips(self) -> None:
        broker, sizes, count = self._broker, self._sizes, self._scale.round_trips
        self._pingpong.add(bare.pingpong(broker, count, sizes))
        with contextlib.closing(Stepwise(broker, "bench/1", 1, 1, count)) as pool:
            long = pool.evaluate(1)
        per_step = long.episode_seconds / long.steps
        self._step.add(per_step * 1e6)
        with contextlib.closing(Stepwise(broker, "bench/1", 1, 1, 1)) as pool:
            short = pool.evaluate(50)
        self._episode.add((short.episode_seconds / short.episodes - per_step) * 1e6)
        self._paho.add(paho.pingpong(broker, max(20, count // 5), sizes))
        self._flood.add(bare.flood(broker, self._scale.flood, sizes))

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


class ProgramSuite:
    """What does not depend on the broker."""

    def __init__(self) -> None:
        self._python = Samples("python -c pass", "ms")
        self._import = Samples("python -c 'import swarmwright'", "ms", self._python)
        self._help = Samples("swarmwright --help", "ms", self._python)
        self._whole = Samples("swarmwright optimize experiments/minisim.yaml --servers 2", "s")
        self._rate = Samples("its evaluations", "evaluations/s")

    def repeat(self) -> None:
        """Take one sample of everything."""
        self._python.add(program.start_up("-c", "pass"))
        self._import.add(program.start_up("-c", "import swarmwright"))
        self._help.add(program.help_start_up())
        seconds, evaluations = program.whole_run()
        self._whole.add(seconds)
        self._rate.add(evaluations / seconds)

    def samples(self) -> Iterator[Samples]:
        """Everything measured, in the order of the table."""
        yield from (self._python, self._import, self._help, self._whole, self._rate)


def run(scale: Scale) -> list[Samples]:
    """Measure everything."""
    bare.build()
    with contextlib.ExitStack() as stack:
        brokers = [stack.enter_context(embedded()), stack.enter_context(mosquitto())]
        for broker in brokers:
            stack.enter_context(servers(broker, 1, "bench/1"))
            stack.enter_context(servers(broker, SERVERS, "bench/8"))
        suites: list[BrokerSuite | ProgramSuite] = [BrokerSuite(broker, scale) for broker in brokers]
        if scale.program:
            suites.append(ProgramSuite())
        for _ in range(scale.repetitions):
            for suite in suites:
                suite.repeat()
        samples = [one for suite in suites for one in suite.samples()]
        if scale.program:
            samples += _memory(brokers)
    return samples


def _memory(brokers: list[Broker]) -> list[Samples]:
    """Peak memory: of the brokers after all of the above, of tool and server in the example."""
    tool, server = program.peak_memories(brokers[0])
    found = [("optimization tool", tool), ("simulation server", server)]
    found += [(f"{broker.name} broker", peak_memory(broker.pid)) for broker in brokers]
    return [Samples(f"peak memory, {name}", "MB", values=[value]) for name, value in found]

"""Servers of very different speeds: are all of them kept busy, and do all wait for the slowest in the end?"""

import threading
import time
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from benchmarks.measurement import Samples
from benchmarks.stepwise import ARCHITECTURE
from swarmwright import Simulation, _engine
from swarmwright.simulations.host import Host

SERVERS = 16
QUICKEST, SLOWEST = 0.020, 0.200
"""Seconds of an episode."""
SECONDS = 12.0
"""What all episodes together take at best."""


def _sleeper(seconds: float, starts: list[float]) -> type[Simulation]:
    """A simulation whose episodes take so long and no processor: 16 of them disturb nobody.

    starts: gets when each of them began.
    """

    class Sleeper(Simulation):
        title = "sleeper"
        sensors = 4
        actuators = 1

        def reset(self, parameters: dict[str, Any], seed: int) -> ArrayLike:  # noqa: ARG002
            self.over = False
            return np.zeros((1, 4))

        def step(self, actions: NDArray[np.float32]) -> ArrayLike:  # noqa: ARG002
            starts.append(time.perf_counter())
            time.sleep(seconds)
            self.over = True
            return np.zeros((1, 4))

        def done(self) -> bool:
            return self.over

        def fitness(self) -> float:
            return 0.0

    return Sleeper


class BusySuite:
    """16 servers whose episodes take 20 to 200 ms: episodes a second against the sum of their speeds.

    And how much later the last episode is over than if no server had ever waited, from one beginning to
    the next as measured: in median episodes.
    """

    def __init__(self) -> None:
        self._broker = _engine.Broker()
        paces = np.geomspace(QUICKEST, SLOWEST, SERVERS)
        self._ideal = float((1 / paces).sum())
        self._starts: list[list[float]] = [[] for _ in paces]
        for server, pace in enumerate(paces):
            serve = threading.Thread(target=self._serve, args=(server, float(pace)), daemon=True)
            serve.start()
        self._pool = _engine.Pool(
            self._broker.url,
            simulation="sleeper",
            parameters={},
            requirements={"dimensions": 2},
            mode="offloaded",
            alone=True,
        )
        self._pool.wait_for_server()
        self._floor = Samples(
            "16 servers of speeds 1:10, sum of their speeds", "episodes/s", values=[self._ideal]
        )
        self._ours = Samples("16 servers of speeds 1:10, kept busy", "episodes/s", self._floor, aim=">= 0.97")
        self._last = Samples("the last episode after the ideal end", "median episodes", aim="<= 1.5")
        self._episodes = round(SECONDS * self._ideal)
        self._evaluate(4 * SERVERS)  # how fast each of them is

    def _serve(self, server: int, pace: float) -> None:
        _engine.serve(Host(_sleeper(pace, self._starts[server])), self._broker.url, id=server, alone=True)

    def _evaluate(self, candidates: int) -> float:
        genomes = np.zeros((candidates, _engine.genome_size(ARCHITECTURE)), dtype=np.float32)
        start = time.perf_counter()
        self._pool.evaluate(ARCHITECTURE, genomes, [0])
        return time.perf_counter() - start

    def repeat(self) -> None:
        """Take one sample of everything."""
        for starts in self._starts:
            starts.clear()
        took = self._evaluate(self._episodes)
        self._ours.add(self._episodes / took)
        cycles = [np.diff(starts) for starts in self._starts]
        ideal = self._episodes / sum(1 / np.median(cycle) for cycle in cycles)
        self._last.add(float((took - ideal) / np.median(np.concatenate(cycles))))

    def samples(self) -> list[Samples]:
        """Everything measured, in the order of the table."""
        return [self._floor, self._ours, self._last]

    def close(self) -> None:
        """End everything that was started."""
        self._pool.close()
        self._broker.stop()

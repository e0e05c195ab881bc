"""Logs of an episode, a file for each agent, and the fitness that they give."""

import math
import re
from dataclasses import dataclass
from pathlib import Path

_HEAD = re.compile(r"# agent (\d+) of (\d+), steps (\d+), episode (\w+)")
_COLUMNS = "step,x,y,distance,out"


class LogError(Exception):
    """Logs are missing, incomplete, or of different episodes."""


@dataclass(frozen=True)
class AgentLog:
    """What one agent has logged; the first entry is its start, each further one a step that it has made."""

    places: tuple
    """Cells (x, y)."""
    distances: tuple
    """To the nearest exit, in cells."""
    out: bool
    """Whether it has left by an exit."""


@dataclass(frozen=True)
class Logs:
    """The logs of all agents of one episode, in their order."""

    agents: tuple
    steps: int
    """After which the episode ends at the latest."""

    @property
    def distance(self):
        """Sum of the last distances, in cells; of binary64, agent by agent."""
        total = 0.0
        for agent in self.agents:
            total += agent.distances[-1]
        return total

    @property
    def fitness(self):
        """The fitness of D6.1, section 4.2: minus the sum of the last distances."""
        return -self.distance

    @property
    def finished(self):
        """The step, from 0, in which the last agent got out; `steps` if not all did."""
        if not all(agent.out for agent in self.agents):
            return self.steps
        return max(len(agent.places) for agent in self.agents) - 2

    @property
    def frevo_fitness(self):
        """FREVO's fitness: with a bonus of up to 1 for the steps that were not needed."""
        fitness = (self.steps - self.finished) / self.steps
        for agent in self.agents:
            fitness -= agent.distances[-1]
        return fitness

    def positions(self, step):
        """Return where every agent is after so many steps."""
        return [agent.places[min(step, len(agent.places) - 1)] for agent in self.agents]


def read(folder):
    """Return the logs in a folder.

    Raises:
        LogError: what is missing, or does not belong together.
    """
    first, head = _read(Path(folder) / "agent_0.csv")
    _, count, steps, episode = head
    agents = [first]
    for index in range(1, int(count)):
        path = Path(folder) / f"agent_{index}.csv"
        agent, (number, *common) = _read(path)
        if number != str(index) or common != [count, steps, episode]:
            raise LogError(
                f"{path}: is of another episode than agent_0.csv; give each episode a folder of its own"
            )
        agents.append(agent)
    for index, agent in enumerate(agents):
        if not agent.out and len(agent.places) != int(steps) + 1:
            raise LogError(
                f"{folder}/agent_{index}.csv: ends after {len(agent.places) - 1} of {steps} steps; "
                "the episode was interrupted"
            )
    return Logs(tuple(agents), int(steps))


def _read(path):
    try:
        lines = path.read_text(encoding="ascii").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise LogError(f"{path}: {error}") from error
    head = _HEAD.fullmatch(lines[0]) if lines else None
    if head is None or lines[1:2] != [_COLUMNS]:
        raise LogError(f"{path}: is not the log of an agent, or its episode has not begun")
    places, distances, out = [], [], False
    for expected, line in enumerate(lines[2:]):
        try:
            step, x, y, distance, leaves = line.split(",")
            places.append((int(x), int(y)))
            distances.append(float(distance))
            out = leaves == "1"
            wrong = int(step) != expected or not math.isfinite(distances[-1])
        except ValueError:
            wrong = True
        if wrong:
            raise LogError(
                f"{path}:{expected + 3}: expected step {expected}, a cell and its distance, found {line!r}"
            )
    if not places:
        raise LogError(f"{path}: has no steps; its episode has not begun")
    return AgentLog(tuple(places), tuple(distances), out), head.groups()

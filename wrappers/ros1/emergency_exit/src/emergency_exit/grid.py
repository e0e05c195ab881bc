"""The rules of Emergency Exit: what agents sense, and where their moves lead.

The same as Swarmwright's simulation `emergency_exit`, cell by cell. Positions are cells (x, y), (0, 0)
top-left, y downwards.
"""

import math

from emergency_exit.fields import Field

DIRECTIONS = ((0, -1), (1, -1), (1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1))
"""N, NE, E, SE, S, SW, W, NW."""


def velocity(actuator):
    """Return -1, 0 or 1: the actuator rounded, 0.5 upwards."""
    return int(actuator >= 0.5) - int(actuator < -0.5)


class Grid:
    """Agents on a field. Who is out acts no more and occupies no cell."""

    def __init__(self, field: Field):
        self.field = field
        self.places = list(field.agents)
        self.out = [False] * len(field.agents)
        self._blockades = frozenset(field.blockades)
        self._occupied = set(field.agents)
        self._nearest = {}

    def inside(self):
        """Return the agents that are not out, ascending."""
        return [agent for agent, out in enumerate(self.out) if not out]

    def to_exit(self, agent):
        """Return columns and rows to the nearest exit, the first one in the list on ties."""
        place = self.places[agent]
        if place not in self._nearest:
            ways = [(x - place[0], y - place[1]) for x, y in self.field.exits]
            self._nearest[place] = min(ways, key=lambda way: way[0] ** 2 + way[1] ** 2)
        return self._nearest[place]

    def distance(self, agent):
        """Return the distance to the nearest exit, in cells."""
        dx, dy = self.to_exit(agent)
        return math.sqrt(dx * dx + dy * dy)

    def sense(self, agent):
        """Return the 10 sensors."""
        free = [float(self._free(self.places[agent], direction)) for direction in DIRECTIONS]
        return [*map(float, self.to_exit(agent)), *free]

    def act(self, agent, actuators):
        """Move one agent, at once."""
        target = self._target(agent, actuators)
        if target is not None:
            self._occupied.discard(self.places[agent])
            self._occupied.add(target)
            self.places[agent] = target
        if self._leaves(agent):
            self._occupied.discard(self.places[agent])

    def act_all(self, moves):
        """Move agents that have all sensed before; `moves` are pairs of agent and actuators, ascending.

        A cell on which an agent stood is not free before all have moved.
        """
        left = []
        for agent, actuators in moves:
            target = self._target(agent, actuators)
            if target is not None:
                left.append(self.places[agent])
                self._occupied.add(target)
                self.places[agent] = target
            if self._leaves(agent):
                left.append(self.places[agent])
        self._occupied.difference_update(left)

    def _leaves(self, agent):
        self.out[agent] = self.to_exit(agent) == (0, 0)
        return self.out[agent]

    def _target(self, agent, actuators):
        move = (velocity(actuators[0]), velocity(actuators[1]))
        if move == (0, 0) or not self._free(self.places[agent], move):
            return None
        x, y = self.places[agent]
        return (x + move[0], y + move[1])

    def _free(self, place, direction):
        x, y = place[0] + direction[0], place[1] + direction[1]
        # In FREVO those below the last row of a random field may walk on up there and sideways, but not down.
        if direction[1] == 1 and y >= self.field.height:
            return False
        within = 0 <= x < self.field.width and 0 <= y < self.field.rows
        return within and (x, y) not in self._blockades and (x, y) not in self._occupied

"""A simulation that takes a given time: disturbances of servers find work under way."""

from pathlib import Path

_SOURCE = '''\
"""An agent moves along a line; 0.04 s an episode."""

import time

import swarmwright


class Paced(swarmwright.Simulation):
    """Come close to 2."""

    title, dimensions, sensors, actuators, parameters = "paced", 1, 1, 1, {}

    def reset(self, parameters, seed):
        """Begin at 9."""
        self.place, self.left = 9.0, 20
        return [[self.place]]

    def step(self, actuators):
        """Move."""
        time.sleep(0.002)
        self.place += actuators[0][0]
        self.left -= 1
        return [[self.place]]

    def done(self):
        """Whether 20 steps were made."""
        return self.left == 0

    def fitness(self):
        """The nearer to 2 the better."""
        return -abs(self.place - 2.0)
'''


def written(folder: Path) -> str:
    """Write the simulation into a folder; return its name."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "paced.py").write_text(_SOURCE)
    return f"{folder}/paced.py:Paced"

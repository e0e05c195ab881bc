"""An episode: whose turn it is. Decisions only; the world node has the messages."""

from emergency_exit.grid import Grid


class Episode:
    """Steps of all agents, one turn after another."""

    def __init__(self, field, steps, update):
        self.grid = Grid(field)
        self.steps = steps
        self._simultaneous = update == "simultaneous"

    def play(self, ask):
        """Play to the end; return the number of steps.

        Args:
            ask: gets a list of agents, gives each its turn, and returns their actuators in the same order.
                Agents that act one after another are asked one by one.
        """
        for step in range(self.steps):
            inside = self.grid.inside()
            if not inside:
                return step
            if self._simultaneous:
                self.grid.act_all(list(zip(inside, ask(inside), strict=True)))
            else:
                for agent in inside:
                    self.grid.act(agent, ask([agent])[0])
        return self.steps

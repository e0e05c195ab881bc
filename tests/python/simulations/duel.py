"""A match of two sides for the tests: whoever pulls more wins, with chance."""

from typing import Any

import numpy as np

from swarmwright import Group, Side, Simulation


class Duel(Simulation):
    """Two agents pull at a rope for three steps; the seed adds a slip to each side.

    The episode fails if the right side pulls less than `tears`.
    """

    title = "duel"
    groups = {"left": Group(1, 1, 1), "right": Group(1, 1, 1)}  # noqa: RUF012
    metrics = {"left_pull": "Pull of the left side.", "right_pull": "Pull of the right side."}  # noqa: RUF012
    sides = {"left": Side(fitness="left_pull"), "right": Side(fitness="right_pull")}  # noqa: RUF012
    parameters = {"slip": 0.5, "tears": -9.0}  # noqa: RUF012

    def reset(self, parameters: dict[str, Any], seed: int) -> Any:
        self.pulls = np.random.default_rng(seed).uniform(-1, 1, 2) * parameters["slip"]
        self.tears, self.steps = parameters["tears"], 0
        return np.ones((2, 1))

    def step(self, actions: Any) -> Any:
        self.pulls += actions[:, 0]
        self.steps += 1
        return np.ones((2, 1))

    def done(self) -> bool:
        return self.steps == 3

    def fitness(self) -> float:
        if self.pulls[1] < self.tears:
            raise ValueError("the rope tore")
        return float(self.pulls[0] - self.pulls[1])

    def measure(self) -> dict[str, float]:
        return {"left_pull": self.pulls[0], "right_pull": self.pulls[1]}


class Wide(Duel):
    """The left side has more sensors."""

    title = "wide duel"
    groups = {"left": Group(1, 2, 1), "right": Group(1, 1, 1)}  # noqa: RUF012

    def reset(self, parameters: dict[str, Any], seed: int) -> Any:
        super().reset(parameters, seed)
        return [[1, 1], [1]]

    def step(self, actions: Any) -> Any:
        super().step(actions)
        return [[1, 1], [1]]


class Trio(Simulation):
    """Three agents pull for one step; each side gets what it pulls more than the two others together."""

    title = "trio"
    groups = {name: Group(1, 1, 1) for name in ("first", "second", "third")}  # noqa: RUF012
    metrics = {f"{name}_lead": f"Lead of the {name} side." for name in groups}  # noqa: RUF012
    sides = {name: Side(fitness=f"{name}_lead") for name in groups}  # noqa: RUF012

    def reset(self, parameters: dict[str, Any], seed: int) -> Any:  # noqa: ARG002 - as the library calls it
        self.pulls = np.random.default_rng(seed).uniform(-1, 1, 3)
        self.is_over = False
        return np.ones((3, 1))

    def step(self, actions: Any) -> Any:
        self.pulls += actions[:, 0]
        self.is_over = True
        return np.ones((3, 1))

    def done(self) -> bool:
        return self.is_over

    def fitness(self) -> float:
        return float(2 * self.pulls[0] - self.pulls.sum())

    def measure(self) -> dict[str, float]:
        leads = 2 * self.pulls - self.pulls.sum()
        return {f"{name}_lead": float(lead) for name, lead in zip(self.groups, leads, strict=True)}

"""Servers whose episodes do not follow from their parameters and their seed."""

import random
from typing import ClassVar

import numpy as np

from tests.conformance.broken.base import Broken
from tests.conformance.broken.batches import BrokenBatched
from tests.conformance.sound import Json, World


class Random(Broken):
    """Adds noise that does not depend on the seed."""

    breaks: ClassVar = {"S3.1"}

    def make(self, parameters: Json) -> World:
        world = super().make(parameters)
        world.places += np.float32(random.random())
        return world


class Leaks(Broken):
    """Moves the agents of an episode by the seed of the one before."""

    breaks: ClassVar = {"S3.2"}
    before = 0

    def make(self, parameters: Json) -> World:
        world = super().make(parameters)
        world.places += np.float32(self.before / 128)
        self.before = parameters.get("seed", 0)
        return world


class FitnessOfTheLast(Broken):
    """Sends the fitness of the episode before, as one that is computed too late."""

    breaks: ClassVar = {"S3.2"}
    last = 0.0

    def send_fitness(self, hash_: str | None, world: World) -> None:
        last, self.last = self.last, world.fitness()
        self.publish("fitness", simulation_hash=hash_, fitness=last, metrics=self.measure(world))


class SeedOf32Bits(Broken):
    """Truncates the seed."""

    breaks: ClassVar = {"S3.5"}

    def make(self, parameters: Json) -> World:
        return super().make({**parameters, "seed": parameters.get("seed", 0) & 0xFFFF_FFFF})


class SeedAsDouble(Broken):
    """Reads all numbers as JavaScript does."""

    breaks: ClassVar = {"S3.5"}

    def make(self, parameters: Json) -> World:
        return super().make({**parameters, "seed": int(float(parameters.get("seed", 0)))})


class StepwiseSeedAsDouble(BrokenBatched):
    """Reads the seeds of requests exactly, and that of parameters through a double."""

    breaks: ClassVar = {"S3.5"}
    rules: ClassVar = "S1.1,S2.3,S3,S9.1,S9.3,S9.20,S10.1,S10.7"

    def on_parameters(self, content: Json) -> None:
        seed = min(int(float(content.get("seed", 0))), 2**63 - 1)
        super().on_parameters({**content, "seed": seed})


class SignedSeed(Broken):
    """Takes no seed of more than 31 bits, as if it were a signed number of 32."""

    breaks: ClassVar = {"S3.5"}

    def on_parameters(self, content: Json) -> None:
        if content.get("seed", 0) < 2**31:
            super().on_parameters(content)


class FirstParameters(Broken):
    """Keeps the first parameters of a hash."""

    breaks: ClassVar = {"S3.3"}

    def on_parameters(self, content: Json) -> None:
        known = self.parameters.get(content["simulation_hash"])
        super().on_parameters(known or content)


class OneSetOfParameters(Broken):
    """Starts with the parameters that came last, of whichever tool."""

    breaks: ClassVar = {"S3.4"}

    def make(self, parameters: Json) -> World:  # noqa: ARG002
        return super().make(self.parameters[self.newest or ""])

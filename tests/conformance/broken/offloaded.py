"""Simulation servers that break rules of offloaded evaluation, and are else as they should be."""

import json
import random
from collections.abc import Sequence
from typing import Any, ClassVar

import msgpack
import numpy as np

from swarmwright import _engine
from swarmwright.conformance._controller_kinds import TRIALS
from swarmwright.controllers.kinds import KINDS
from tests.conformance.broken.base import OFFLOADED, Broken
from tests.conformance.sound import Json, Refused, SoundRobots, World
from tests.protocol.controllers import Controller

_COMPARED = [trial for trial in TRIALS if trial.kind != "modules"]  # whose sensors these servers lack
ARITHMETIC = {trial.rule for trial in _COMPARED}
ARITHMETIC_WITH_STATE = {trial.rule for trial in _COMPARED if not KINDS[trial.kind].stateless}


class RoundsOffloaded(Broken):
    """Gives other fitness offloaded than stepwise."""

    breaks: ClassVar = ARITHMETIC
    rules: ClassVar = OFFLOADED

    def compute(self, request: Json) -> tuple[list[float], dict[str, list[float]]]:
        fitness, metrics = super().compute(request)
        return [round(value, 6) for value in fitness], metrics


class OneControllerForAll(Broken):
    """Agents share a controller, and its state."""

    breaks: ClassVar = ARITHMETIC_WITH_STATE
    rules: ClassVar = OFFLOADED

    def rollout(self, specification: str, parameters: Json) -> World:
        world = self.make(parameters)
        controller = _engine.Controller(specification)
        while acting := world.acting():
            world.step({a: controller.step(np.array(world.sense(a), np.float32)).tolist() for a in acting})
        return world


class FlushesSubnormals(Broken):
    """Computes its controllers as fast as it can: numbers below the normal ones are 0."""

    breaks: ClassVar = {"S9.14"}
    rules: ClassVar = OFFLOADED

    def rollout(self, specification: str, parameters: Json) -> World:
        wanted = json.loads(specification)
        if wanted["kind"] != "layered":
            return super().rollout(specification, parameters)
        controller = Flushing(wanted)
        world = self.make(parameters)
        while acting := world.acting():
            seen = {agent: [np.float32(value) for value in world.sense(agent)] for agent in acting}
            with np.errstate(over="ignore", invalid="ignore"):
                world.step({agent: list(map(float, controller.step(row))) for agent, row in seen.items()})
        return world


class Flushing(Controller):
    """A layered network of another make than the engine's, without subnormals."""

    def _node(self, function: str, row: Sequence[np.float32], inputs: Sequence[np.float32]) -> np.float32:
        found = super()._node(function, row, inputs)
        return np.float32(0) if abs(found) < np.finfo(np.float32).smallest_normal else found


class LessSteep(Broken):
    """Takes EvoStick's output for the logistic function of the sum itself."""

    breaks: ClassVar = {"S9.15"}
    rules: ClassVar = OFFLOADED

    def rollout(self, specification: str, parameters: Json) -> World:
        wanted = json.loads(specification)
        if wanted["kind"] == "evostick":
            weights = np.array(wanted["weights"], np.float32) / np.float32(4.924273)
            wanted["weights"] = [float(str(weight)) for weight in weights]
        return super().rollout(json.dumps(wanted), parameters)


class LessSteepAndFirst(LessSteep, Broken):
    """The same, and rules that need any controller try EvoStick's."""

    controllers = ("evostick", "layered")


class IgnoresOutputActivation(Broken):
    """Does not know output_activation, as servers from before it was there, and says nothing."""

    breaks: ClassVar = {"S9.14"}
    rules: ClassVar = "S1.1,S2.3,S3.2,S9.1,S9.3,S9.11,S9.12,S9.14"

    def rollout(self, specification: str, parameters: Json) -> World:
        known = json.loads(specification)
        known.pop("output_activation", None)
        return super().rollout(json.dumps(known), parameters)


class NeverLearns(Broken):
    """Takes a network that learns for one whose weights stay as they are."""

    breaks: ClassVar = {"S9.18"}
    rules: ClassVar = OFFLOADED

    def rollout(self, specification: str, parameters: Json) -> World:
        wanted = json.loads(specification)
        if wanted["kind"] == "hebbian":
            wanted["weights"][0] = 0.0
        return super().rollout(json.dumps(wanted), parameters)


class EnablesAll(Broken):
    """Takes disabled connections of growing networks for enabled ones."""

    breaks: ClassVar = {"S9.21"}
    rules: ClassVar = OFFLOADED

    def rollout(self, specification: str, parameters: Json) -> World:
        wanted = json.loads(specification)
        if wanted["kind"] == "growing":
            connections = 3 * wanted["connections"]
            wanted["weights"][-connections + 2 :: 3] = [1.0] * wanted["connections"]
        return super().rollout(json.dumps(wanted), parameters)


class ForgetsNodes(Broken):
    """Begins every step of NEAT's networks with nodes that are 0."""

    breaks: ClassVar = {"S9.19"}
    rules: ClassVar = OFFLOADED

    def rollout(self, specification: str, parameters: Json) -> World:
        if json.loads(specification)["kind"] != "neat":
            return super().rollout(specification, parameters)
        world = self.make(parameters)
        controller = _engine.Controller(specification)
        while acting := world.acting():
            actuators = {}
            for agent in acting:
                controller.reset()
                actuators[agent] = controller.step(np.array(world.sense(agent), np.float32)).tolist()
            world.step(actuators)
        return world


class BrokenRobots(Broken, SoundRobots):
    """Computes machines and trees of modules in another way."""

    breaks: ClassVar = {"S9.16", "S9.17"}
    rules: ClassVar = "S1.1,S2.3,S3.2,S9.1,S9.3,S9.15,S9.16,S9.17"

    def rollout(self, specification: str, parameters: Json) -> World:
        world = self.make(parameters)
        kind = json.loads(specification)
        self.controllers_of: dict[int, _engine.Controller] = {}
        while acting := world.acting():
            done = {}
            for agent in acting:
                controller = self.controllers_of.setdefault(agent, _engine.Controller(specification))
                done[agent] = self.stepped(kind, controller, np.array(world.sense(agent), np.float32))
            world.step(done)
        return world

    def stepped(self, specification: Json, controller: _engine.Controller, seen: Any) -> list[float]:
        """Draw a random number instead of taking the one that is sensed."""
        if specification["kind"] == "modules":
            seen[8] = random.random()
        found: list[float] = controller.step(seen).tolist()
        return found


class RandomlyGoesOn(BrokenRobots):
    """Takes the same random number in every step of a machine."""

    breaks: ClassVar = {"S9.16"}

    def stepped(self, specification: Json, controller: _engine.Controller, seen: Any) -> list[float]:
        if specification["kind"] == "modules" and "form" not in specification:
            seen[8] = 0.5
        found: list[float] = controller.step(seen).tolist()
        return found


class ForgetsTheSubtree(BrokenRobots):
    """Begins a tree with the first subtree in every step."""

    breaks: ClassVar = {"S9.17"}

    def stepped(self, specification: Json, controller: _engine.Controller, seen: Any) -> list[float]:
        if specification.get("form") == "tree":
            controller.reset()
        found: list[float] = controller.step(seen).tolist()
        return found


class ColumnsFirst(Broken):
    """Writes episodes before candidates."""

    breaks: ClassVar = ARITHMETIC
    rules: ClassVar = OFFLOADED

    def compute(self, request: Json) -> tuple[list[float], dict[str, list[float]]]:
        fitness, metrics = super().compute(request)
        return np.array(fitness).reshape(-1, len(request["seeds"]) // 8).T.ravel().tolist(), metrics


class SpeaksAnywhere(Broken):
    """Answers on whatever topic a request names."""

    breaks: ClassVar = {"S9.12"}
    rules: ClassVar = OFFLOADED

    def requested(self, payload: bytes) -> None:
        try:
            request = msgpack.unpackb(payload)
        except Exception as error:
            raise Refused("junk") from error
        if isinstance(request, dict) and str(request.get("reply", "")).startswith("conformance/"):
            self.reply(request, error={"kind": "invalid", "reason": "reply"})
        super().requested(payload)


class IgnoresLeases(Broken):
    """Computes what nobody waits for."""

    breaks: ClassVar = {"S9.13"}
    rules: ClassVar = OFFLOADED

    def check(self, request: Json) -> None:
        super().check(request)
        request["lease"] = 0.0


class OffloadedSeeds(Broken):
    """Plays offloaded episodes with other seeds than the request has."""

    breaks: ClassVar = {"S9.20"}
    rules: ClassVar = OFFLOADED

    def rollout(self, specification: str, parameters: Json) -> World:
        return super().rollout(specification, {**parameters, "seed": self.seed(parameters["seed"])})

    def seed(self, seed: int) -> int:
        return seed & 0xFFFF_FFFF


class OffloadedSeedAsDouble(OffloadedSeeds, Broken):
    """Reads the seeds of a request through doubles."""

    breaks: ClassVar = {"S9.20"}

    def seed(self, seed: int) -> int:
        return int(float(seed))


class PrefersTheSeedOfParameters(Broken):
    """Takes the seed in parameters for that of all episodes."""

    breaks: ClassVar = {"S9.20"}
    rules: ClassVar = OFFLOADED

    def compute(self, request: Json) -> tuple[list[float], dict[str, list[float]]]:
        seed = request["parameters"].get("seed")
        if seed is not None:
            count = len(request["seeds"]) // 8
            request = {**request, "seeds": np.full(count, seed, "<u8").tobytes()}
        return super().compute(request)

"""A sound server whose simulation steers its agents itself, with batches; ones that break its rules."""

from typing import Any, ClassVar

import numpy as np

from tests.conformance.broken.base import Broken
from tests.conformance.broken.batches import Batched
from tests.conformance.sound import Invalid, Json, World

STEERED = "S1,S2,S3,S9,S10"
PARAMETERS = {"steps": 4, "gain": 0.3}


class Steered(Batched):
    """Sound: all agents move towards 0, by the parameter gain. Others break methods of one purpose."""

    controllers = ("layered", "parameter_set")

    def make(self, parameters: Json) -> World:
        world = super().make(parameters)
        gain = np.float32(parameters.get("gain", 0.5))
        while acting := world.acting():
            world.step({agent: [float(-gain * world.places[agent])] for agent in acting})
        return world

    def check(self, request: Json) -> None:
        controller = request["controller"]
        if controller["kind"] != "parameter_set":
            raise Invalid("controller.kind")
        size = len([parameter["type"] for parameter in controller["parameters"]])
        if len(np.frombuffer(request["genomes"], "<f4")) % size:
            raise Invalid("genomes")
        # The rest is checked as that of networks is.
        super().check(
            {**request, "controller": self.as_network(), "genomes": self.padded(request["genomes"])}
        )

    def as_network(self) -> Json:
        sizes = {"sensors": self.sensors, "actuators": self.actuators_of_an_agent}
        return {
            "version": 1,
            "kind": "layered",
            "hidden": [],
            "activation": "tanh",
            "output_range": [-1, 1],
            **sizes,
        }

    def padded(self, genomes: bytes) -> bytes:
        weights = self.sensors + 1
        return genomes + bytes(-len(genomes) // 4 % weights * 4)

    def compute(self, request: Json) -> tuple[list[float], dict[str, list[float]]]:
        parameters = request["controller"]["parameters"]
        rows = np.frombuffer(request["genomes"], "<f4").reshape(-1, len(parameters))
        worlds = [
            self.make({**request["parameters"], **self.values(parameters, row), "seed": int(seed)})
            for row in rows
            for seed in np.frombuffer(request["seeds"], "<u8")
        ]
        metrics = {name: [world.metrics()[name] for world in worlds] for name in request.get("metrics", [])}
        return [world.fitness() for world in worlds], metrics

    def values(self, parameters: list[Json], row: Any) -> Json:
        return {
            parameter["name"]: int(value) if parameter["type"] == "integer" else float(str(value))
            for parameter, value in zip(parameters, row, strict=True)
        }


class BrokenSteered(Broken, Steered):
    """What these have in common; breaks none itself."""

    rules: ClassVar = STEERED
    parameters_of_episodes: ClassVar = PARAMETERS


class OtherFitnessInBatches(BrokenSteered):
    """Gives another fitness in batches."""

    breaks: ClassVar = {"S10.1"}

    def ended(self, request: Json, episodes: list[int]) -> Json:
        return {**super().ended(request, episodes), "fitness": np.full(len(episodes), 7.0).tobytes()}


class AsksInBatches(BrokenSteered):
    """Asks an agent in a batch, and no agent stepwise."""

    breaks: ClassVar = {"S10.1"}

    def sensors_message(self, request: Json, **fields: Any) -> None:
        if "error" not in fields:
            fields |= {"episodes": bytes(4), "agents": bytes(4), "sensors": bytes(4 * self.sensors)}
        super().sensors_message(request, **fields)


class OtherMetricsInBatches(BrokenSteered):
    """Counts a step too many in batches."""

    breaks: ClassVar = {"S10.1"}

    def ended(self, request: Json, episodes: list[int]) -> Json:
        found = super().ended(request, episodes)
        more = {name: (np.frombuffer(values) + 1).tobytes() for name, values in found["metrics"].items()}
        return {**found, "metrics": more}


class OtherMetricsOffloaded(BrokenSteered):
    """Has the metrics of another episode when offloaded."""

    breaks: ClassVar = {"S9.7"}

    def compute(self, request: Json) -> tuple[list[float], dict[str, list[float]]]:
        fitness, metrics = super().compute(request)
        return fitness, {name: [value + 1 for value in values] for name, values in metrics.items()}


class FirstSeedForAll(BrokenSteered):
    """Evaluates all episodes with the first seed when offloaded."""

    breaks: ClassVar = {"S9.6"}

    def compute(self, request: Json) -> tuple[list[float], dict[str, list[float]]]:
        seeds = request["seeds"]
        return super().compute({**request, "seeds": seeds[:8] * (len(seeds) // 8)})


class IsNotHeldAfterBatches(BrokenSteered):
    """Is free at once after a batch that was over with its first message."""

    breaks: ClassVar = {"S10.5"}

    def sensors_message(self, request: Json, **fields: Any) -> None:
        if "error" not in fields:
            self.enter("free")
        super().sensors_message(request, **fields)

"""S9.14: networks compared with golden vectors, which an independent implementation has computed.

The kit cannot choose a server's sensors, so the networks contain their inputs: if all weights of the sensors
are 0, the first layer outputs functions of its biases, which are the same in every step.

- Points of tanh and sigmoid: the first layer computes f(x); the second subtracts the golden f(x) and
  multiplies by a power of two so large that one wrong bit gives -1 or 1; the third adds up the results. The
  network's outputs are 0 if all bits are right, otherwise -1 or 1. In a fully meshed network, three
  iterations take the place of these layers.
- Networks with activations that pass numbers on (linear, relu, clamp): the first layer outputs the sensors of
  a vector, and the rest is the vector's network, so agents act with the vector's actuators.

The expected fitness with such actuators is measured stepwise, without any controller.
"""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.json_text import Json
from swarmwright.conformance._extensions import ControllerSet, evaluation, free_again, numbers
from swarmwright.conformance._server_under_test import Always, Server, is_same_fitness
from swarmwright.conformance.rules import Skip
from swarmwright.conformance.server._rules import rule
from swarmwright.conformance.server.offloaded import request_fitness
from swarmwright.servers.broker.client import Failure

Floats = NDArray[np.float32]

FILE = Path(__file__).with_name("controllers.json")
"""protocol/vectors/controllers.json"""
GROUP = 16
"""Points per network; sums of this many powers of two are exact."""
SEED = 1
RANGES = {"tanh": [-1, 1], "sigmoid": [0, 1]}
"""Output range of networks with each function that has points."""
PASSES = {"linear": (-np.inf, np.inf), "relu": (0.0, np.inf), "clamp": (0.0, 1.0)}
"""Range of the numbers that each activation passes on unchanged."""


@cache
def vectors() -> Json:
    """Read the golden vectors."""
    content: Json = json.loads(FILE.read_text(encoding="utf-8"))
    return content


def binary32(bits: Sequence[str]) -> Floats:
    """Return the numbers with these bits, given in hexadecimal."""
    return np.array([int(bit, 16) for bit in bits], np.uint32).view(np.float32)


@dataclass(frozen=True)
class Points:
    """Golden points of a function: f(x) = y."""

    function: str
    x: Floats
    y: Floats

    def part(self, start: int, count: int = GROUP) -> "Points":
        """Return a range of the points."""
        return Points(self.function, self.x[start : start + count], self.y[start : start + count])

    def __str__(self) -> str:
        """Describe the first point."""
        x, y = self.x[0], self.y[0]
        bits = self.y[:1].view(np.uint32)[0]
        return f"{self.function}({float(x).hex()}) = {float(y).hex()} (bits {bits:08x})"


def _hexadecimal(value: np.float32) -> str:
    """Write a number like the vectors, without redundant zeros."""
    head, _, exponent = float(value).hex().partition("p")
    return f"{head.rstrip('0').rstrip('.') if '.' in head else head}p{exponent}"


def points(function: str) -> Points:
    """Return all golden points of a function."""
    rows = vectors()["functions"][function]
    return Points(function, binary32([row[1] for row in rows]), binary32([row[3] for row in rows]))


def constants(values: Floats, sensors: int) -> Floats:
    """Return a first layer, (nodes, 1 + sensors), that outputs these numbers whatever the sensors are."""
    return np.column_stack([values, np.zeros((len(values), sensors), np.float32)])


Layers = tuple[Floats, Floats, Floats]
"""Bias and weights of each node, (nodes, 1 + nodes below), layer by layer."""


def detector(points: Points, sign: float, sensors: int, actuators: int) -> Layers:
    """Return a network whose actuators are 0, or alternately `sign` and -`sign` for a wrong bit."""
    count = len(points.x)
    # The scale turns a wrong last bit into 32, or the largest value that binary32 allows.
    exponents = np.minimum(5 - np.frexp(np.spacing(np.abs(points.y)))[1], 120)
    scales = np.ldexp(np.float32(1), exponents).astype(np.float32)
    second = np.column_stack([-scales * points.y, np.diag(scales)])
    powers = np.ldexp(np.float32(1), 60 + np.arange(count)).astype(np.float32)
    middle = 0.5 if points.function == "sigmoid" else 0.0
    third = np.concatenate([[0.0 - middle * powers.sum(dtype=np.float64)], powers])
    outputs = np.outer(alternating(sign, actuators), third).astype(np.float32)
    return constants(points.x, sensors), second.astype(np.float32), outputs


def make_layered(layers: Layers) -> Floats:
    """Return the weights of a layered network."""
    return np.concatenate([layer.ravel() for layer in layers])


def make_meshed(layers: Layers) -> Floats:
    """Return the weights of a fully meshed network whose iterations are the layers."""
    first, second, third = layers
    sensors, count, actuators = first.shape[1] - 1, len(first), len(third)
    nodes = np.zeros((2 * count + actuators, 1 + sensors + 2 * count + actuators), np.float32)
    nodes[:, 0] = np.concatenate([layer[:, 0] for layer in layers])
    bias = 1 + sensors
    nodes[count : 2 * count, bias : bias + count] = second[:, 1:]
    nodes[2 * count :, bias + count : bias + 2 * count] = third[:, 1:]
    return nodes.ravel()


def alternating(sign: float, actuators: int) -> Floats:
    """Return alternating signs, since equal actuators have no effect if the largest decides."""
    signs: Floats = np.where(np.arange(actuators) % 2, -sign, sign).astype(np.float32)
    return signs


def architecture(server: Server, like: Json, **changes: object) -> Json:
    """Return a specification without weights for the server's agents."""
    fields = {key: value for key, value in like.items() if key != "weights"}
    return {**fields, "sensors": server.sensors, "actuators": server.actuators, **changes}


def fitness(server: Server, form: Json, rows: Sequence[Floats]) -> list[float]:
    """Return the offloaded fitness of each row of weights."""
    controllers = ControllerSet(form, np.array(rows, np.float32))
    answer = request_fitness(server, evaluation(server, controllers, [SEED]))
    return [float(value) for value in numbers(answer, "fitness", "<f8")]


def steer_away(server: Server, values: Floats) -> float | None:
    """Return the stepwise fitness if all agents always have these actuators."""
    parameters = {**server.settings.parameters, "seed": SEED}
    return server.play(Always(tuple(float(str(value)) for value in values)), parameters).fitness


def wrong_points(server: Server, kind: str, function: str, expected: float | None) -> Points | None:
    """Return the first point that the server computes differently, or the points among which it is."""
    every = points(function)

    def wrong(parts: Sequence[Points]) -> Points | None:
        count = len(parts[0].x)
        size: Json = (
            {"hidden": [count, count]} if kind == "layered" else {"hidden": 2 * count, "iterations": 3}
        )
        like = {"version": 1, "kind": kind, "activation": function, "output_range": RANGES[function]}
        weights = make_layered if kind == "layered" else make_meshed
        tries = [(part, sign) for part in parts for sign in (1.0, -1.0)]
        rows = [weights(detector(part, sign, server.sensors, server.actuators)) for part, sign in tries]
        results = zip(tries, fitness(server, architecture(server, like, **size), rows), strict=True)
        return next((part for (part, _), value in results if not is_same_fitness(value, expected)), None)

    group = wrong([every.part(start) for start in range(0, len(every.x), GROUP)])
    if group is None:
        return None
    return wrong([group.part(index, 1) for index in range(len(group.x))]) or group


@dataclass(frozen=True)
class Case:
    """A golden network whose sensors a first layer can output. steps: sensors and actuators of each."""

    name: str
    specification: Json
    steps: list[tuple[Floats, Floats]]

    def rows(self, server: Server) -> list[Floats]:
        """Return the weights of the network with that layer, for each step."""
        weights = np.array(self.specification["weights"], np.float32)
        width = 1 + [self.specification["sensors"], *self.specification["hidden"]][-1]
        last = weights[-self.specification["actuators"] * width :].reshape(-1, width)
        rest = [weights[: -last.size], last[np.arange(server.actuators) % len(last)].ravel()]
        return [
            np.concatenate([constants(sensors, server.sensors).ravel(), *rest]) for sensors, _ in self.steps
        ]

    def actuators(self, step: int, count: int) -> Floats:
        """Return the golden actuators of a step, repeated or cut to `count`."""
        golden = self.steps[step][1]
        return golden[np.arange(count) % len(golden)]


def cases() -> Iterator[Case]:
    """Yield networks that can be tested with any sensors."""
    for controller in vectors()["controllers"]:
        specification = controller["specification"]
        low, high = PASSES.get(specification.get("activation"), (1.0, 0.0))
        steps = [(binary32(s["sensor_bits"]), binary32(s["actuator_bits"])) for s in controller["steps"]]
        fit = [step for step in steps if (step[0] >= low).all() and (step[0] <= high).all()]
        if specification["kind"] == "layered" and fit:
            yield Case(controller["name"], specification, fit)


@rule(
    "S9.14",
    "Networks match the golden vectors, to the last bit.",
    where="decision 002; protocol/vectors/controllers.json",
    fix="replay the vector of this name: keep subnormal numbers, do not reorder sums or fuse "
    "operations, use the formulas of output_range [-1, 1] and [0, 1], turn NaN into 0; compute "
    "output_activation, or answer invalid with its name",
    needs=["S9.3"],
    seconds=60,
)
def golden(server: Server) -> str:
    """Test points of tanh and sigmoid, then whole networks."""
    server.announces(mode="offloaded")
    kinds = [kind for kind in ("layered", "fully_meshed") if kind in server.announced.get("controllers", [])]
    if not kinds:
        raise Skip("not announced: capabilities.swarmwright.controllers has no networks")
    server.comparable()
    _ = server.reference
    still, ahead, back = (
        steer_away(server, alternating(sign, server.actuators)) for sign in (0.0, 1.0, -1.0)
    )
    if is_same_fitness(still, ahead) and is_same_fitness(still, back):
        raise Skip("actuators change no fitness here; give --parameters with longer episodes")
    for kind in kinds:
        for function in RANGES:
            wrong = wrong_points(server, kind, function, still)
            if wrong is not None:
                sent = f"evaluate with a {kind} network, whose actuators are 0 if its {function} is right"
                raise Failure("a controller on the server computes something else", str(wrong), sent)
    steps = whole_networks(server) if "layered" in kinds else 0
    tried = sum(len(points(function).x) for function in RANGES)
    return f"{tried} points in {' and '.join(kinds)} networks, {steps} steps of layered ones"


def _find_ignored(server: Server, form: Json, case: Case, fitness_values: Sequence[float]) -> str:
    """Describe that the server ignores output_activation; empty if it does not."""
    without = {key: value for key, value in form.items() if key != "output_activation"}
    values = fitness(server, without, case.rows(server))
    free_again(server)
    same_values = len(values) == len(fitness_values) and all(map(is_same_fitness, values, fitness_values))
    return ": the fitness without output_activation, which the server ignores" if same_values else ""


def whole_networks(server: Server) -> int:
    """Test golden networks that fit the server; return the number of steps. Raises Failure."""
    tried = 0
    cache: dict[bytes, float | None] = {}
    for case in cases():
        hidden = [case.specification["sensors"], *case.specification["hidden"]]
        form = architecture(server, case.specification, hidden=hidden)
        try:
            fitness_values = fitness(server, form, case.rows(server))
        except Failure as failure:
            # The field is optional, so a server may answer that it does not know it.
            if "output_activation" in form and "output_activation" in failure.came:
                continue
            raise
        finally:
            free_again(server)
        for step, value in enumerate(fitness_values):
            actuators = case.actuators(step, server.actuators)
            key = actuators.tobytes()
            if key not in cache:
                cache[key] = steer_away(server, actuators)
            if not is_same_fitness(value, cache[key]):
                came = f"{value!r} offloaded, {cache[key]!r} when agents are steered by {actuators.tolist()}"
                expected = f"the same bits: the vector {case.name!r}, sensors {case.steps[step][0].tolist()}"
                if "output_activation" in form:
                    came += _find_ignored(server, form, case, fitness_values)
                    expected += (
                        "; or the error invalid that names output_activation, where the server does not know "
                        "this key"
                    )
                raise Failure(
                    came,
                    expected,
                    f"evaluate with a controller {form}",
                )
            tried += 1
    return tried

"""Controllers in Python, from decision 002 alone: it shares nothing with the engine.

Every operation is one of NumPy's on binary32, or on binary64 where the decision says so, in the order that it
gives. `max(a, b)` is `a < b ? b : a`, which lets a NaN pass.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from tests.protocol.machines import Machine, Tree

Single = np.float32
Double = np.float64
Json = dict[str, Any]

_TANH_P = [Single(c) for c in ("0.5", "0.015736774", "7.970824e-5", "4.2581547e-8")]
_TANH_Q = [Single(c) for c in ("1", "0.11480684", "0.0013933508", "2.7218455e-6")]
_SIN = [Single(c) for c in ("3.1415927", "-5.167707", "2.5500288", "-0.59804523", "0.077220164")]
_LIMIT = Single("9.15")
_STEEPNESS = Single("4.924273")
ZERO, HALF, ONE, TWO = (Single(c) for c in ("0", "0.5", "1", "2"))


def _within(x: Single, low: Single, high: Single) -> Single:
    x = min(x, high)
    return max(x, low)


def _polynomial(coefficients: Sequence[Single], z: Single) -> Single:
    p = coefficients[-1]
    for coefficient in coefficients[-2::-1]:
        p = p * z + coefficient
    return p


def tanh(x: Single) -> Single:
    y = _within(x, -_LIMIT, _LIMIT)
    z = y * y
    t = (y * _polynomial(_TANH_P, z)) / _polynomial(_TANH_Q, z)
    return _within((t + t) / (ONE + t * t), -ONE, ONE)


def sigmoid(x: Single) -> Single:
    return HALF + HALF * tanh(HALF * x)


def _sin_pi_half(r: Single) -> Single:
    return _within(r * _polynomial(_SIN, r * r), -ONE, ONE)


def sin_pi(a: Single) -> Single:
    r = ONE - a if a > HALF else a
    return _sin_pi_half(-ONE - r if r < -HALF else r)


def cos_pi(a: Single) -> Single:
    return _sin_pi_half(HALF - (-a if a < ZERO else a))


FUNCTIONS: dict[str, Callable[[Single], Single]] = {
    "tanh": tanh,
    "sigmoid": sigmoid,
    "sin_pi": sin_pi,
    "cos_pi": cos_pi,
}


_EXP_P = (
    1.66666666666666019037e-01, -2.77777777770155933842e-03, 6.61375632143793436117e-05,
    -1.65339022054652515390e-06, 4.13813679705723846039e-08,
)  # fmt: skip


def _fdlibm_exp(x: float) -> float:
    k = math.trunc(1.44269504088896338700 * x + math.copysign(0.5, x))
    hi, lo = x - k * 6.93147180369123816490e-01, k * 1.90821492927058770002e-10
    r = hi - lo
    t = r * r
    p = _EXP_P[4]
    for coefficient in _EXP_P[3::-1]:
        p = coefficient + t * p
    c = r - t * p
    return math.ldexp(1.0 - ((lo - (r * c) / (2.0 - c)) - hi), k)


def exp(x: float) -> float:
    """As FREVO's NEAT computes it, in binary64."""
    if x > 7.09782712893383973096e02:
        return math.inf
    if x < -7.45133219101941108420e02:
        return 0.0
    if math.isnan(x):
        return x
    whole, steps = math.trunc(x), math.trunc(x * 1024.0)
    i = steps - 1024 * whole
    d = (x - whole) - i * (1.0 / 1024.0)
    f = _fdlibm_exp(i / 1024.0) * (1.0 + d * (1.0 + d * (0.5 + d * (1.0 / 6.0 + d * (1.0 / 24.0)))))
    if whole < -705:
        return (_fdlibm_exp(54 * 0.6931471805599453 + whole) * f) * 2.0**-54
    return _fdlibm_exp(float(whole)) * f


def _neat_node(slope: float | None, total: float) -> float:
    if slope is not None:
        return 1.0 / (1.0 + exp(-slope * total))
    if total < -20.0 or total > 20.0:
        return math.copysign(1.0, total)
    e = exp(-2.0 * total)
    return (1.0 - e) / (1.0 + e)


def _relu(a: Single) -> Single:
    return max(a, ZERO)


def _clamp(a: Single) -> Single:
    b = max(a, ZERO)
    return min(b, ONE)


ACTIVATIONS: dict[str, Callable[[Single], Single]] = {
    "tanh": tanh,
    "sigmoid": sigmoid,
    "relu": _relu,
    "clamp": _clamp,
    "linear": lambda a: a,
}


GROWING = ("steep_sigmoid", "tanh", "sigmoid", "relu", "clamp", "linear")
GROWING_ACTIVATIONS: dict[str, Callable[[Single], Single]] = {
    **ACTIVATIONS,
    "steep_sigmoid": lambda a: sigmoid(_STEEPNESS * a),
}


def _limited(number: Single, highest: int) -> int:
    return int(min(max(float(number), 0.0), highest))


class Controller:
    """A specification at work, for one agent."""

    def __init__(self, specification: Json) -> None:
        self.specification = specification
        self.weights = [Single(weight) for weight in specification["weights"]]
        self.reset()

    def reset(self) -> None:
        self.state = 0
        self.machine: Machine | Tree | None = None
        recurrent = self.specification["kind"] in {"fully_meshed", "hebbian"}
        parts = ("sensors", "hidden", "actuators") if recurrent else ()
        self.learnt: list[list[Single]] = []
        self.doubles = [0.0] * len(self.specification.get("sources", ()))
        self.outputs = [ZERO] * sum(self.specification[part] for part in parts)
        if self.specification["kind"] == "growing":
            self.outputs = [ZERO] * (self.specification["actuators"] + self.specification["nodes"])

    def step(self, sensors: Sequence[Single]) -> list[Single]:
        """The actuators for what is sensed."""
        kinds = {
            "layered": self._layered,
            "fully_meshed": self._fully_meshed,
            "mealy_fsm": self._mealy_fsm,
            "evostick": self._evostick,
            "hebbian": self._hebbian,
            "neat": self._neat,
            "growing": self._growing,
            "modules": self._modules,
        }
        return kinds[self.specification["kind"]](list(sensors))

    def _node(self, function: str, row: Sequence[Single], inputs: Sequence[Single]) -> Single:
        return ACTIVATIONS[function](row[0] + self._total(row[1:], inputs))

    def _total(self, weights: Sequence[Single], inputs: Sequence[Single]) -> Single:
        total = ZERO
        for weight, value in zip(weights, inputs, strict=True):
            total = total + weight * value
        return total

    def _layered(self, values: list[Single]) -> list[Single]:
        rest = self.weights
        everywhere = self.specification["activation"]
        layers = [(nodes, everywhere) for nodes in self.specification["hidden"]]
        layers.append(
            (self.specification["actuators"], self.specification.get("output_activation", everywhere))
        )
        for nodes, function in layers:
            length = len(values) + 1
            rows, rest = rest[: nodes * length], rest[nodes * length :]
            rows_of_nodes = [rows[at : at + length] for at in range(0, len(rows), length)]
            values = [self._node(function, row, values) for row in rows_of_nodes]
        assert not rest
        return [self._actuator(value) for value in values]

    def _fully_meshed(self, sensors: list[Single]) -> list[Single]:
        length = len(self.outputs) + 1
        rows = [self.weights[at : at + length] for at in range(0, len(self.weights), length)]
        self.outputs[: len(sensors)] = sensors
        function = self.specification["activation"]
        for _ in range(self.specification["iterations"]):
            self.outputs = sensors + [self._node(function, row, self.outputs) for row in rows]
        return [self._actuator(value) for value in self.outputs[-self.specification["actuators"] :]]

    def _hebbian(self, sensors: list[Single]) -> list[Single]:
        rate, *genes = self.weights
        length, first = len(self.outputs) + 1, len(sensors)
        biases = genes[::length]
        if not self.learnt:
            self.learnt = [genes[at + 1 : at + length] for at in range(0, len(genes), length)]
        self.outputs[:first] = sensors
        for _ in range(self.specification["iterations"]):
            rows = zip(biases, self.learnt, strict=True)
            self.outputs = sensors + [_clamp(bias + self._total(row, self.outputs)) for bias, row in rows]
        halves = [Double(rate) * (Double(output) - Double(0.5)) for output in self.outputs[first:]]
        deltas = [[Single(half * (Double(o) - Double(0.5))) for o in self.outputs] for half in halves]
        links = [(i, j) for i in range(len(deltas)) for j in range(len(self.outputs)) if j != first + i]
        total = ZERO
        for i, j in links:
            total = total + deltas[i][j]
        mean = total / Single(len(links))
        for i, j in links:
            self.learnt[i][j] = self.learnt[i][j] + (deltas[i][j] - mean)
        return [self._stretched(o, [0, 1]) for o in self.outputs[-self.specification["actuators"] :]]

    def _neat(self, sensors: list[Single]) -> list[Single]:
        first, sources = len(sensors), self.specification["sources"]
        hidden = len(sources) - self.specification["actuators"]
        for _ in range(self.specification["iterations"]):
            rest = [float(weight) for weight in self.weights]
            for node, row in enumerate(sources):
                bias, *weights = rest[: 1 + len(row)]
                del rest[: 1 + len(row)]
                total = 0.0
                for source, weight in zip(row, weights, strict=True):
                    value = float(sensors[source]) if source < first else self.doubles[source - first]
                    total = total + value * weight
                slope = rest.pop(0) if node >= hidden else None
                self.doubles[node] = _neat_node(slope, total + bias)
            assert not rest
        return [self._stretched(Single(output), [0, 1]) for output in self.doubles[hidden:]]

    def _growing(self, sensors: list[Single]) -> list[Single]:
        specification, rest = self.specification, list(self.weights)
        actuators, recurrent = specification["actuators"], specification["recurrent"]
        hidden = _limited(rest.pop(0), specification["nodes"])
        inputs, rest = rest[:actuators], rest[actuators:]
        genes, rest = rest[: 3 * specification["nodes"]], rest[3 * specification["nodes"] :]
        before = list(self.outputs) if recurrent else [ZERO] * (actuators + hidden)
        after = list(before)
        order = [(actuators + node, genes[3 * node + 2], genes[3 * node + 1]) for node in range(hidden)]
        for node, count, number in [*order, *((node, inputs[node], None) for node in range(actuators))]:
            own = 3 * _limited(count, len(rest) // 3)
            total = ZERO
            values = [*sensors, ONE, *(before if recurrent else after)]
            for at in range(0, own, 3):
                if _limited(rest[at + 2], 1):
                    source = _limited(rest[at], len(sensors) + actuators + hidden)
                    total = total + rest[at + 1] * values[source]
            rest = rest[own:]
            name = specification["output_activation"] if number is None else GROWING[_limited(number, 5)]
            after[node] = GROWING_ACTIVATIONS[name](total)
        self.outputs = after
        return [self._actuator(output) for output in after[:actuators]]

    def _actuator(self, o: Single) -> Single:
        return self._stretched(o, self.specification["output_range"])

    def _stretched(self, o: Single, bounds: list[float]) -> Single:
        low, high = (Single(bound) for bound in bounds)
        if bounds == [-1, 1]:
            a = o
        elif bounds == [0, 1]:
            a = TWO * o - ONE
        else:
            a = ((o - low) / (high - low)) * TWO - ONE
        return ZERO if np.isnan(a) else _within(a, -ONE, ONE)

    def _evostick(self, sensors: list[Single]) -> list[Single]:
        actuators = []
        for output in range(self.specification["actuators"]):
            *row, bias = self.weights[output :: self.specification["actuators"]]
            total = ZERO
            for weight, value in zip(row, sensors, strict=True):
                total = total + weight * value
            a = TWO * sigmoid(_STEEPNESS * (total + bias)) - ONE
            actuators.append(ZERO if np.isnan(a) else _within(a, -ONE, ONE))
        return actuators

    def _modules(self, sensors: list[Single]) -> list[Single]:
        if self.machine is None:
            sizes = (self.specification["states"], self.specification["transitions"])
            if self.specification.get("form") == "tree":
                self.machine = Tree(self.weights, sizes[0], sigmoid)
            else:
                self.machine = Machine(self.weights, *sizes, sigmoid)
        return self.machine.step(sensors)

    def _mealy_fsm(self, sensors: list[Single]) -> list[Single]:
        row = self.state
        for sensor, thresholds in zip(sensors, self.specification["thresholds"], strict=True):
            row = row * (len(thresholds) + 1) + sum(bool(Single(t) < sensor) for t in thresholds)
        width = 1 + self.specification["actuators"]
        following, *outputs = self.weights[row * width :][:width]
        last = Single(self.specification["states"] - 1)
        following = max(following, ZERO)
        self.state = int(min(following, last))
        return [_within(output, -ONE, ONE) for output in outputs]


def merged(parameters: Json, specification: Json) -> Json:
    """The parameters of an episode: the experiment's, and the values of a parameter set, which count more."""
    result = dict(parameters)
    for parameter, number in zip(specification["parameters"], specification["weights"], strict=True):
        weight = Single(number)
        if parameter["type"] == "real":
            value: Any = float(str(weight))
        else:
            value = int(np.floor(weight))
        if parameter["type"] == "categorical":
            value = parameter["choices"][max(0, min(value, len(parameter["choices"]) - 1))]
        result[parameter["name"]] = value
    return result

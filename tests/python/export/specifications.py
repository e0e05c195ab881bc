"""Controllers of every kind, at random, for the tests of exported ones."""

import itertools
from functools import cache
from typing import Any

import numpy as np
from hypothesis import strategies as st

from swarmwright import _engine
from swarmwright.common.random_numbers import Stream
from swarmwright.controllers.kinds.growing.genes import ACTIVATIONS as NEAT_ACTIVATIONS
from swarmwright.controllers.kinds.neat import GrowingNeat, NeatOptions
from swarmwright.controllers.source.text import plain
from swarmwright.export import Subject
from swarmwright.export.sequences import Sequences, draw_random_sequences

ACTIVATIONS = {
    "layered": ("tanh", "sigmoid", "relu", "clamp", "linear"),
    "fully_meshed": ("clamp", "sigmoid", "tanh", "relu"),
}
RANGES = ([-1.0, 1.0], [0.0, 1.0], [-0.3, 2.7])

Specification = dict[str, Any]


def network(
    kind: str, activation: str, output_range: list[float], seed: int = 0, **sizes: Any
) -> Specification:
    """A network whose weights are such that its actuators are seldom at their limits."""
    hidden = [5, 3] if kind == "layered" else 3
    made = {
        "version": 1, "kind": kind, "sensors": 3, "actuators": 2, "hidden": hidden, "activation": activation,
        "output_range": output_range, **({} if kind == "layered" else {"iterations": 2}), **sizes,
    }  # fmt: skip
    weights = np.random.default_rng(seed).uniform(-0.9, 0.9, _engine.genome_size(made)).astype(np.float32)
    return {**made, "weights": [float(text) for text in weights.astype(str)]}


def evostick(sensors: int, actuators: int, reach: float = 1.0) -> Specification:
    """EvoStick's network."""
    made = {"version": 1, "kind": "evostick", "sensors": sensors, "actuators": actuators}
    count = _engine.genome_size(made)
    weights = np.random.default_rng(2).uniform(-reach, reach, count).astype(np.float32)
    return {**made, "weights": [float(text) for text in weights.astype(str)]}


def hebbian(hidden: int, iterations: int, rate: float, seed: int = 0) -> Specification:
    """A network that learns, in a few steps with a high rate."""
    made = {
        "version": 1, "kind": "hebbian", "sensors": 3, "actuators": 2,
        "hidden": hidden, "iterations": iterations,
    }  # fmt: skip
    weights = np.random.default_rng(seed).uniform(-0.6, 0.7, _engine.genome_size(made)).astype(np.float32)
    weights[0] = rate
    return {**made, "weights": [float(text) for text in weights.astype(str)]}


def neat(sources: list[list[int]], reach: float, iterations: int = 3, seed: int = 0) -> Specification:
    """A network with these connections."""
    made = {
        "version": 1, "kind": "neat", "sensors": 3, "actuators": 2,
        "sources": sources, "iterations": iterations,
    }  # fmt: skip
    weights = np.random.default_rng(seed).uniform(-reach, reach, _engine.genome_size(made)).astype(np.float32)
    return {**made, "weights": [float(text) for text in weights.astype(str)]}


def without(specification: Specification, *weights: int) -> Specification:
    """The network with weights of 0, whose connections exports leave out."""
    weights_left = [weight * (index not in weights) for index, weight in enumerate(specification["weights"])]
    return {**specification, "weights": weights_left}


def growing(mutations: int, seed: int = 0, **options: Any) -> Specification:
    """A network that has grown by mutations."""
    values = {"max_nodes": 6, "add_node": 0.4, "add_connection": 0.5, "toggle": 0.1, **options}
    subject = GrowingNeat(NeatOptions.model_validate(values), sensors=3, actuators=2)
    genome = subject.initial(Stream(seed, "initial"))
    for generation in range(mutations):
        stream = Stream(seed, "mutate", generation)
        genome = subject.mutate(genome, stream, severity=1.0, probability=0.5)
    return subject.specification(genome)


def machine(thresholds: list[list[float]], states: int = 3, actuators: int = 2) -> Specification:
    """A state machine with next states and outputs beyond their limits, too."""
    made = {
        "version": 1, "kind": "mealy_fsm", "sensors": len(thresholds), "actuators": actuators,
        "states": states, "thresholds": thresholds,
    }  # fmt: skip
    rows = _engine.genome_size(made) // (1 + actuators)
    numbers = np.random.default_rng(1)
    table = numbers.uniform(-1.3, 1.3, (rows, 1 + actuators)).astype(np.float32)
    table[:, 0] = numbers.uniform(-1, states + 1, rows)
    return {**made, "weights": [float(text) for text in table.reshape(-1).astype(str)]}


def modules(states: int, transitions: int, seed: int) -> Specification:
    """A machine of modules; some of its weights are beyond their limits."""
    made = {
        "version": 1, "kind": "modules", "sensors": 9, "actuators": 2,
        "states": states, "transitions": transitions,
    }  # fmt: skip
    numbers = np.random.default_rng(seed)
    weights = [float(states)]
    for _ in range(states):
        weights += [*numbers.uniform([-0.5, 0, 0, 1], [6.5, 12, 6, 5])]
        for _ in range(transitions):
            weights += [*numbers.uniform([0, -0.5, 0, 0, 0], [states, 6.5, 1, 11, 2])]
    return {**made, "weights": [float(text) for text in np.array(weights, np.float32).astype(str)]}


def tree(subtrees: int, seed: int) -> Specification:
    """A behaviour tree of modules; some of its weights are beyond their limits."""
    return {**modules(subtrees, 1, seed), "form": "tree"}


ALL = {
    **{
        f"{kind}-{activation}-{index}": network(kind, activation, output_range, seed=index)
        for kind, activations in ACTIVATIONS.items()
        for index, (activation, output_range) in enumerate(itertools.product(activations, RANGES))
    },
    "evostick": evostick(24, 2),
    "evostick-small": evostick(3, 1, 0.4),
    "layered-direct": network("layered", "tanh", [-1.0, 1.0], hidden=[]),
    "layered-deep": network("layered", "sigmoid", [0.0, 1.0], hidden=[2, 7, 1, 4]),
    "layered-policy": network("layered", "tanh", [-1.0, 1.0], output_activation="linear"),
    "layered-squashed": network("layered", "relu", [-1.0, 1.0], output_activation="tanh"),
    "layered-clamped": network("layered", "linear", [0.0, 1.0], output_activation="clamp", hidden=[4]),
    "layered-linear": network("layered", "tanh", [-0.3, 2.7], output_activation="linear", hidden=[]),
    "layered-wide": network("layered", "tanh", [-1.0, 1.0], sensors=40, actuators=9, hidden=[30]),
    "fully_meshed-bare": network("fully_meshed", "tanh", [-1.0, 1.0], hidden=0, iterations=3),
    "hebbian": hebbian(3, 2, 0.1),
    "hebbian-bare": hebbian(0, 1, 0.3, seed=1),
    "hebbian-slow": hebbian(2, 3, 1e-7, seed=2),
    "neat": neat([[0, 4, 7], [1, 3, 5], [5, 5, 2, 6, 3], [3, 4, 5, 0], [6, 5, 2, 7]], 3.0),
    "neat-bare": neat([[0, 1, 2], [3, 4, 2]], 2.0, iterations=1, seed=1),
    "neat-sparse": without(neat([[0, 1], [2, 3], [3, 4, 0], [1, 2]], 2.0, seed=4), 1, 8),
    "neat-deaf": neat([[], []], 2.0, seed=2),
    "neat-steep": neat([[0, 4], [2, 3, 1], [3, 5, 0], [0, 1, 2]], 60.0, seed=3),
    "growing": growing(30),
    "growing-recurrent": growing(30, seed=1, recurrent=True, activations=list(NEAT_ACTIVATIONS)),
    "growing-bare": growing(0, seed=2, max_nodes=0, output_activation="tanh"),
    "growing-all": growing(60, seed=3, activations=list(NEAT_ACTIVATIONS), output_activation="linear"),
    "growing-any": {
        **growing(0, seed=4),
        "weights": [float(number) for number in np.random.default_rng(4).integers(-1, 9, 117)],
    },
    "modules": modules(4, 4, 1),
    "modules-other": modules(4, 4, 2),
    "modules-two": modules(2, 1, 3),
    "modules-one": modules(1, 1, 4),
    "modules-tree": tree(4, 5),
    "modules-tree-two": tree(2, 6),
    "modules-tree-one": tree(1, 7),
    "mealy_fsm": machine([[-0.5, 0.25], [], [0.1]]),
    "mealy_fsm-blind": machine([[], []], states=5, actuators=1),
    "mealy_fsm-one": machine([[0.0]], states=1),
    "mealy_fsm-many": machine([[float(one) for one in range(9)]], states=300, actuators=3),
}
"""Name -> specification: every kind, activation and kind of output range."""

_weights = st.floats(width=32, allow_nan=False, allow_infinity=False)


@st.composite
def networks(draw: st.DrawFn) -> Specification:
    """Networks of any shape, with any finite weights."""
    kind = draw(st.sampled_from(sorted(ACTIVATIONS)))
    made: Specification = {
        "version": 1, "kind": kind, "sensors": draw(st.integers(1, 5)), "actuators": draw(st.integers(1, 3)),
        "hidden": draw(st.lists(st.integers(1, 4), max_size=3) if kind == "layered" else st.integers(0, 4)),
        "activation": draw(st.sampled_from(ACTIVATIONS[kind])), "output_range": draw(st.sampled_from(RANGES)),
    }  # fmt: skip
    if kind == "fully_meshed":
        made["iterations"] = draw(st.integers(1, 3))
    elif draw(st.booleans()):
        made["output_activation"] = draw(st.sampled_from(ACTIVATIONS[kind]))
    count = _engine.genome_size(made)
    return {**made, "weights": draw(st.lists(_weights, min_size=count, max_size=count))}


NASTY = [
    'a "quoted" */ name',
    "line\nbreak \\",
    "100 % of 5 \N{DEGREE SIGN} /* ??/ \u202e",
    "",
    "goal x",
    "goal x",
]
"""Names that would leave a comment or a string."""


def nasty() -> Subject:
    """A controller whose sensors and actuators have such names, and so has its run."""
    specification = network("layered", "relu", [-1.0, 1.0], sensors=6, actuators=6)
    described = {f"{what}_{part}": NASTY for what in ("sensor", "actuator") for part in ("names", "units")}
    return Subject(specification, (("Run", plain(NASTY[0] + NASTY[1])),), described)


def subject(specification: Specification, episodes: Sequences | None = None) -> Subject:
    """What would be exported of a run."""
    return Subject(
        specification, (("Run", "test"),), episodes=episodes, episode_count=int(episodes is not None)
    )


@cache
def sequences_of(name: str, count: int = 100) -> Sequences:
    """Random sequences of one of `ALL`."""
    return few(ALL[name], count)


def few(specification: Specification, count: int = 100) -> Sequences:
    """Random sequences of a controller."""
    return draw_random_sequences(specification, count)

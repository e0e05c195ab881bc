"""The kinds of controller that the kit tries, each with the rule on its arithmetic."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Trial:
    """Controllers of one kind, and the rule that they have their stepwise fitness.

    Attributes:
        kind: in specifications.
        rule: id of the rule.
        title: the controllers, in the rule's text.
        advice: first part of how to fix violations.
        options: of the representation.
        has_real_weights: whether each weight may be any number, so that distributions can be sampled.
    """

    kind: str
    rule: str
    title: str
    advice: str
    options: Mapping[str, Any] = field(default_factory=dict)
    has_real_weights: bool = False


TRIALS = (
    Trial(
        "layered",
        "S9.3",
        "Layered networks",
        "compute in binary32 in the order of decision 002; map output o to the actuator o for "
        "output_range [-1, 1], 2 * o - 1 for [0, 1], else (o - lo) / (hi - lo) * 2 - 1, and NaN to 0",
        {"hidden": [3], "activation": "tanh"},
        has_real_weights=True,
    ),
    Trial(
        "fully_meshed",
        "S9.4",
        "Fully meshed networks",
        "reset every agent's nodes at the start",
        {"hidden": 2, "activation": "sigmoid", "iterations": 2},
        has_real_weights=True,
    ),
    Trial(
        "mealy_fsm",
        "S9.5",
        "Finite-state machines",
        "reset every agent's state at the start",
        {"states": 3, "levels": 2},
    ),
    Trial(
        "evostick",
        "S9.15",
        "EvoStick's networks",
        "use the logistic function of 4.924273 times the sum, bias last, mapped to -1..1",
        has_real_weights=True,
    ),
    Trial(
        "hebbian",
        "S9.18",
        "Networks with Hebbian learning",
        "start with the genome's weights, learn in binary64, keep a node's weight to itself",
        {"hidden": 1, "iterations": 2},
        has_real_weights=True,
    ),
    Trial(
        "neat",
        "S9.19",
        "NEAT's networks",
        "compute in binary64 with the e^x of decision 002, node by node, and keep the outputs in binary64",
        {"iterations": 2},
    ),
    Trial(
        "growing",
        "S9.21",
        "NEAT's growing networks",
        "skip disabled connections, compute recurrent nodes from the outputs of the step before",
        {"recurrent": True, "add_node": 0.5, "add_connection": 0.5, "weight_range": 2.0},
    ),
    Trial(
        "modules",
        "S9.16",
        "Machines of modules",
        "take random numbers from the ninth sensor alone; make no transition in the step that enters a state",
    ),
    Trial(
        "modules",
        "S9.17",
        "Behaviour trees of modules",
        "continue the subtree of the last step, and stop for a step after the last one",
        {"form": "tree"},
    ),
)
"""Kinds of controller that steer agents. All except `layered` and `evostick` have a state."""
OPTIONS = {trial.kind: trial.options for trial in reversed(TRIALS)}
"""Options of the first trial of each kind."""
REAL_KINDS = {trial.kind for trial in TRIALS if trial.has_real_weights}
"""Kinds of controller whose weights can be any number."""
KINDS = (*dict.fromkeys(trial.kind for trial in TRIALS), "parameter_set")
"""All kinds of controller."""

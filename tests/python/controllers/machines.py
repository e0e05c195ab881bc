"""Machines of modules for tests."""

from typing import Any

from swarmwright.controllers.kinds.modules.representation import Modules, ModulesOptions

MACHINE: dict[str, Any] = {
    "states": [
        {
            "name": "walk",
            "behaviour": "exploration",
            "rwm": 7,
            "transitions": [
                {"to": "stay", "condition": "black_floor", "probability": 0.75},
                {"to": 2, "condition": "few_neighbours", "xi": 3, "eta": 1.5},
            ],
        },
        {
            "name": "stay",
            "behaviour": "stop",
            "transitions": [{"to": "walk", "condition": "fixed_probability", "probability": 0.125}],
        },
        {"behaviour": "attraction", "alpha": 4},
    ]
}
TREE: dict[str, Any] = {
    "subtrees": [
        {"condition": "black_floor", "probability": 0.75, "behaviour": "exploration", "rwm": 7},
        {"condition": "few_neighbours", "xi": 3, "eta": 1.5, "behaviour": "attraction", "alpha": 4},
        {"condition": "fixed_probability", "probability": 0.125, "behaviour": "stop"},
    ]
}

AUTOMODE = (
    "--nstates 4 --s0 2 --n0 3 --n0x0 0 --c0x0 0 --p0x0 0.5 --n0x1 1 --c0x1 2 --p0x1 0.4 --n0x2 2 --c0x2 5 "
    "--p0x2 0.02 --s1 1 --n1 2 --n1x0 0 --c1x0 4 --p1x0 2 --w1x0 3.5 --n1x1 2 --c1x1 1 --p1x1 0.6 --s2 0 "
    "--rwm2 20.9 --n2 2 --n2x0 0 --c2x0 1 --p2x0 0.05 --n2x1 9 --c2x1 3 --p2x1 1 --w2x1 8 --s3 5 --rep3 3.7"
)


def machines(**options: Any) -> Modules:
    return Modules(ModulesOptions(**options), sensors=9, actuators=2)

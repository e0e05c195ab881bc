"""Where agents, exits and blockades are at the start: given, or drawn as FREVO draws them."""

from dataclasses import dataclass
from pathlib import Path

import yaml

DEFAULTS = {
    "steps": 50,
    "width": 20,
    "height": 20,
    "field": None,
    "numAgents": 10,
    "numExits": 5,
    "numBlockades": 20,
    "seed": 0,
    "update": "sequential",
    "stepSize": 200,
}
"""The parameters of the simulation; `stepSize` counts where it is displayed."""


class ParameterError(Exception):
    """What is wrong with parameters, and how to repair it."""


@dataclass(frozen=True)
class Field:
    """Cells (x, y)."""

    width: int
    height: int
    rows: int
    """Rows in use: something may be below the last in FREVO's random fields that are wider than high."""
    agents: tuple
    exits: tuple
    blockades: tuple


def read_parameters(path, seed=None):
    """Return the parameters in a YAML file, with defaults.

    Args:
        path: an experiment file, whose `parameters` count, or a file that has nothing but parameters.
        seed: instead of the file's.

    Raises:
        ParameterError: the file cannot be read, or has other parameters than Emergency Exit.
    """
    try:
        found = yaml.safe_load(Path(path).read_text(encoding="utf-8")) or {}
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise ParameterError(f"{path}: {error}") from error
    if isinstance(found, dict) and "simulation" in found:
        if found["simulation"] != "emergency_exit":
            raise ParameterError(f"{path}: is an experiment with {found['simulation']!r}, not emergency_exit")
        found = found.get("parameters") or {}
    if not isinstance(found, dict):
        raise ParameterError(f"{path}: expected parameters such as `steps: 50`")
    unknown = sorted(str(name) for name in found if name not in DEFAULTS)
    if unknown:
        raise ParameterError(f"{path}: unknown parameter {unknown[0]!r}; known are {', '.join(DEFAULTS)}")
    parameters = {**DEFAULTS, **found, **({} if seed is None else {"seed": seed})}
    for name, default in DEFAULTS.items():
        if isinstance(default, int) and type(parameters[name]) is not int:
            raise ParameterError(f"{path}: {name}: {parameters[name]!r} found, expected a whole number")
    if parameters["steps"] < 1:
        raise ParameterError(f"{path}: steps: {parameters['steps']} found, at least 1 is needed")
    if parameters["update"] not in ("sequential", "simultaneous"):
        raise ParameterError(
            f"{path}: update: {parameters['update']!r} found, expected sequential or simultaneous"
        )
    return parameters


def field_of(parameters):
    """Return the field of parameters.

    Raises:
        ParameterError: a given field is no field, or a random one has too little room.
    """
    given = parameters["field"]
    if given is None:
        return _random(
            *(
                parameters[name]
                for name in ("width", "height", "numAgents", "numExits", "numBlockades", "seed")
            )
        )
    if isinstance(given, str):
        raise ParameterError(
            f"field: {given!r} is a path; the experiment.yaml in the folder of a run holds the field itself"
        )
    try:
        cells = {
            name: tuple((int(x), int(y)) for x, y in given.get(name, ()))
            for name in ("agents", "exits", "blockades")
        }
        field = Field(int(given["width"]), int(given["height"]), int(given["height"]), **cells)
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise ParameterError(
            "field: expected width, height, and agents, exits and blockades as lists of cells [x, y]"
        ) from error
    _check(field)
    return field


def _check(field):
    if not field.agents or not field.exits:
        raise ParameterError("field: at least one agent and one exit are needed")
    taken = set(field.blockades)
    for x, y in (*field.agents, *field.exits, *field.blockades):
        if not (0 <= x < field.width and 0 <= y < field.height):
            raise ParameterError(f"field: the cell [{x}, {y}] is outside")
    for what, cells in (("exits", field.exits), ("agents", field.agents)):
        for x, y in cells:
            if (x, y) in taken:
                raise ParameterError(f"field.{what}: something else stands on [{x}, {y}]")
            if what == "agents":
                taken.add((x, y))


def _random(width, height, agents, exits, blockades, seed):
    if min(width, height, agents, exits) < 1 or blockades < 0:
        raise ParameterError(
            "width, height, numAgents and numExits must be 1 or more, numBlockades 0 or more"
        )
    if agents > max(width, height) or agents + exits + blockades > width * width:
        raise ParameterError(
            f"a random field of {width} x {height} cells has no room for {agents} agents, {exits} exits and "
            f"{blockades} blockades; agents are limited to the larger of width and height"
        )
    random, taken = JavaRandom(seed), set()

    def draw(count):
        cells = []
        while len(cells) < count:
            # Not the height: that is how FREVO draws.
            cell = (random.below(width), random.below(width))
            if cell not in taken:
                taken.add(cell)
                cells.append(cell)
        return tuple(cells)

    drawn = (draw(agents), draw(exits), draw(blockades))
    return Field(width, height, max(height, *(y + 1 for _, y in taken)), *drawn)


class JavaRandom:
    """The generator of java.util.Random, as its documentation defines it."""

    def __init__(self, seed):
        self._state = (seed ^ 0x5DEECE66D) & ((1 << 48) - 1)

    def below(self, bound):
        """Return a number from 0 to bound - 1; bound below 2^31."""
        bits = self._next()
        if bound & (bound - 1) == 0:
            return bound * bits >> 31
        while bits - bits % bound + bound - 1 >= 1 << 31:
            bits = self._next()
        return bits % bound

    def _next(self):
        self._state = (self._state * 0x5DEECE66D + 0xB) & ((1 << 48) - 1)
        return self._state >> 17

"""Ranges of parameters that sampled models have."""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, fields
from typing import Any

from swarmwright.common.arguments import mapping, number
from swarmwright.common.errors import InputError
from swarmwright.common.yaml import format_path
from swarmwright.experiment.experiment import Experiment
from swarmwright.experiment.robots import DEFAULT, robot_of
from swarmwright.experiment.settings import key_path


@dataclass(frozen=True)
class Range:
    """The values that a key of the experiment has in sampled models, all equally likely.

    low, high: included; whole numbers where both are.
    """

    path: tuple[str, ...]
    low: float
    high: float
    given: str = field(default="vary: ", compare=False)
    """What precedes it in messages: where it was given."""

    def __str__(self) -> str:
        """Return where it was given, key and values: `--vary parameters.speedDefenders=0.4..0.8`."""
        return f"{self.given}{format_path(self.path)}={self.low}..{self.high}"

    @classmethod
    def parse(cls, text: str) -> "Range":
        """Read `parameters.speedDefenders=0.4..0.8`. Raises InputError."""
        try:
            path, rest = key_path(text)
            return cls(path, *_ends(rest), given="--vary ").checked()
        except InputError as error:
            raise InputError(f"--vary {text}: {error}") from None

    @classmethod
    def of(cls, key: str, values: Any, given: str = "vary: ") -> "Range":  # noqa: ANN401 - whatever a caller gives
        """Return the range of a key, `parameters.speedDefenders`. Raises InputError.

        given: what precedes the key in messages.
        """
        try:
            path, rest = key_path(f"{key}=")
            if rest or not isinstance(values, Sequence) or len(values) != 2:
                raise InputError("expected a key and the lowest and highest value")
            low, high = (number("the lowest and highest value", value) for value in values)
            return cls(path, low, high, given).checked()
        except InputError as error:
            raise InputError(f"{given}{key}: {error}") from None

    def checked(self) -> "Range":
        """Return it; raises InputError when it is none."""
        if self.path[0] != "parameters":
            meant = format_path(("parameters", *self.path))
            is_key = self.path[0] in {item.name for item in fields(Experiment)}
            hint = "" if is_key else f"; did you mean {meant}?"
            raise InputError(f"only parameters of the simulation can be varied{hint}")
        if self.path == ("parameters", "seed"):
            raise InputError("parameters.seed: every episode has a seed of its own anyway")
        if not self.low <= self.high:
            raise InputError(f"from {self.low:g} to {self.high:g}: the first is greater than the second")
        return self

    def at(self, share: float) -> float:
        """Return the value at a share, 0 to below 1, of the range."""
        if isinstance(self.low, int) and isinstance(self.high, int):
            return self.low + int(share * (self.high - self.low + 1))
        return self.low + share * (self.high - self.low)


_HINT = "write KEY=LOW..HIGH, such as parameters.speedDefenders=0.4..0.8"


def _ends(text: str) -> tuple[float, float]:
    """Read `0.4..0.8`; in `.5...7` the third point belongs to the second number."""
    places = [found.start() for found in re.finditer(r"(?=\.\.)", text)]
    pairs = [(text[:at].strip(), text[at + 2 :].strip()) for at in places]
    if not pairs:
        raise InputError(_HINT)
    for low, high in pairs:
        first, last = _number(low), _number(high)
        if first is not None and last is not None:
            return first, last
    wrong = next(end for end in pairs[0] if _number(end) is None)
    raise InputError(f"{wrong!r} is not a number; {_HINT}")


def _number(text: str) -> float | None:
    """Return a whole number as one; None for text that is not a finite number."""
    try:
        return int(text)
    except ValueError:
        with suppress(ValueError):
            return value if math.isfinite(value := float(text)) else None
    return None


E_PUCKS = (
    Range(("parameters", "robot", "drive", "noise"), 0.0, 0.15),
    Range(("parameters", "robot", "sensors", "proximity", "noise"), 0.0, 0.1),
    Range(("parameters", "robot", "sensors", "light", "noise"), 0.0, 0.9),
    Range(("parameters", "robot", "sensors", "ground", "noise"), 0.0, 0.1),
    Range(("parameters", "robot", "sensors", "range_and_bearing", "loss"), 0.8, 0.95),
)
"""Of the arena's e-pucks, around the reference model's 0.05 and loss of 0.85."""
PRESETS = (DEFAULT, "e-puck-rm1.2")


def require_e_pucks(experiment: Experiment) -> None:
    """Raise InputError unless all robots of an experiment are the arena's e-pucks of one kind."""
    robot = robot_of(experiment.parameters) if experiment.simulation == "arena" else None
    preset = robot.get("preset") if isinstance(robot, Mapping) else robot
    if preset not in PRESETS:
        raise InputError(
            f"pseudo-reality: ranges are known of the arena's {' and '.join(PRESETS)} only, of one kind; "
            "name the parameters that vary and their ranges instead"
        )


def ranges_of(vary: Mapping[str, Sequence[float]] | Iterable[Range], prefix: str = "vary: ") -> list[Range]:
    """Return ranges by their keys. Raises InputError.

    prefix: what precedes the keys in messages.
    """
    given: Any = vary
    if isinstance(given, list | tuple) and all(isinstance(item, Range) for item in given):
        paths = [item.path for item in given]
        twice = next((item for index, item in enumerate(given) if item.path in paths[:index]), None)
        if twice is not None:
            raise InputError(f"{twice}: this parameter has a range already; give it once")
        return list(given)
    named = mapping("vary", given, "{'parameters.speedDefenders': (0.4, 0.8)}")
    return [Range.of(key, values, prefix) for key, values in named.items()]

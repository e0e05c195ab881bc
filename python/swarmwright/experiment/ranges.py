"""Ranges of parameters for sampled models."""

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
    """Uniform distribution of a key of the experiment in sampled models.

    low, high: inclusive; values are integers if both are.
    """

    path: tuple[str, ...]
    low: float
    high: float
    prefix: str = field(default="vary: ", compare=False)
    """Prefix in messages."""
    reference: float | None = field(default=None, compare=False)
    """The value without sampling, if known here."""

    def __str__(self) -> str:
        """Return prefix, key and values: `--vary parameters.speedDefenders=0.4..0.8`."""
        return f"{self.prefix}{format_path(self.path)}={self.low}..{self.high}"

    @classmethod
    def parse(cls, text: str) -> "Range":
        """Parse `parameters.speedDefenders=0.4..0.8`. Raises InputError."""
        try:
            path, remainder = key_path(text)
            return cls(path, *_parse_ends(remainder), prefix="--vary ").check()
        except InputError as error:
            raise InputError(f"--vary {text}: {error}") from None

    @classmethod
    def from_values(cls, key: str, values: Any, prefix: str = "vary: ") -> "Range":  # noqa: ANN401 - whatever a caller gives
        """Build the range of a key, `parameters.speedDefenders`. Raises InputError.

        given: prefix in messages.
        """
        try:
            path, remainder = key_path(f"{key}=")
            if remainder or not isinstance(values, Sequence) or len(values) != 2:
                raise InputError("expected a key and the lowest and highest value")
            low, high = (number("the lowest and highest value", value) for value in values)
            return cls(path, low, high, prefix).check()
        except InputError as error:
            raise InputError(f"{prefix}{key}: {error}") from None

    def check(self) -> "Range":
        """Check the range and return it. Raises InputError if it is invalid."""
        if self.path[0] != "parameters":
            suggestion = format_path(("parameters", *self.path))
            is_key = self.path[0] in {item.name for item in fields(Experiment)}
            hint = "" if is_key else f"; did you mean {suggestion}?"
            raise InputError(f"only parameters of the simulation can be varied{hint}")
        if self.path == ("parameters", "seed"):
            raise InputError("parameters.seed: cannot be varied, as every episode has its own seed")
        if not self.low <= self.high:
            raise InputError(f"the lowest value {self.low:g} exceeds the highest, {self.high:g}")
        return self

    def interpolate(self, share: float) -> float:
        """Return the value at a share of the range, from 0 to below 1."""
        if isinstance(self.low, int) and isinstance(self.high, int):
            return self.low + int(share * (self.high - self.low + 1))
        return self.low + share * (self.high - self.low)


_HINT = "write KEY=LOW..HIGH, such as parameters.speedDefenders=0.4..0.8"


def _parse_ends(text: str) -> tuple[float, float]:
    """Parse `0.4..0.8`; in `.5...7`, the third point belongs to the second number."""
    positions = [match.start() for match in re.finditer(r"(?=\.\.)", text)]
    pairs = [(text[:at].strip(), text[at + 2 :].strip()) for at in positions]
    if not pairs:
        raise InputError(_HINT)
    for low, high in pairs:
        first, last = _parse_number(low), _parse_number(high)
        if first is not None and last is not None:
            return first, last
    wrong = next(end for end in pairs[0] if _parse_number(end) is None)
    raise InputError(f"{wrong!r} is not a number; {_HINT}")


def _parse_number(text: str) -> float | None:
    """Parse an integer or a finite number; None for other texts."""
    try:
        return int(text)
    except ValueError:
        with suppress(ValueError):
            return value if math.isfinite(value := float(text)) else None
    return None


E_PUCKS = (
    Range(("parameters", "robot", "drive", "noise"), 0.0, 0.15, reference=0.05),
    Range(("parameters", "robot", "sensors", "proximity", "noise"), 0.0, 0.1, reference=0.05),
    Range(("parameters", "robot", "sensors", "light", "noise"), 0.0, 0.9, reference=0.05),
    Range(("parameters", "robot", "sensors", "ground", "noise"), 0.0, 0.1, reference=0.05),
    Range(("parameters", "robot", "sensors", "range_and_bearing", "loss"), 0.8, 0.95, reference=0.85),
)
"""Ranges for the arena's e-pucks, around the values of the reference model in the engine's `presets.rs`."""
PRESETS = (DEFAULT, "e-puck-rm1.2")


def require_e_pucks(experiment: Experiment) -> None:
    """Raise InputError unless all robots of an experiment are the arena's e-pucks of one kind."""
    robot = robot_of(experiment.parameters) if experiment.simulation == "arena" else None
    preset = robot.get("preset") if isinstance(robot, Mapping) else robot
    if preset not in PRESETS:
        raise InputError(
            f"pseudo-reality: needs robots of one kind in the arena, {' or '.join(PRESETS)}; otherwise vary "
            "parameters with explicit ranges"
        )


def ranges_of(vary: Mapping[str, Sequence[float]] | Iterable[Range], prefix: str = "vary: ") -> list[Range]:
    """Build ranges from a mapping of keys. Raises InputError.

    prefix: of keys in messages.
    """
    values: Any = vary
    if isinstance(values, list | tuple) and all(isinstance(item, Range) for item in values):
        paths = [item.path for item in values]
        duplicate = next((item for index, item in enumerate(values) if item.path in paths[:index]), None)
        if duplicate is not None:
            raise InputError(f"{duplicate}: the parameter has two ranges; give one")
        return list(values)
    named = mapping("vary", values, "{'parameters.speedDefenders': (0.4, 0.8)}")
    return [Range.from_values(key, values, prefix) for key, values in named.items()]

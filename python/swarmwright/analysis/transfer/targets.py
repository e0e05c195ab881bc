"""Where candidates are transferred to: another simulation, or models sampled around the run's own."""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from swarmwright.core.errors import InputError
from swarmwright.core.random_numbers import Stream
from swarmwright.core.yaml import dotted_path, read
from swarmwright.experiment.experiment import ELSEWHERE, Experiment
from swarmwright.experiment.settings import key_path
from swarmwright.simulations import catalogue

CHANGED = ELSEWHERE - {"validate"} | {"simulation", "parameters", "sensors", "actuators", "fitness"}
"""Keys of an experiment that a file of a target may have."""
_FILES = (".yaml", ".yml")


@dataclass(frozen=True)
class OtherSimulation:
    """A simulation with another name, or what a file changes in the experiment.

    name: of a simulation, as in experiments, or of a file (.yaml) with keys of an experiment.
    """

    name: str

    @property
    def places(self) -> bool:
        """Whether it says itself, in a file, where its episodes are evaluated."""
        values = read(Path(self.name)).values if self.name.endswith(_FILES) else None
        return isinstance(values, Mapping) and not {"servers", "broker"}.isdisjoint(values)

    def experiments(self, experiment: Experiment, count: int) -> list[Experiment]:  # noqa: ARG002 - as targets have it
        """Return the experiment of all episodes. Raises InputError where it cannot be changed like this."""
        changed = self._changed(experiment)
        if changed.sensors is None and not catalogue.is_here(changed.simulation):
            # The controller has these; the server's are compared with them.
            changed = changed.replace(sensors=experiment.sensors, actuators=experiment.actuators)
        return [changed]

    def _changed(self, experiment: Experiment) -> Experiment:
        if self.name.endswith(_FILES):
            return experiment.changed_by(
                Path(self.name), only=CHANGED, reason="a target says where candidates are evaluated, not this"
            )
        try:
            return experiment.replace(simulation=self.name)
        except InputError as error:
            raise InputError(
                f"{self.name}: {error}\nTo change parameters as well, name a file (.yaml) with the keys "
                "'simulation' and 'parameters' instead of the simulation"
            ) from error


@dataclass(frozen=True)
class Range:
    """The values that a key of the experiment has in sampled models, all equally likely.

    low, high: included; whole numbers where both are.
    """

    path: tuple[str, ...]
    low: float
    high: float

    @classmethod
    def parse(cls, text: str) -> "Range":
        """Read `parameters.speedDefenders=0.4..0.8`. Raises InputError."""
        try:
            path, rest = key_path(text)
            return cls(path, *_ends(rest)).checked()
        except InputError as error:
            raise InputError(f"--vary {text}: {error}") from None

    @classmethod
    def of(cls, key: str, values: Sequence[float]) -> "Range":
        """Return the range of a key, `parameters.speedDefenders`. Raises InputError."""
        try:
            path, rest = key_path(f"{key}=")
            if rest or len(values) != 2:
                raise InputError("expected a key and the lowest and highest value")
            return cls(path, *values).checked()
        except InputError as error:
            raise InputError(f"vary: {key}: {error}") from None

    def checked(self) -> "Range":
        """Return it; raises InputError when it is none."""
        if self.path[0] != "parameters":
            raise InputError(f"{self.path[0]}: only parameters of the simulation can be varied")
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
    wrong = next(one for one in pairs[0] if _number(one) is None)
    raise InputError(f"{wrong!r} is not a number; {_HINT}")


def _number(text: str) -> float | None:
    """Return a whole number as one; None for text that is no finite number."""
    try:
        return int(text)
    except ValueError:
        with suppress(ValueError):
            return number if math.isfinite(number := float(text)) else None
    return None


@dataclass(frozen=True)
class PseudoReality:
    """Models of the run's own simulation, sampled around its parameters, one for each episode.

    After Ligot and Birattari, "Simulation-only experiments to mimic the effects of the reality gap in the
    automatic design of robot swarms", Swarm Intelligence 14, 2020, doi:10.1007/s11721-019-00175-w: what is
    lost from one model to others tells designs that are robust from those that are not, without robots.
    """

    ranges: tuple[Range, ...]
    seed: int = 0
    name: str = "pseudo-reality"
    places = False

    def experiments(self, experiment: Experiment, count: int) -> list[Experiment]:
        """Return an experiment with sampled parameters for each episode; the same for all runs."""
        return [self._sampled(experiment, model) for model in range(count)]

    def _sampled(self, experiment: Experiment, model: int) -> Experiment:
        stream = Stream(self.seed, "pseudo-reality", 0, model)
        shares = stream.unit(len(self.ranges)).tolist()
        settings = [
            f"{dotted_path(one.path)}={one.at(share)!r}"
            for one, share in zip(self.ranges, shares, strict=True)
        ]
        try:
            return experiment.with_settings(settings)
        except InputError as error:
            raise InputError(str(error).replace("--set ", f"{self.name}, model {model}: ")) from error


Target = OtherSimulation | PseudoReality


def targets_of(
    to: Iterable[str], vary: Mapping[str, Sequence[float]] | Iterable[Range], seed: int
) -> list[Target]:
    """Return what candidates are transferred to. Raises InputError for nothing, or the same one twice."""
    names = list(to)
    doubled = next((name for name in names if names.count(name) > 1), None)
    if doubled is not None:
        raise InputError(f"to: {doubled} is named twice")
    ranges = [Range.of(*one) for one in vary.items()] if isinstance(vary, Mapping) else list(vary)
    found: list[Target] = [OtherSimulation(name) for name in names]
    if ranges:
        found.append(PseudoReality(tuple(ranges), seed))
    if not found:
        raise InputError("nothing to transfer to: name simulations, or parameters that vary")
    return found
